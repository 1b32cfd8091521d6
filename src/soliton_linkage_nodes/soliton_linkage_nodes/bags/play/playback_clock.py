# SPDX-License-Identifier: Apache-2.0
"""Clock of the playback. Other threads can pause, step, seek and stop it."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from enum import Enum, auto

RATES = (1e-3, 1e3)
"""Lowest and highest playback rate relative to the recording [1]."""
_LONGEST_WAIT = 0.1
"""Longest time between two updates of the progress line [s]."""


class NextAction(Enum):
    """Next action of the player after a wait for a message."""

    PLAY = auto()
    SEEK = auto()
    STOP = auto()


class PlaybackClock:
    """Clock of the playback.

    The playback time is the receive time of the messages that are due. At the time t [ns], it is
    p = p0 + rate (t - t0) [ns]. A change of the rate sets p0 and t0 to the present values of p and
    t. After a seek, p0 is the requested time. During a pause p is constant, except that a message
    that is played in this time sets p to its own receive time. After the pause, the playback
    continues from the reached p. If the clock is not `paced`, each message is due immediately,
    except during a pause.
    """

    def __init__(
        self,
        rate: float = 1.0,
        paused: bool = False,
        paced: bool = True,
        clock: Callable[[], float] = time.monotonic,
        longest_step: float = 1.0,
        longest_burst: float = 2.0,
        changed: threading.Condition | None = None,
    ) -> None:
        """Set the longest durations of `play_next` and of `burst` [s].

        The durations are limited because these calls block all other services of the player.
        """
        self.stopping = threading.Event()
        self._longest_step = longest_step
        self._longest_burst = longest_burst
        self._changed = changed or threading.Condition()
        self._clock = clock
        self.paced = paced
        self.rate = rate
        self.paused = paused
        self._position = 0.0
        self._since = clock()
        self._steps = 0
        self._passed = 0
        self._at_end = False
        self._sought: int | None = None

    @property
    def stepping(self) -> bool:
        """Whether some messages of a step or burst have not been played yet."""
        return bool(self._steps)

    def start(self, stamp: int) -> None:
        """Set the playback time to `stamp` [ns]."""
        with self._changed:
            self._position = float(stamp)
            self._since = self._clock()

    def pause(self) -> None:
        """Pause the playback."""
        with self._changed:
            self._move()
            self.paused = True
            self._changed.notify_all()

    def resume(self) -> None:
        """End a pause."""
        with self._changed:
            self._move()
            self.paused = False
            self._steps = 0
            self._changed.notify_all()

    def toggle(self) -> None:
        """Pause or resume."""
        (self.resume if self.paused else self.pause)()

    def set_rate(self, rate: float) -> None:
        """Set the playback rate relative to the recording [1]."""
        with self._changed:
            self._move()
            self.rate = rate
            self._changed.notify_all()

    def play_next(self) -> bool:
        """Play one message during a pause. Return whether it was played within `longest_step`.

        A message that was not played by then is not played later.
        """
        with self._changed:
            return bool(self._step(1, self._longest_step))

    def burst(self, number: int) -> int:
        """Play `number` messages during a pause. If `number` is 0, play all messages.

        Return how many messages were played within `longest_burst`. The player plays the others
        after the return. If none was played, however, the player drops the request.
        """
        with self._changed:
            return self._step(number or sys.maxsize, self._longest_burst)

    def seek(self, stamp: int) -> None:
        """Request that the playback continues from `stamp` [ns]."""
        with self._changed:
            self._sought = stamp
            self._changed.notify_all()

    def reopen(self) -> None:
        """Allow another playback after a stop. A paused clock stays paused."""
        with self._changed:
            self.stopping.clear()
            self._sought = None
            self._steps = 0

    def stop(self) -> None:
        """Stop the playback."""
        with self._changed:
            self.stopping.set()
            self._changed.notify_all()

    def take_sought(self) -> int:
        """Return the time of the requested seek [ns], and clear the request.

        Raises ValueError if no seek is requested.
        """
        with self._changed:
            sought, self._sought = self._sought, None
        if sought is None:
            raise ValueError('there was no seek; call this only after NextAction.SEEK')
        return sought

    def wait_for(self, stamp: int, meanwhile: Callable[[], None] = lambda: None) -> NextAction:
        """Wait until a message with receive time `stamp` [ns] is due, or until a seek or a stop.

        During the wait, `meanwhile` is called ten times per second.
        """
        while True:
            with self._changed:
                early = self._early(stamp)
                if self.stopping.is_set():
                    return NextAction.STOP
                if self._sought is not None:
                    return NextAction.SEEK
                if early <= 0.0:
                    if self.paused:
                        self._pass_one(stamp)
                    return NextAction.PLAY
                self._changed.wait(min(early, _LONGEST_WAIT))
            meanwhile()

    def wait_at_end(self) -> NextAction:
        """Wait at the end of the bag during a pause, until a seek, a stop or a resume."""
        with self._changed:
            self._at_end, self._steps = True, 0
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: not self.paused or self.stopping.is_set() or self._sought is not None
            )
            self._at_end = False
            if self.stopping.is_set():
                return NextAction.STOP
            return NextAction.PLAY if self._sought is None else NextAction.SEEK

    def _step(self, number: int, limit: float) -> int:
        if not self.paused or self._at_end or self.stopping.is_set():
            return 0
        before = self._passed
        self._steps += number
        self._changed.notify_all()
        self._changed.wait_for(lambda: not self._steps or self.stopping.is_set(), limit)
        passed = self._passed - before
        if not passed:
            self._steps = 0
        return passed

    def _early(self, stamp: int) -> float:
        if self.paused:
            return 0.0 if self._steps else _LONGEST_WAIT
        if not self.paced:
            return 0.0
        return self._since + (stamp - self._position) * 1e-9 / self.rate - self._clock()

    def _pass_one(self, stamp: int) -> None:
        self._steps -= 1
        self._passed += 1
        self._position = max(self._position, float(stamp))
        self._changed.notify_all()

    def _move(self) -> None:
        now = self._clock()
        if not self.paused:
            self._position += (now - self._since) * 1e9 * self.rate
        self._since = now
