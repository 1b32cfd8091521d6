# SPDX-License-Identifier: Apache-2.0
"""Conversion of the frames of a controller to rotor angles with time stamps."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.mounting import in_degrees
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.encoders import check_offsets
from soliton_linkage.linkage.quantities import check_quantities, quantity
from soliton_linkage.microcontroller.device_clock import DeviceClock
from soliton_linkage.microcontroller.frames import READINGS, SEQUENCES, FrameKind, SerialFrame

_COMPARED_NUMBERS = 8
"""Number of previous frame numbers with which a new frame number is compared."""


@dataclass(frozen=True)
class RotaryEncoders:
    """Resolution and mounting of encoders.

    A reading of q turns is the angle 2 pi s q - offset [rad], with the sign s of the encoder.
    Raises ValueError for values out of range.
    """

    counts_per_turn: tuple[float, ...] = quantity(
        (4096.0,), 'counts per turn, one value for all encoders or one per rotor [1]'
    )
    signs: tuple[float, ...] = quantity(
        (),
        '1 if readings increase from +z towards +x, else -1; one per rotor; an empty list means 1 '
        'for every rotor [1]',
    )
    offsets: tuple[float, ...] = quantity(
        (), 'reading minus angle [rad], one per rotor; an empty list means 0 for every rotor'
    )
    wrapped: bool = quantity(
        True, 'whether readings wrap after a turn; a turn must then take more than two frames'
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        for counts in self.counts_per_turn:
            if not (math.isfinite(counts) and counts >= 1):
                raise ValueError(f'counts_per_turn = {counts:g} must be 1 or more')
        for sign in self.signs:
            if sign not in (1, -1):
                raise ValueError(f'sign of an encoder = {sign:g} must be 1 or -1')
        check_offsets(self.offsets)

    def check_fit(self, rotors: int) -> None:
        """Raise ValueError if the number of values of a field does not match the rotors."""
        for name, least in (('counts_per_turn', 1), ('signs', 0), ('offsets', 0)):
            given = len(getattr(self, name))
            if given not in (least, rotors):
                raise ValueError(
                    f'{name} has {given} values for a chain of {rotors} rotors; '
                    f'give {least or "none"} or {rotors}'
                )

    def per_radian(self) -> Array:
        """Return the counts per radian of each encoder [1/rad], (1,) or (N,)."""
        return np.asarray(np.asarray(self.signs or 1.0) * self.counts_per_turn / math.tau)


class AngleReader:
    """Conversion of encoder readings to unwrapped rotor angles."""

    def __init__(self, encoders: RotaryEncoders, rotors: int) -> None:
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
        """Return the angle of each rotor [rad], (N,), NaN if missing.

        Raises ValueError if `check` rejects the frame. If readings wrap, a rotor must turn by less
        than half a turn between its valid readings.
        """
        self.check(frame)
        angles = frame.values * self._radians[frame.kind] - self._offsets
        if self._wrapped:
            angles = angles + math.tau * np.round((self._last - angles) / math.tau)
            self._last = np.where(np.isnan(angles), self._last, angles)
        return np.asarray(angles)

    def check(self, frame: SerialFrame) -> None:
        """Raise ValueError unless a frame has one reading per rotor.

        Also raises ValueError for angles that match the chain only if they are degrees.
        """
        if len(frame.values) != self.rotors:
            raise ValueError(
                f'it has {len(frame.values)} readings for a chain of {self.rotors} rotors; send '
                'one for each rotor, - or NaN if missing, or set chain.number_of_rotors'
            )
        if frame.kind is FrameKind.RADIANS and in_degrees(frame.values):
            raise ValueError('its angles look like degrees; send radians')


class StampedAngles(NamedTuple):
    """Time of a measurement by the host's clock [ns], and angles [rad], (N,), NaN if missing."""

    stamp: int
    angles: Array


class AngleStream:
    """Conversion of successive frames to angles, and count of the lost frames."""

    def __init__(self, reader: AngleReader) -> None:
        self.clock = DeviceClock()
        self.lost = 0
        """Number of lost frames, computed from gaps in the frame numbers."""
        self._reader = reader
        self._arrived = 0
        self._numbers: deque[tuple[int, int, int]] = deque(maxlen=_COMPARED_NUMBERS)

    def reset(self) -> None:
        """Prepare for a controller that has restarted."""
        self.clock.reset()
        self._numbers.clear()

    def reconnect(self) -> None:
        """Prepare for a controller that may have restarted.

        The clock is reset if it has not estimated its scatter yet, because until then it cannot
        detect a restart.
        """
        if math.isnan(self.clock.scatter):
            self.reset()

    def take(self, frame: SerialFrame, arrival: int) -> StampedAngles | None:
        """Return the angles of a frame that arrives at `arrival` [ns]; None for a `hello` frame.

        Raises ValueError if the frame contains no readings, belongs to another chain, is repeated,
        or has an implausible time.
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
            stamp = self.clock.stamp(frame.time, arrival, frame.checked)
        if self.clock.restarts != restarts or frame.sequence is None:
            self._numbers.clear()
        if frame.sequence is not None:
            self._count_lost(frame.sequence)
        return StampedAngles(stamp, self._reader.read(frame))

    def _count_lost(self, number: int) -> None:
        """Count lost frames; compare with several previous numbers, because one may be wrong."""
        totals = [
            lost + missing
            for earlier, arrived, lost in self._numbers
            if (missing := (number - earlier - (self._arrived - arrived)) % SEQUENCES)
            < SEQUENCES // 2
        ]
        self.lost = min(totals, default=self.lost)
        self._numbers.append((number, self._arrived, self.lost))
