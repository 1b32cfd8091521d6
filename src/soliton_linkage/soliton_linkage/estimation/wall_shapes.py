# SPDX-License-Identifier: Apache-2.0
"""Shapes of walls at rest, as tables of staggered angles, and compiled fits of these shapes.

Kinks and anti-kinks are computed exactly, at all sites. Many spinners and some wobbling flippers
have pinned anti-kinks, which rest only at certain sites; their shapes are computed at such a site.

The arguments `theta` are staggered angles of successive rotors [rad], NaN if unknown, and `first`
is the index of the first one of these rotors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, PchipInterpolator, make_interp_spline

from soliton_linkage.compiling import (
    b1,
    b1_1d,
    compiled,
    const_f8_1d,
    f8,
    f8_1d,
    f8_2d,
    i8,
    named_tuple,
)
from soliton_linkage.estimation.frames import Flags, wrapped
from soliton_linkage.estimation.measurement import MOST_STEPS
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.solitons.anti_kink import (
    anti_kink_path,
    barrier_speed,
    resting_anti_kink,
)
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage.solitons.tanh_fit import find_solitons

_SCAN_STEP = 0.125
"""Distance between the sites of a scan [rotor spacings]. Every wall is wider than this."""
_LONGEST_STEP = 0.3
"""Largest step of a fit in the site [rotor spacings] and in the stretch [1]."""
_SHORTER = 0.6
"""If two successive steps in the stretch have opposite signs, all later steps of the fit are
multiplied by this [1]. Otherwise, the fits of strong wobbling flippers do not converge."""
_CLOSE = 1e-6
"""A fit ends when its steps in the site [rotor spacings] and in the stretch [1] are both smaller
than this."""
_NARROWEST, _WIDEST = 0.2, 2.0
"""Limits of the stretch: width of a fitted wall divided by the width in the table [1]."""


class WallTable(NamedTuple):
    """Table of the staggered angles of rotors as a function of their distance from a wall."""

    angles: Array
    """Angles of even and of odd rotors [rad], and slopes of even and of odd rotors [rad / rotor
    spacing], at J distances from the wall, shape (4, J)."""
    points: float
    """Number of columns of `angles` per rotor spacing [1]."""
    reach: float
    """Largest tabulated distance on either side of the wall [rotor spacings]."""


_TABLE = named_tuple(WallTable, f8_2d, f8, f8)


@compiled(const_f8_1d, f8, b1_1d)
def find_domains(polarised: Array, cost: float, right: Flags) -> None:
    """Set `right`, shape (B,), to True for bonds in right-leaning domains, and else to False.

    Dynamic programming finds the division into domains with the largest score. The polarisation of
    each bond is limited to the range from -1 to 1 and multiplied by the sign of its domain: +1 if
    right-leaning, -1 if left-leaning. The score is the sum of these products minus `cost` per
    border of two domains.
    """
    count = polarised.size
    # Highest scores up to the current bond: for a left-leaning bond, and for a right-leaning bond.
    leftmost, rightmost = 0.0, 0.0
    from_right = np.empty(count, dtype=np.bool_)
    from_left = np.empty(count, dtype=np.bool_)
    for n in range(count):
        score = min(max(polarised[n], -1.0), 1.0)
        from_right[n] = n > 0 and rightmost - cost > leftmost
        from_left[n] = n > 0 and leftmost - cost > rightmost
        before_left = rightmost - cost if from_right[n] else leftmost
        before_right = leftmost - cost if from_left[n] else rightmost
        leftmost, rightmost = before_left - score, before_right + score
    leans = rightmost >= leftmost
    for n in range(count - 1, -1, -1):
        right[n] = leans
        leans = (not from_left[n]) if leans else from_right[n]


@compiled(_TABLE, i8, f8)
def _shape(table: WallTable, parity: int, x: float) -> tuple[float, float]:
    """Return angle [rad] and slope [rad / rotor spacing] at a distance x [rotor spacings].

    `parity` is 0 for even and 1 for odd rotors.
    """
    angles, points, reach = table
    at = (x + reach) * points
    last = angles.shape[1] - 1
    k = min(max(math.floor(at), 0), last - 1)
    s = min(max(at - k, 0.0), 1.0)
    p, q = angles[parity, k], angles[parity, k + 1]
    u, v = angles[2 + parity, k] / points, angles[2 + parity, k + 1] / points
    bend, twist = 3 * (q - p) - 2 * u - v, 2 * (p - q) + u + v
    angle: float = p + s * (u + s * (bend + s * twist))
    slope: float = (u + s * (2 * bend + 3 * s * twist)) * points if 0 < at < last else 0.0
    return angle, slope


@compiled(const_f8_1d, i8, _TABLE, f8, f8, f8_1d)
def set_residuals(
    theta: Array, first: int, table: WallTable, site: float, stretch: float, residuals: Array
) -> None:
    """Set `residuals` [rad], shape (n,), to `theta` minus the angles of a wall at `site`."""
    for k in range(theta.size):
        n = first + k
        shape, _ = _shape(table, n % 2, (n - site) / stretch)
        residuals[k] = wrapped(theta[k] - shape)


@compiled(const_f8_1d, i8, _TABLE, f8, f8, f8)
def scan_wall(
    theta: Array, first: int, table: WallTable, start: float, beside: float, bound: float
) -> tuple[float, float]:
    """Return the least sum of squared residuals [rad^2] for sites near `start`, and the best site.

    The sites are at most about `beside` [rotor spacings] from `start`. Each squared residual is
    limited to `bound` [rad^2].
    """
    best, least = start, np.inf
    steps = math.ceil(beside / _SCAN_STEP)
    for step in range(-steps, steps + 1):
        site = start + step * _SCAN_STEP
        whole = 0.0
        for k in range(theta.size):
            n = first + k
            shape, _ = _shape(table, n % 2, n - site)
            apart = wrapped(theta[k] - shape)
            if math.isfinite(apart):
                whole += min(apart * apart, bound)
        if whole < least:
            best, least = site, whole
    return least, best


@compiled(const_f8_1d, i8, _TABLE, f8, f8, f8, f8, b1)
def sums_of_fit(
    theta: Array,
    first: int,
    table: WallTable,
    site: float,
    stretch: float,
    variance: float,
    bound: float,
    free: bool,
) -> tuple[float, float, float, float, float]:
    """Return the sums of w p^2, w q^2, w p q, w p x and w q x for `fit_wall`.

    For each rotor, w is its weight, x its residual, and p and q are the derivatives of its angle
    with respect to the site and the stretch of the wall.
    """
    site_information, of_stretch, both, ahead, wider = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(theta.size):
        n = first + k
        x = (n - site) / stretch
        shape, slope = _shape(table, n % 2, x)
        apart = wrapped(theta[k] - shape)
        if not math.isfinite(apart):
            continue
        square = apart * apart / variance
        weight = 1.0 if square < bound * bound else bound * bound / square
        by_site = -slope / stretch
        by_stretch = by_site * x if free else 0.0
        site_information += weight * by_site * by_site
        of_stretch += weight * by_stretch * by_stretch
        both += weight * by_site * by_stretch
        ahead += weight * by_site * apart
        wider += weight * by_stretch * apart
    return site_information, of_stretch, both, ahead, wider


@compiled(const_f8_1d, i8, _TABLE, f8, f8, f8, f8, b1)
def fit_wall(
    theta: Array,
    first: int,
    table: WallTable,
    site: float,
    stretch: float,
    variance: float,
    bound: float,
    free: bool,
) -> tuple[float, float, float, float]:
    """Fit the site and, if `free`, the stretch of a wall by reweighted Gauss-Newton steps.

    `variance` is the variance of a residual [rad^2]; residuals above `bound` standard deviations
    have less weight. Return the site, the stretch, and the information on each of them for a noise
    of 1 rad.
    """
    site_information, of_stretch, last, share = 0.0, 0.0, 0.0, 1.0
    for _ in range(MOST_STEPS):
        site_information, of_stretch, both, ahead, wider = sums_of_fit(
            theta, first, table, site, stretch, variance, bound, free
        )
        determinant = site_information * of_stretch - both * both
        if site_information <= 0:
            break
        step, change = ahead / site_information, 0.0
        if free and determinant > 1e-3 * site_information * of_stretch:
            step = (of_stretch * ahead - both * wider) / determinant
            change = (site_information * wider - both * ahead) / determinant
        share *= _SHORTER if change * last < -0.5 * last * last else 1.0
        last = change
        site += share * min(max(step, -_LONGEST_STEP), _LONGEST_STEP)
        change = share * min(max(change, -_LONGEST_STEP), _LONGEST_STEP)
        stretch = min(max(stretch + change, _NARROWEST), _WIDEST)
        if abs(step) < _CLOSE and abs(change) < _CLOSE:
            break
    return site, stretch, site_information, of_stretch


@compiled(const_f8_1d, f8, i8, _TABLE, f8, f8)
def fit_about(
    angles: Array, span: float, last: int, table: WallTable, site: float, stretch: float
) -> tuple[float, float, tuple[float, float, float, float, float]]:
    """Fit site and stretch to the rotors within `span` of `site`, and return also `sums_of_fit`.

    Rotor 0 and the last rotor, with the number `last`, are not used.
    """
    first, end = max(math.ceil(site - span), 1), min(math.floor(site + span) + 1, last)
    theta = np.empty(max(end - first, 0))
    for k in range(theta.size):
        angle = angles[first + k]
        theta[k] = math.pi - angle if (first + k) % 2 else angle
    site, stretch, _, _ = fit_wall(theta, first, table, site, stretch, 1.0, math.inf, True)
    sums = sums_of_fit(theta, first, table, site, stretch, 1.0, math.inf, True)
    return site, stretch, sums


@compiled(i8, i8, _TABLE, f8, f8)
def tangent_of(first: int, count: int, table: WallTable, site: float, stretch: float) -> Array:
    """Return the derivatives of `count` angles with respect to the site [rad / spacing]."""
    tangent = np.empty(count)
    for k in range(count):
        n = first + k
        _, slope = _shape(table, n % 2, (n - site) / stretch)
        tangent[k] = -slope / stretch
    return tangent


_POINTS = 16
"""Number of points of a table per rotor spacing [1]. The interpolation error is 1e-5 rad."""
_DEPTHS = 14.0
"""Range of a table in penetration depths [1]. Farther away, tails are below 1e-6 rad."""
_ROTORS = 5.0
"""Additional range of a table [rotor spacings], for walls with a penetration depth of 0."""
_DEGREE = 5
"""Degree of the splines through the samples [1]. The error of the slopes is 1e-5 rad."""


@dataclass(frozen=True)
class WallShape:
    """Shape of one kind of wall."""

    table: WallTable
    sides: Array
    """Staggered angles far from the wall [rad], shape (2, 2): even and odd rotors in rows 0 and 1,
    left and right of the wall in columns 0 and 1."""


class WallShapes:
    """Shapes of the kinks and anti-kinks of a chain."""

    def __init__(self, chain: Chain) -> None:
        """Compute kinks in a long uniform chain; raise the same errors as `static_wall`."""
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
        """Shape of the kink in each leg of the orbit; a flipper has one shape for all legs."""
        found = find_solitons(window, static_wall(window, even + 4.5))
        self.width = found[0].width if found else math.nan
        """Width of a wall at rest [m]; NaN if the wall has no tanh profile."""
        spinner = chain.motion is Motion.SPINNER
        self.stretches = math.isfinite(self.width) and (spinner or chain.lean_ratio < 1)

    @cached_property
    def anti_kinks(self) -> tuple[WallShape, ...]:
        """Shapes of anti-kinks, computed at the first use because the computation is slow."""
        if self._path is None:
            return self._pinned()
        shape = self._sampled(CubicSpline(*self._path)(self._sites))
        if self.chain.motion is not Motion.SPINNER:
            return (shape,)
        # The even rotors of a spinner may turn in either direction.
        return shape, self._shape(shape.table.angles[[1, 0, 3, 2]])

    @cached_property
    def _path(self) -> tuple[Array, Array] | None:
        """Result of `anti_kink_path`; None if anti-kinks are pinned."""
        try:
            return anti_kink_path(self._window, float(self._sites[0]))
        except ArithmeticError:
            return None

    @cached_property
    def _resting(self) -> tuple[float, Array]:
        return resting_anti_kink(self._window, float(self._sites[0]) + 0.5)

    @cached_property
    def pinning_speed(self) -> float:
        """Least speed at which an anti-kink passes from site to site [spacings/s].

        It is set to 0 if anti-kinks are pinned, because it is then not computed.
        """
        return 0.0 if self._path is None else barrier_speed(self._window, *self._path)

    @property
    def rest_site(self) -> float:
        """Site at which a pinned anti-kink rests, modulo 1 [rotor spacings]; NaN if not pinned."""
        return math.nan if self._path is not None else self._resting[0] % 1

    def of_leg(self, leg: int) -> WallShape:
        """Return the shape of the kink in a leg of the orbit."""
        return self.kinks[leg % len(self.kinks)]

    def _pinned(self) -> tuple[WallShape, WallShape]:
        site, angles = self._resting
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
