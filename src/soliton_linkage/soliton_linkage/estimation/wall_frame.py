# SPDX-License-Identifier: Apache-2.0
"""What a frame shows of walls beside their places: energy, swings, turns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from soliton_linkage.estimation.lattice import WallLine
from soliton_linkage.estimation.state_report import FrameErrors, FrameState, StateReporter
from soliton_linkage.linkage.chain import Array, Motion, wrapped
from soliton_linkage.solitons.tanh_fit import order_field


class WallFrame:
    """One frame of a chain, asked where it is of use to know more."""

    def __init__(
        self,
        reporter: StateReporter,
        line: WallLine,
        angles: Array | None,
        rates: Array | None,
        errors: FrameErrors,
    ) -> None:
        """Take angles [rad], None where rotors are not known, and rates [rad/s], shape (N,)."""
        self._reporter, self._chain, self._line = reporter, reporter.chain, line
        self._angles, self._rates, self._errors = angles, rates, errors

    def energy(self, places: Sequence[float]) -> float:
        """Energy within reach of walls at places [rotor spacings], less that of the noise [J].

        NaN where it cannot be told.
        """
        angles, rates = self._angles, self._rates
        if angles is None or rates is None or not np.isfinite(rates).all():
            return math.nan
        return self._reporter.report(angles, places, rates, self._errors).energies.wall

    def swing(self, place: float, lean: int) -> float:
        """Largest swing of a rotor near a place from a uniform state that leans so.

        It is over that to the opposite state [1], and 0 where rotors are not known.
        """
        if self._angles is None:
            return 0.0
        field, _ = order_field(self._chain, self._angles)
        near = self._line.numbers(place - self._line.near, place + self._line.near)
        return float(np.abs(field[near % len(field)] - lean).max() / 2)

    def turn(self, left: float, right: float) -> int:
        """Sense in which a spinner's rotors turn in the left one of two walls, +1 or -1.

        Neighbours are less than half a turn apart from how they are in a uniform state. It is 0
        for flippers, and where rotors are not known.
        """
        chain, line, angles = self._chain, self._line, self._angles
        if angles is None or chain.motion is not Motion.SPINNER:
            return 0
        family = 1 if FrameState(chain, angles).twists > 0 else -1
        middle = left + line.apart(line.between(left, right), left)
        rotors = line.numbers(left - max(line.near, 2.0), middle) % line.rotors
        steps = np.diff((angles - chain.uniform_state(family))[rotors])
        return int(np.sign(np.sum(wrapped(steps))))
