# SPDX-License-Identifier: Apache-2.0
"""Conversion of times, age of the last message, and offset between clocks."""

from __future__ import annotations

import math
import struct
import time

from builtin_interfaces.msg import Time
from rclpy.clock import Clock

SECOND = 10**9
"""One second [ns]."""
_HEADER_BYTES = 12
"""Size of the CDR encapsulation and of the stamp at the start of a serialized message [B]."""


def time_to_msg(nanoseconds: int) -> Time:
    """Return the message for a time since the epoch [ns]."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return Time(sec=seconds, nanosec=rest)


def time_from_msg(stamp: Time) -> int:
    """Return the time since the epoch [ns] from a message."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def stamp_of(serialized: bytes) -> int:
    """Return the stamp [ns] of a message whose first field is a header.

    `serialized` contains the CDR bytes of the message. Raises ValueError if they are too few.
    """
    if len(serialized) < _HEADER_BYTES:
        raise ValueError(f'a message of {len(serialized)} bytes is shorter than its header')
    order = '<' if serialized[1] & 1 else '>'
    seconds, nanoseconds = struct.unpack_from(f'{order}iI', serialized, 4)
    return int(seconds) * SECOND + int(nanoseconds)


def nanoseconds_of(clock: Clock) -> int:
    """Return the time of a clock [ns]. `Clock.now` would be slower: it creates two objects."""
    handle = clock.handle
    with handle:
        return int(handle.get_now().nanoseconds)


class Freshness:
    """Age of the last message. The message is stale if it is older than `longest` [s]."""

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._arrival = -math.inf

    def renew(self) -> None:
        """Record that a message arrived."""
        self._arrival = time.monotonic()

    @property
    def age(self) -> float:
        """Age of the last message [s], infinite if none has arrived."""
        return time.monotonic() - self._arrival

    @property
    def stale(self) -> bool:
        """Whether the last message is too old or none has arrived."""
        return self.age > self._longest

    def __str__(self) -> str:
        age = self.age
        return 'none received' if math.isinf(age) else f'the last is {age:.3g} s old'


_DRIFT_TIME = 10.0
"""Shortest time for an estimate of the drift [s]. After 10 s, a jitter of 1 ms causes an error of
100 ppm."""


class ClockMonitor:
    """Monitor of the offset between the clock and the stamps of messages, for diagnostics only.

    The offset is the smallest value of arrival time minus stamp since the last call of `figures`.
    """

    def __init__(self) -> None:
        self._least: int | None = None
        self._latest = 0
        self._first: tuple[int, int] | None = None

    def note(self, stamp: int, now: int) -> None:
        """Record the stamp of a message [ns] and its arrival time `now` [ns]."""
        behind = now - stamp
        if self._least is None or behind < self._least:
            self._least, self._latest = behind, now

    def figures(self) -> dict[str, float]:
        """Return the offset [s] and its drift [ppm] by name; {} if there is no new message.

        The drift is the mean drift since the first call that returned an offset. It is omitted
        in the first 10 s after that call.
        """
        if self._least is None:
            return {}
        least, at, self._least = self._least, self._latest, None
        values = {'stamps behind the clock [s]': least / SECOND}
        if self._first is None:
            self._first = (at, least)
        elapsed = (at - self._first[0]) / SECOND
        if elapsed >= _DRIFT_TIME:
            drift = 1e6 * (least - self._first[1]) / SECOND / elapsed
            values['drift of stamps against the clock [ppm]'] = drift
        return values
