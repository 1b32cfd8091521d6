# SPDX-License-Identifier: Apache-2.0
"""Times since the epoch, in nanoseconds and as messages."""

from __future__ import annotations

import math
import time

from builtin_interfaces.msg import Time
from rclpy.clock import Clock

SECOND = 10**9
"""Nanoseconds."""


def time_to_msg(nanoseconds: int) -> Time:
    """Time since the epoch [ns] as a message."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return Time(sec=seconds, nanosec=rest)


def time_from_msg(stamp: Time) -> int:
    """Time since the epoch [ns]."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def nanoseconds_of(clock: Clock) -> int:
    """What a clock says [ns], without the objects that `Clock.now` makes of it."""
    handle = clock.handle
    with handle:
        return int(handle.get_now().nanoseconds)


class Freshness:
    """Tells whether what came last is young enough to act on."""

    def __init__(self, longest: float) -> None:
        """What is older than `longest` [s] is too old; so is what never came."""
        self._longest = longest
        self._came_at = -math.inf

    def renew(self) -> None:
        """Note that something came."""
        self._came_at = time.monotonic()

    @property
    def age(self) -> float:
        """Of what came last [s], infinite where nothing did."""
        return time.monotonic() - self._came_at

    @property
    def stale(self) -> bool:
        """Whether it is too old."""
        return self.age > self._longest

    def __str__(self) -> str:
        age = self.age
        return 'none has come' if math.isinf(age) else f'the last is {age:.3g} s old'


_SHORTEST = 10.0
"""Time from which on a drift is told [s]: ways of messages differ by milliseconds, so that it is
known to 100 ppm by then, which is what a poor quartz drifts."""


class ClockMonitor:
    """Compares stamps with when they come; the quickest message of a while tells the difference.

    Stamps of a simulation that was paused, or of a bag, differ from the clock as well. Nothing
    that a node does depends on the difference: that of messages is reckoned by their stamps
    alone, their age by when they come.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._latest = 0
        self._first: tuple[int, int] | None = None

    def note(self, stamp: int, now: int) -> None:
        """Take note of a message's stamp and of the time when it came, both [ns]."""
        behind = now - stamp
        if self._least is None or behind < self._least:
            self._least, self._latest = behind, now

    def figures(self) -> dict[str, float]:
        """What the messages since the last call tell; nothing where none has come."""
        if self._least is None:
            return {}
        least, at, self._least = self._least, self._latest, None
        told = {'stamps behind the clock [s]': least / SECOND}
        if self._first is None:
            self._first = (at, least)
        elapsed = (at - self._first[0]) / SECOND
        if elapsed >= _SHORTEST:
            drift = 1e6 * (least - self._first[1]) / SECOND / elapsed
            told['drift of stamps against the clock [ppm]'] = drift
        return told
