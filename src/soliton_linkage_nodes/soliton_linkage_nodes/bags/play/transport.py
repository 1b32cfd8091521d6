# SPDX-License-Identifier: Apache-2.0
"""When messages of a bag are due: at a rate, from an instant on, in pauses and step by step."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from enum import Enum

RATES = (1e-3, 1e3)
"""Slowest and fastest that a bag is played, against as it was recorded."""
_ALL = sys.maxsize
"""Messages, more than a bag holds."""
_LONGEST_BURST = 2.0
"""How long who asks for a burst waits for its end [s]: meanwhile a node answers nothing else."""
_LONGEST_WAIT = 0.1
"""From one call of `meanwhile` to the next [s]: a line that is shown does not seem to stall."""


class Turn(Enum):
    """What to do after waiting for a message."""

    PLAY = 'play it'
    SEEK = 'go on elsewhere'
    STOP = 'stop'


class Transport:
    """Plays the time of a bag [ns] at a rate; another thread may pause, seek, step and stop it.

    The time that is played is `p = p0 + rate (t - t0)`, with a new (t0, p0) at each change.
    Where it is not paced, every message is due at once, except in a pause. `stopping` is set once
    nothing passes any more.
    """

    def __init__(
        self,
        rate: float = 1.0,
        paused: bool = False,
        paced: bool = True,
        clock: Callable[[], float] = time.monotonic,
        longest_step: float = 1.0,
        changed: threading.Condition | None = None,
    ) -> None:
        """Stand still until the first `start`; a step that is not taken is forgotten soon [s].

        Waits on the condition, which goes on as the clock does.
        """
        self.stopping = threading.Event()
        self._longest_step = longest_step
        self._changed = changed or threading.Condition()
        self._clock = clock
        self._paced = paced
        self._rate = rate
        self._paused = paused
        self._position = 0.0
        self._since = clock()
        self._steps = 0
        self._passed = 0
        self._at_end = False
        self._sought: int | None = None

    @property
    def rate(self) -> float:
        """How much faster than recorded."""
        return self._rate

    @property
    def paused(self) -> bool:
        """Whether it stands still."""
        return self._paused

    @property
    def stepping(self) -> bool:
        """Whether messages are still to pass in a pause."""
        return bool(self._steps)

    def start(self, stamp: int) -> None:
        """Go on from an instant."""
        with self._changed:
            self._position = float(stamp)
            self._since = self._clock()

    def pause(self) -> None:
        """Stand still from now on."""
        with self._changed:
            self._move()
            self._paused = True
            self._changed.notify_all()

    def resume(self) -> None:
        """Go on from where it stands."""
        with self._changed:
            self._move()
            self._paused = False
            self._steps = 0
            self._changed.notify_all()

    def toggle(self) -> None:
        """Pause, or go on."""
        if self._paused:
            self.resume()
        else:
            self.pause()

    def set_rate(self, rate: float) -> None:
        """Go on at another rate."""
        with self._changed:
            self._move()
            self._rate = rate
            self._changed.notify_all()

    def play_next(self) -> bool:
        """Let one message pass in a pause; False where there is no pause, or no message."""
        with self._changed:
            return bool(self._step(1, self._longest_step))

    def burst(self, number: int) -> int:
        """Let so many messages pass at once in a pause, 0 for all, and return how many have.

        It returns after two seconds at most; where some have passed, the rest follows.
        """
        with self._changed:
            return self._step(number or _ALL, _LONGEST_BURST)

    def seek(self, stamp: int) -> None:
        """Go on from another instant as soon as the player asks for its turn."""
        with self._changed:
            self._sought = stamp
            self._changed.notify_all()

    def reopen(self) -> None:
        """Let messages pass again after a stop; a pause lasts."""
        with self._changed:
            self.stopping.clear()
            self._sought = None
            self._steps = 0

    def stop(self) -> None:
        """Let nothing pass any more."""
        with self._changed:
            self.stopping.set()
            self._changed.notify_all()

    def take_sought(self) -> int:
        """Return the instant that was sought."""
        with self._changed:
            sought, self._sought = self._sought, None
        if sought is None:
            raise ValueError('no instant was sought; ask only after Turn.SEEK')
        return sought

    def wait_for(self, stamp: int, meanwhile: Callable[[], None] = lambda: None) -> Turn:
        """Wait until a message is due; `meanwhile` is called ten times a second."""
        while True:
            with self._changed:
                early = self._early(stamp)
                if self.stopping.is_set():
                    return Turn.STOP
                if self._sought is not None:
                    return Turn.SEEK
                if early <= 0.0:
                    if self._paused:
                        self._pass_one(stamp)
                    return Turn.PLAY
                self._changed.wait(min(early, _LONGEST_WAIT))
            meanwhile()

    def wait_at_end(self) -> Turn:
        """Stay where all is played as long as it is paused, for another instant to be sought."""
        with self._changed:
            self._at_end, self._steps = True, 0
            self._changed.notify_all()
            self._changed.wait_for(
                lambda: not self._paused or self.stopping.is_set() or self._sought is not None
            )
            self._at_end = False
            if self.stopping.is_set():
                return Turn.STOP
            return Turn.PLAY if self._sought is None else Turn.SEEK

    def _step(self, number: int, patience: float) -> int:
        """Let messages pass in a pause, and return how many have while it waited [s]."""
        if not self._paused or self._at_end or self.stopping.is_set():
            return 0
        before = self._passed
        self._steps += number
        self._changed.notify_all()
        self._changed.wait_for(lambda: not self._steps or self.stopping.is_set(), patience)
        passed = self._passed - before
        if not passed:
            self._steps = 0
        return passed

    def _early(self, stamp: int) -> float:
        """Time until a message is due [s]."""
        if self._paused:
            return 0.0 if self._steps else _LONGEST_WAIT
        if not self._paced:
            return 0.0
        due = self._since + (stamp - self._position) * 1e-9 / self._rate
        return due - self._clock()

    def _pass_one(self, stamp: int) -> None:
        self._steps -= 1
        self._passed += 1
        self._position = max(self._position, float(stamp))
        self._changed.notify_all()

    def _move(self) -> None:
        now = self._clock()
        if not self._paused:
            self._position += (now - self._since) * 1e9 * self._rate
        self._since = now
