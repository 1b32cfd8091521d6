# SPDX-License-Identifier: Apache-2.0
"""What encoders read, and the angles of the rotors that they sit on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import LARGEST_ANGLE, check_quantities, quantity
from soliton_linkage.microcontroller.frames import FrameKind, SerialFrame

_TURN = 2 * math.pi
"""In radians."""


@dataclass(frozen=True)
class RotaryEncoders:
    """How encoders sit on rotors; raises ValueError for values out of their range.

    With the reading q, in turns, the angle is

        phi = 2 pi sign q - offset.
    """

    counts_per_turn: tuple[float, ...] = quantity(
        (4096.0,), 'counts of a whole turn, one for all encoders or one a rotor [1]'
    )
    signs: tuple[float, ...] = quantity(
        (), '1 where readings grow from +z towards +x, else -1, one a rotor; empty for 1 [1]'
    )
    offsets: tuple[float, ...] = quantity(
        (), 'what angles are constantly too large by, one a rotor; empty for nothing [rad]'
    )
    wrapped: bool = quantity(
        True,
        'whether readings begin anew after a turn, which rotors take more than two frames for',
    )

    def __post_init__(self) -> None:
        """Refuse values out of their range."""
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
        for name, fits in (
            ('counts_per_turn', (1, rotors)),
            ('signs', (0, rotors)),
            ('offsets', (0, rotors)),
        ):
            given = len(getattr(self, name))
            if given not in fits:
                raise ValueError(
                    f'{name} has {given} values for a chain of {rotors} rotors; '
                    f'give {fits[0] or "none"} or {rotors}'
                )

    def per_radian(self) -> Array:
        """Counts that an angle of one radian adds to a reading [1/rad], shape (1,) or (N,)."""
        per_radian: Array = np.asarray(self.signs or 1.0) * self.counts_per_turn / _TURN
        return per_radian


class AngleReader:
    """Turns readings into angles that go on from frame to frame, however often rotors turn."""

    def __init__(self, encoders: RotaryEncoders, rotors: int) -> None:
        """Read a chain of so many rotors; ValueError where the encoders do not fit it."""
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
        """Angle of each rotor [rad], shape (N,), NaN where it is missing.

        Readings that wrap continue those of the last frame in which the rotor was not missing,
        by less than half a turn. Raises ValueError unless there is a reading of each rotor.
        """
        if len(frame.values) != self.rotors:
            raise ValueError(
                f'it has {len(frame.values)} readings for a chain of {self.rotors} rotors; send '
                'one a rotor, - or NaN for a missing one, or set chain.number_of_rotors'
            )
        angles = frame.values * self._radians[frame.kind] - self._offsets
        if self._wrapped:
            angles = angles + _TURN * np.round((self._last - angles) / _TURN)
            self._last = np.where(np.isnan(angles), self._last, angles)
        return np.asarray(angles)
