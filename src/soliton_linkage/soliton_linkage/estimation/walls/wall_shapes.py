# SPDX-License-Identifier: Apache-2.0
"""Shapes of single walls at rest, as tables of staggered angles by the distance from the centre.

That of a kink is the chain's own, from its orbit. An anti-kink has nearly the same, seen in a
mirror: exactly so in the continuum, and with the same centre, as flippers' walls are odd.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.tanh_fit import find_solitons

_POINTS = 16
"""Of a table in a spacing [1]: cubics between them are exact to 1e-5 rad."""
_DEPTHS = 14.0
"""Reach of a table in penetration depths [1]: tails beyond are below 1e-6 rad."""
_ROTORS = 5.0
"""And as many more [rotor spacings], for the core where the depth goes to 0."""


@dataclass(frozen=True)
class WallShape:
    """One kind of wall."""

    table: Array
    """Angles of even and odd rotors [rad], and their slopes [rad a spacing], shape (4, J)."""
    sides: Array
    """Angles far on the left and on the right [rad], of even and of odd rotors, shape (2, 2)."""


class WallShapes:
    """Kinks and anti-kinks of a chain, whose rotors turn forwards or backwards."""

    def __init__(self, chain: Chain, known: Orbit | None = None) -> None:
        """Sample the orbit of the chain that is known, or of a shorter one that takes a while.

        Raises ValueError and ArithmeticError where there is none.
        """
        depth = penetration_depth(chain) / chain.spacing
        beside = math.ceil(_DEPTHS * depth + _ROTORS)
        fewest = 2 * (beside + 4)
        if isinstance(known, UniformOrbit) and known.chain.number_of_rotors >= fewest:
            orbit = known
        else:
            orbit = UniformOrbit(
                replace(chain, number_of_rotors=fewest, periodic=False, deviations=NO_DEVIATIONS)
            )
        self.points, self.reach = float(_POINTS), float(beside)
        self._shapes: dict[tuple[int, int], WallShape] = {}
        for leg in range(orbit.number_of_legs if chain.motion is Motion.SPINNER else 1):
            kink, turn = self._sampled(orbit, leg)
            mirrored = kink[:, ::-1] * np.array([[1.0], [1.0], [-1.0], [-1.0]])
            for charge, table in ((1, kink), (-1, mirrored)):
                table = np.ascontiguousarray(table)
                sides = table[:2, [0, -1]]
                self._shapes[charge, turn * charge] = WallShape(table, sides)
        middle = orbit.configuration(orbit.arc_at(orbit.middle, 0))
        found = find_solitons(orbit.chain, middle)
        self.width = found[0].width if found else math.nan
        """Of a wall at rest [m], NaN where it has no such profile."""
        spinner = chain.motion is Motion.SPINNER
        self.stretches = math.isfinite(self.width) and (spinner or chain.lean_ratio < 1)
        """Whether walls that move have the same shape, but narrower."""

    def __call__(self, charge: int, turn: int) -> WallShape:
        """The wall of a charge whose rotors turn forwards (+1) or backwards, 0 for flippers."""
        return self._shapes[charge, turn]

    def _sampled(self, orbit: UniformOrbit, leg: int) -> tuple[Array, int]:
        """Table of the kink of a leg, and the sense in which its rotors turn."""
        chain, count = orbit.chain, int(2 * self.reach) * _POINTS + 1
        table = np.empty((4, count))
        centre = 2 * round(orbit.middle / 2)
        for step in range(2 * _POINTS):
            # The wall is at centre + step / points; even rotors show each other x by even steps.
            place = centre + step / _POINTS
            arc = orbit.arc_at(place, leg)
            theta = staggered(orbit.configuration(arc))
            slopes = -orbit.tangent(arc) * orbit.site_arc * (1 - 2 * (leg % 2))
            slopes[1::2] *= -1
            for parity in (0, 1):
                self._enter(table, parity, place, theta, slopes)
        angles = orbit.configuration(orbit.arc_at(orbit.middle, leg))
        steps = wrapped(np.diff(angles - chain.uniform_state(1)))
        turn = int(np.sign(steps[1:-1].sum())) if chain.motion is Motion.SPINNER else 0
        for row in (0, 1):
            table[row] = np.unwrap(table[row])
        return table, turn

    def _enter(self, table: Array, parity: int, place: float, theta: Array, slopes: Array) -> None:
        """Enter rotors of a parity of a wall at a place into a table."""
        near = math.floor(place - self.reach) - 1
        for n in range(max(near + (near - parity) % 2, parity), len(theta), 2):
            column = round((n - place + self.reach) * _POINTS)
            if column >= table.shape[1]:
                break
            if column >= 0:
                table[parity, column] = theta[n]
                table[2 + parity, column] = slopes[n]
