# SPDX-License-Identifier: Apache-2.0
"""From frames of a controller to angles at instants of the clock here."""

from __future__ import annotations

from typing import NamedTuple

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.device_clock import DeviceClock
from soliton_linkage.microcontroller.frames import (
    READINGS,
    SEQUENCES,
    FrameKind,
    SerialFrame,
)
from soliton_linkage.microcontroller.rotary_encoders import AngleReader


class StampedAngles(NamedTuple):
    """Angles of a frame."""

    stamp: int
    """When they were measured, by the clock here [ns]."""
    angles: Array
    """Of the rotors [rad], shape (N,), NaN where one is missing."""


class AngleStream:
    """Takes frame after frame, and knows which never came and when the controller began anew."""

    def __init__(self, reader: AngleReader) -> None:
        self.clock = DeviceClock()
        """Of the controller."""
        self.lost = 0
        """Frames that were numbered and never came whole."""
        self._reader = reader
        self._last: int | None = None

    def begin_anew(self) -> None:
        """Take what comes for that of a controller that has begun anew."""
        self.clock.begin_anew()
        self._last = None

    def take(self, frame: SerialFrame, arrival: int) -> StampedAngles | None:
        """Angles of a frame that arrives at an instant [ns]; None for one that is no reading.

        Raises ValueError for a reading that does not fit the chain, or comes twice.
        """
        if frame.kind is FrameKind.HELLO:
            self.begin_anew()
            return None
        if frame.kind not in READINGS:
            raise ValueError(
                f'{frame.kind.value} are commands to a controller; send counts or radians'
            )
        angles = self._reader.read(frame)
        restarts = self.clock.restarts
        if frame.time is None:
            stamp = self.clock.stamp_of_arrival(arrival)
        else:
            stamp = self.clock.stamp(frame.time, arrival)
        if self.clock.restarts != restarts:
            self._last = None
        self._count(frame.sequence)
        return StampedAngles(stamp, angles)

    def _count(self, number: int | None) -> None:
        if number is not None and self._last is not None:
            missing = (number - self._last - 1) % SEQUENCES
            # A number that is behind is that of a controller without a clock that began anew.
            self.lost += missing if missing < SEQUENCES // 2 else 0
        self._last = number
