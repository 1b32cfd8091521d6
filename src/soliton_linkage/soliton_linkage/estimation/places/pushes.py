# SPDX-License-Identifier: Apache-2.0
"""Pushes that an analyser is told of: from which frame on each acts."""

from __future__ import annotations

from typing import NamedTuple

from soliton_linkage.linkage.chain import Array

_NANOSECOND = 1e-9
"""Unit of stamps [s]."""
_NEAR = 3600 * 10**9
"""Farthest that a stamp may be from that of the latest frame to be of the same clock [ns]: who
analyses is behind by seconds or minutes, and clocks of another beginning differ by years."""


class Push(NamedTuple):
    """Impulses that act on the rotors of a chain at one instant.

    impulses: angular impulses [N m s], shape (N,).
    ago: time from that instant to the frame that they act from [s].
    """

    impulses: Array
    ago: float = 0.0


class WaitingPushes:
    """Pushes that wait for the first frame that is not earlier than they are.

    One without a stamp, or with that of another clock, waits for the next frame.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.late = 0
        """Number of pushes that came after the frame that they acted from."""
        self._waiting: list[tuple[int | None, Array]] = []
        self._frame: int | None = None

    def add(self, stamp: int | None, impulses: Array) -> None:
        """Have impulses wait that were made at an instant [ns], None where that is not known."""
        after = None if stamp is None or self._frame is None else stamp - self._frame
        if after is not None and -_NEAR < after <= 0:
            self.late += 1
        else:
            known = after is None or after < _NEAR
            self._waiting.append((stamp if known else None, impulses))

    def due(self, stamp: int) -> list[Push]:
        """Take those that act from the frame of a stamp [ns] on."""
        if self._frame is not None and stamp < self._frame:
            self._waiting.clear()
        self._frame = stamp
        if not self._waiting:
            return []
        due, later = [], []
        for made, impulses in self._waiting:
            before = 0 if made is None else stamp - made
            if -_NEAR < before < 0:
                later.append((made, impulses))
            else:
                due.append(Push(impulses, before * _NANOSECOND if before < _NEAR else 0.0))
        self._waiting = later
        return due
