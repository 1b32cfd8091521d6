# SPDX-License-Identifier: Apache-2.0
"""Rotor angles from the frames of a controller: encoder mounting, turns, stamps, lost frames."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import LARGEST_ANGLE, check_quantities, quantity
from soliton_linkage.microcontroller.device_clock import DeviceClock
from soliton_linkage.microcontroller.frames import READINGS, SEQUENCES, FrameKind, SerialFrame

_COMPARED_NUMBERS = 4
"""Number of earlier frame numbers with which a frame number is compared [1]."""


@dataclass(frozen=True)
class RotaryEncoders:
    """Mounting of encoders on rotors. Raises ValueError for values out of their range.

    For a reading q in turns, the angle is

        phi = 2 pi sign q - offset.
    """

    counts_per_turn: tuple[float, ...] = quantity(
        (4096.0,), 'counts per turn, one value for all encoders or one per rotor [1]'
    )
    signs: tuple[float, ...] = quantity(
        (),
        '1 if readings increase from +z towards +x, else -1, one per rotor; empty for 1 [1]',
    )
    offsets: tuple[float, ...] = quantity(
        (), 'reading minus angle, one per rotor; empty for 0 [rad]'
    )
    wrapped: bool = quantity(
        True,
        'whether readings wrap after a turn; a turn must then take more than two frames',
    )

    def __post_init__(self) -> None:
        """Reject values out of their range."""
        check_quantities(self)
        for counts in self.counts_per_turn:
            if not (math.isfinite(counts) and counts >= 1):
                raise ValueError(f'counts_per_turn = {counts:g} must be 1 or more')
        for sign in self.signs:
            if sign not in (1, -1):
                raise ValueError(f'sign of an encoder = {sign:g} must be 1 or -1')
        for offset in self.offsets:
            if not abs(offset) <= LARGEST_ANGLE:
                raise ValueError(
                    f'offset of an encoder = {offset:g} rad must lie in the range '
                    f'{-LARGEST_ANGLE:g} to {LARGEST_ANGLE:g} rad'
                )

    def check_fit(self, rotors: int) -> None:
        """Raise ValueError unless there is one value for each rotor, or one for all."""
        for name, least in (('counts_per_turn', 1), ('signs', 0), ('offsets', 0)):
            given = len(getattr(self, name))
            if given not in (least, rotors):
                raise ValueError(
                    f'{name} has {given} values for a chain of {rotors} rotors; '
                    f'give {least or "none"} or {rotors}'
                )

    def per_radian(self) -> Array:
        """Return the counts per radian of each encoder [1/rad], shape (1,) or (N,)."""
        return np.asarray(np.asarray(self.signs or 1.0) * self.counts_per_turn / math.tau)


class AngleReader:
    """Conversion of readings to unwrapped angles."""

    def __init__(self, encoders: RotaryEncoders, rotors: int) -> None:
        """Prepare for a number of rotors; raise ValueError if the encoders do not match it."""
        encoders.check_fit(rotors)
        self.rotors = rotors
        self._wrapped = encoders.wrapped
        self._radians = {
            FrameKind.COUNTS: 1 / encoders.per_radian(),
            FrameKind.RADIANS: np.asarray(encoders.signs or 1.0),
        }
        self._offsets = np.asarray(encoders.offsets or 0.0)
        self._last = np.zeros(rotors)

    def read(self, frame: SerialFrame) -> Array:
        """Return the angle of each rotor [rad], shape (N,), NaN if it is missing.

        Wrapped readings are assumed to change by less than half a turn since the last valid
        reading of the rotor. Raises ValueError unless there is a reading for each rotor.
        """
        self.check(frame)
        angles = frame.values * self._radians[frame.kind] - self._offsets
        if self._wrapped:
            angles = angles + math.tau * np.round((self._last - angles) / math.tau)
            self._last = np.where(np.isnan(angles), self._last, angles)
        return np.asarray(angles)

    def check(self, frame: SerialFrame) -> None:
        """Raise ValueError unless there is a reading for each rotor."""
        if len(frame.values) != self.rotors:
            raise ValueError(
                f'it has {len(frame.values)} readings for a chain of {self.rotors} rotors; send '
                'one for each rotor, - or NaN if missing, or set chain.number_of_rotors'
            )


class StampedAngles(NamedTuple):
    """Angles of a frame."""

    stamp: int
    """Time of the measurement by the clock of the host [ns]."""
    angles: Array
    """Rotor angles [rad], shape (N,), NaN for a missing angle."""


class AngleStream:
    """Angles of successive frames, with the number of lost frames."""

    def __init__(self, reader: AngleReader) -> None:
        self.clock = DeviceClock()
        """Clock of the controller."""
        self.lost = 0
        """Number of lost frames, from gaps in the frame numbers."""
        self._reader = reader
        self._arrived = 0
        self._numbers: deque[tuple[int, int, int]] = deque(maxlen=_COMPARED_NUMBERS)

    def reset(self) -> None:
        """Prepare for a controller that has restarted."""
        self.clock.reset()
        self._numbers.clear()

    def reconnect(self) -> None:
        """Prepare for a controller that may have restarted while the line was interrupted.

        If the clock is known, the next times show whether it has restarted.
        """
        if math.isnan(self.clock.scatter):
            self.reset()

    def take(self, frame: SerialFrame, arrival: int) -> StampedAngles | None:
        """Return the angles of a frame with its arrival time [ns]; None for a `hello` frame.

        Raises ValueError for a frame that contains no readings, does not match the chain, repeats
        an earlier frame, or has an implausible time.
        """
        if frame.kind is FrameKind.HELLO:
            self.reset()
            return None
        if frame.kind not in READINGS:
            raise ValueError(
                f'{frame.kind.value} are commands to a controller; send counts or radians'
            )
        self._reader.check(frame)
        self._arrived += 1
        restarts = self.clock.restarts
        if frame.time is None:
            stamp = self.clock.stamp_of_arrival(arrival)
        else:
            stamp = self.clock.stamp(frame.time, arrival)
        if self.clock.restarts != restarts:
            self._numbers.clear()
        if frame.sequence is None:
            self._numbers.clear()
        else:
            self._count_lost(frame.sequence)
        return StampedAngles(stamp, self._reader.read(frame))

    def _count_lost(self, number: int) -> None:
        """Count the frames that are missing before a frame number.

        The count is the smallest difference from any of the last few frame numbers, so that a
        wrong frame number has no effect after the next frame. A smaller frame number means that a
        controller without a clock has restarted.
        """
        totals = [
            lost + missing
            for earlier, arrived, lost in self._numbers
            if (missing := (number - earlier - (self._arrived - arrived)) % SEQUENCES)
            < SEQUENCES // 2
        ]
        self.lost = min(totals, default=self.lost)
        self._numbers.append((number, self._arrived, self.lost))
