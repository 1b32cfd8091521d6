# SPDX-License-Identifier: Apache-2.0
"""Times since the epoch, in nanoseconds and as messages."""

from __future__ import annotations

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
