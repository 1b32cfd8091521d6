# SPDX-License-Identifier: Apache-2.0
"""Shapes of single walls at rest, tabulated as staggered angles over the distance from the centre.

Shapes of kinks, and of anti-kinks for d < 1, are computed for the chain itself. Pinned anti-kinks
(all of spinners, and some of wobbling flippers) have the shape in which they rest, with every
other rotor turned over. Anti-kinks of wobbling flippers that are not pinned have the mirrored
shape of a kink, which is exact in the continuum limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline

from soliton_linkage.estimation.wall_loops import WallTable
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.solitons.anti_kink import anti_kink_path, resting_anti_kink
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons

_POINTS = 16
"""Points of a table per spacing [1]; cubics between them are exact to 1e-5 rad."""
_DEPTHS = 14.0
"""Reach of a table in penetration depths [1]; tails beyond are below 1e-6 rad."""
_ROTORS = 5.0
"""Additional reach for the core, where the depth vanishes [rotor spacings]."""
_DEGREE = 5
"""Degree of the splines through the samples [1]; their slopes are then exact to 1e-5 rad."""


@dataclass(frozen=True)
class WallShape:
    """Shape of one kind of wall."""

    table: WallTable
    sides: Array
    """Angles far to the left and to the right [rad], of even and of odd rotors, shape (2, 2)."""


class WallShapes:
    """Kinks and anti-kinks of a chain, for rotors that turn forwards or backwards."""

    def __init__(self, chain: Chain) -> None:
        """Sample static walls in the middle of a long chain without deviations.

        Raises ValueError and ArithmeticError as `static_wall` does.
        """
        depth = penetration_depth(chain) / chain.spacing
        beside = math.ceil(_DEPTHS * depth + _ROTORS)
        even = beside + beside % 2
        window = replace(
            chain, number_of_rotors=2 * even + 10, periodic=False, deviations=NO_DEVIATIONS
        )
        self.chain = chain
        self.reach = float(beside)
        self._window = window
        self._sites = even + 4 + np.arange(2 * _POINTS) / _POINTS
        self.kinks = tuple(
            self._sampled([static_wall(window, float(site), leg) for site in self._sites])
            for leg in range(2 if chain.motion is Motion.SPINNER else 1)
        )
        """Kink of each leg of the orbit; the rotors of spinners turn forwards in one, backwards in
        the other."""
        found = find_solitons(window, static_wall(window, even + 4.5))
        self.width = found[0].width if found else math.nan
        """Width of a wall at rest [m], NaN if it has no tanh profile."""
        spinner = chain.motion is Motion.SPINNER
        self.stretches = math.isfinite(self.width) and (spinner or chain.lean_ratio < 1)
        """Whether motion changes only the width of a wall."""

    @cached_property
    def anti_kinks(self) -> tuple[WallShape, ...]:
        """Shapes of anti-kinks, computed at the first use because that takes longer."""
        try:
            path = anti_kink_path(self._window, float(self._sites[0]))
        except ArithmeticError:
            return self._pinned()
        if self.chain.lean_ratio < 1:
            return (self._sampled(CubicSpline(*path)(self._sites)),)
        mirrored = np.array([[1.0], [1.0], [-1.0], [-1.0]])
        return (self._shape(np.ascontiguousarray(self.kinks[0].table.angles[:, ::-1] * mirrored)),)

    def of_leg(self, leg: int) -> WallShape:
        """Return the kink of a leg of the orbit."""
        return self.kinks[leg % len(self.kinks)]

    def _pinned(self) -> tuple[WallShape, WallShape]:
        """Return two anti-kinks that are exact at rest, for either parity of the nearest rotor."""
        window = self._window
        site, angles = resting_anti_kink(window, float(self._sites[0]) + 0.5)
        rotors, theta = np.arange(len(angles)), staggered(angles)
        most = round(self.reach)
        grid = np.linspace(-most, most, 2 * most * _POINTS + 1)
        even, odd = (
            PchipInterpolator(rotors[parity::2] - site, np.unwrap(theta[parity::2]))
            for parity in (0, 1)
        )
        both = (even, odd), (odd, even)
        one, other = (
            self._shape(np.array([curve(grid, nu) for nu in (0, 1) for curve in curves]))
            for curves in both
        )
        return one, other

    def _shape(self, angles: Array) -> WallShape:
        return WallShape(WallTable(angles, float(_POINTS), self.reach), angles[:2, [0, -1]])

    def _sampled(self, walls: ArrayLike) -> WallShape:
        """Return the shape of a wall from its states at the sites of the window [rad].

        A rotor samples the wall at finer steps when the wall moves by two spacings, because rotors
        of one parity have the same shape.
        """
        theta = staggered(np.asarray(walls))[:, 1:-1]
        rotors = np.arange(1, theta.shape[1] + 1)
        steps = np.rint((rotors - self._sites[:, None]) * _POINTS).astype(np.int64)
        most = round(self.reach) * _POINTS
        grid = np.arange(-most, most + 1)
        angles, slopes = [], []
        for parity in (0, 1):
            mine = rotors % 2 == parity
            order = np.argsort(steps[:, mine].ravel())
            at = steps[:, mine].ravel()[order] / _POINTS
            curve = make_interp_spline(at, np.unwrap(theta[:, mine].ravel()[order]), k=_DEGREE)
            angles.append(curve(grid / _POINTS))
            slopes.append(curve(grid / _POINTS, nu=1))
        return self._shape(np.array([*angles, *slopes]))
