# SPDX-License-Identifier: Apache-2.0
"""Orbit of a chain of any length without deviations, composed from the orbit of a short chain.

The passage of the wall over two rotors in the middle of the short chain repeats in a longer chain,
each time shifted by two rotors. The orbit of the short chain is integrated from the middle of each
even leg, through the reflection at the last rotor, to the middle of the next leg. The other parts
of the orbit are mirror images of these parts. `static_wall` defines the site coordinate.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import OdeSolution
from scipy.interpolate import BSpline, CubicSpline, make_interp_spline
from scipy.optimize import brentq

from soliton_linkage.compiling import compiled, const_f8_1d, const_f8_2d, f8, f8_1d, i8
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_bands, zero_mode
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment, PiecewiseCubic
from soliton_linkage.solitons.static_wall import follow_zero_mode, site_arc, static_wall

_DEPTHS_BESIDE = 15
"""Smallest distance of the edges of the short chain from its middle [penetration depths]. The
penetration depth is the distance over which the zero mode decays by the factor e. At 15 depths,
the edges change the angles of a wall in the middle by less than 1e-6 rad."""
_ROTORS_BESIDE = 6
"""Number of rotors that are added on each side of the middle to the distance `_DEPTHS_BESIDE` [1],
because the penetration depth can be close to 0."""
_TOLERANCE = 1e-9
"""Largest error norm of a solver step [rad]. With this tolerance, the errors of the orbit are
below 1e-6 rad."""
_SAMPLES_A_STEP = 3
"""Number of spline points per solver step [1]. With 3 points, the errors of the spline are smaller
than the errors of the solver."""
_DEPTHS_OF_EDGE = 8.0
"""Largest distance from an edge at which the effect of the edge on the site coordinate is computed
[penetration depths]; two rotor spacings are added. At larger distances, changes of the site and
changes of the arc length are proportional, with a relative error of e^-16."""
_SAMPLES_A_SITE = 16
"""Number of points per rotor spacing at which the site coordinate is computed near an edge [1]. If
the penetration depth exceeds the spacing, this is the number per penetration depth. With this
number, the errors of sites are 1e-6 rotor spacings."""
_STEP = 1e-5
"""Step of the site in the numerical derivative of the angles of a wall [rotor spacings]."""
_SHORT = 0.3
"""The last two solver steps of an integrated part of the orbit are merged if the last step is
shorter than this fraction of the step before [1]. Otherwise the spline would oscillate."""
_EXACT = 1e-12
"""The Newton search for the arc length at a site ends when a step is smaller than this [rad]."""
_STEPS = 20
"""Largest number of Newton steps in the search for the arc length at a site [1]."""
_DEGREE = 7
"""Degree of the spline [1], one less than the order of the solver."""


class UniformOrbit(Orbit):
    """Orbit of a chain without deviations; deviations of the given chain are ignored.

    Angles have errors below 1e-6 rad. The computation takes less than a second, except for a lean
    ratio d close to the critical lean ratio d_c and for walls wider than 1000 rotors. Raises the
    errors of the function `static_wall.site_arc`, and ValueError for two rotors or periodic ends.
    """

    def __init__(self, chain: Chain) -> None:
        if chain.number_of_rotors < 3 or chain.periodic:
            raise ValueError(
                f'a chain of {chain.number_of_rotors} rotors with '
                f'{"periodic" if chain.periodic else "free"} ends has no orbit of a wall; give it '
                '3 rotors or more and free ends'
            )
        self.chain = replace(chain, deviations=NO_DEVIATIONS)
        self.number_of_legs = 2 if chain.motion is Motion.SPINNER else 4
        self.site_arc = site_arc(chain)
        # The edges of the short chain do not affect a wall in its middle. Chains that differ only
        # in masses, springs or motors have the same short chain, whose orbit is computed once and
        # cached.
        depth = penetration_depth(chain) / chain.spacing
        beside = math.ceil(_DEPTHS_BESIDE * depth) + _ROTORS_BESIDE
        shortest = min(chain.number_of_rotors, 2 * beside + chain.number_of_rotors % 2)
        self._short = Chain(shortest, chain.spacing, chain.rotor_length, chain.rest_angle)
        self._repeats = (chain.number_of_rotors - self._short.number_of_rotors) // 2
        self._orbit = _short_orbit(self._short, self.number_of_legs)
        reflections = self._orbit.reflections
        begins = [reflections[-1] - self._orbit.length, *reflections[:-1]]
        extra = 2 * self._repeats * self.site_arc
        inner = np.diff([begins[0], *reflections])
        self._starts = [0.0, *np.cumsum(inner + extra).tolist()]
        before = np.subtract(self._orbit.middles[:-1], begins)
        half = self._repeats * self.site_arc
        self._halfway: list[float] = (self._starts[:-1] + before + half).tolist()
        self._legs = np.array([self._starts[:-1], begins, before])
        self._last = chain.number_of_rotors - 1.0

    @property
    def wall_extent(self) -> float:
        """Upper bound of the arc length during which one rotor moves [rad]; see `Orbit`."""
        swing = self._starts[1] - (self.chain.number_of_rotors - 1) * self.site_arc
        return self._short.number_of_rotors * self.site_arc + swing

    def site(self, arc: float) -> float:
        """Return the site of the wall at an arc length, from 0 to N - 1 [rotor spacings]."""
        site = self._site(arc % self._starts[-1], self.leg(arc))[0]
        return 0.0 if site < 0 else min(site, self._last)

    def arc_at(self, site: float, leg: int) -> float:
        """Return the arc length [rad] in a leg at which the wall is at a site; see `Orbit`."""
        way = 1 if leg % 2 == 0 else -1
        arc = self._halfway[leg] + way * (site - self.middle) * self.site_arc
        for _ in range(_STEPS):
            found, slope = self._site(arc, leg)
            step = (site - found) / slope
            arc += step
            if abs(step) < _EXACT:
                break
        return arc

    def site_arc_at(self, arc: float) -> float:
        """Return |ds / d(site)|, the arc length per rotor spacing, at an arc length s [rad]."""
        return abs(1 / self._site(arc % self._starts[-1], self.leg(arc))[1])

    def _site(self, arc: float, leg: int) -> tuple[float, float]:
        forward = leg % 2 == 0
        way = (1 if forward else -1) / self.site_arc
        site = self.middle + way * (arc - self._halfway[leg])
        at_first = bool(site < self.middle)
        from_edge = site if at_first else self._last - site
        distance, slope = self._orbit.edges[leg][at_first].at(from_edge)
        return distance if at_first else self._last - distance, way * slope

    def segment(self, arc: float) -> OrbitSegment:
        """Return angles and tangent of the rotors near the wall at an arc length [rad]."""
        short, rotors = self._orbit, self._short.number_of_rotors
        long = arc % self._starts[-1], self._legs, self._repeats, self.site_arc
        values = np.empty(2 * rotors)
        series = short.length, short.knots, short.coefficients
        first, low, high = set_near_wall(*long, *series, values)
        return OrbitSegment(first, values[low:high], values[rotors + low : rotors + high])

    def background(self, arc: float) -> tuple[Array, Array]:
        """Return the angles on the left and on the right of the wall [rad]; see `Orbit`."""
        left, right = self.chain.uniform_state(1), self.chain.uniform_state(-1)
        if self.chain.motion is Motion.SPINNER:
            right = self.chain.uniform_state(1) + math.pi
        edges = self._orbit.walls[self.leg(arc)]
        left[0], right[-1] = edges[0], edges[-1]
        return left, right


class _HalfLegs(NamedTuple):
    """Samples of the part of the orbit from the middle of one leg to the middle of the next."""

    arcs: Array
    """Arc length of each of the K samples, counted from the first one [rad], shape (K,)."""
    angles: Array
    """Actual (not staggered) angles [rad], without jumps of 2 pi, shape (K, N)."""
    tangents: Array
    """Derivative of the angles with respect to the arc length [1], shape (K, N)."""

    def mirrored(self, chain: Chain) -> _HalfLegs:
        """Return the mirror image, n -> N - 1 - n and phi -> -phi, sorted along the orbit.

        The mirror images of spinners with odd N and of flippers with even N would be upside down.
        Therefore, they are also turned over, phi -> pi - phi.
        """
        spinner, odd = chain.motion is Motion.SPINNER, chain.number_of_rotors % 2 == 1
        angles, tangents = self.angles[:, ::-1], self.tangents[:, ::-1]
        if spinner and odd:
            return _HalfLegs(self.arcs, angles + math.pi, tangents)
        arcs = self.arcs[-1] - self.arcs[::-1]
        if spinner or odd:
            return _HalfLegs(arcs, -angles[::-1], tangents[::-1])
        return _HalfLegs(arcs, angles[::-1] + math.pi, -tangents[::-1])


class _ShortOrbit:
    """Orbit of a short chain as a spline in the arc length, starting in the middle of leg 0."""

    def __init__(self, chain: Chain, legs: int) -> None:
        self._chain = chain
        middle = (chain.number_of_rotors - 1) / 2
        self.walls = [static_wall(chain, middle, leg) for leg in range(legs)]
        forwards = mode_towards_last(chain, self.walls[0]) @ zero_mode(chain, self.walls[0])
        self._sense = math.copysign(1.0, forwards)
        pieces = self._pieces()
        ends = np.cumsum([piece.arcs[-1] for piece in pieces])
        self.middles: list[float] = [0.0, *ends.tolist()]
        self.length: float = self.middles[-1]
        self._spline = _closed_spline(pieces, self.middles)
        self.knots: Array = np.ascontiguousarray(self._spline.t)
        self.coefficients: Array = np.ascontiguousarray(self._spline.c)
        self.reflections = [
            float(brentq(self._rate, *self.middles[leg : leg + 2], args=(leg,), xtol=1e-12))
            for leg in range(legs)
        ]
        depth = penetration_depth(chain) / chain.spacing
        reach = min(middle, 2 + _DEPTHS_OF_EDGE * depth)
        count = math.ceil(_SAMPLES_A_SITE * reach / max(depth, 1.0)) + 3
        distances = np.linspace(0.0, reach, count)
        last = [self._speeds_near_last(distances, leg) for leg in range(legs)]
        first = [last[self._mirrored(leg)] for leg in range(legs)]
        sides = (False, last), (True, first)
        self.edges = [
            [self._edge(leg, at_first, speeds[leg], distances) for at_first, speeds in sides]
            for leg in range(legs)
        ]
        """Two functions for each leg: the first one belongs to the last rotor, and the second one
        to the first rotor. Each function returns the distance of the wall from its rotor [rotor
        spacings]. The argument of each function is the distance that would result if site and arc
        length were proportional."""

    def _mirrored(self, leg: int) -> int:
        """Return the leg to which the mirror image of a wall in `leg` belongs."""
        if self._chain.motion is Motion.SPINNER:
            return 1 - leg if self._chain.number_of_rotors % 2 else leg
        return (-leg if self._chain.lean_ratio <= 1 else 2 - leg) % 4

    def _speeds_near_last(self, distances: Array, leg: int) -> Array:
        """Return |ds / d(site)| [rad] of walls at distances from the last rotor [spacings]."""
        chain, last, speeds = self._chain, self._chain.number_of_rotors - 1, []
        for distance in np.maximum(distances, _STEP).tolist():
            walls = [static_wall(chain, last - distance + step, leg) for step in (-_STEP, _STEP)]
            speeds.append(float(np.linalg.norm(wrapped(walls[1] - walls[0]))) / (2 * _STEP))
        return np.array(speeds)

    def _edge(self, leg: int, at_first: bool, speeds: Array, distances: Array) -> PiecewiseCubic:
        """Return an element of `edges`; `speeds` [rad] are |ds / d(site)| at the `distances`."""
        chain, last, reach = self._chain, self._chain.number_of_rotors - 1, distances[-1]
        way = CubicSpline(distances, speeds / site_arc(chain)).antiderivative()
        without = reach + way(distances) - way(reach)
        # Some walls of flippers are reflected before they reach the edge rotor.
        begin = self.reflections[leg - 1] - (self.length if leg == 0 else 0.0)
        begins = at_first == (leg % 2 == 0)
        end = self.middles[leg] - begin if begins else self.reflections[leg] - self.middles[leg]
        first = int(np.searchsorted(without, last / 2 - end / site_arc(chain)))
        far = (1, 1.0) if reach < last / 2 else 'not-a-knot'
        ends = 'not-a-knot', far
        return PiecewiseCubic(CubicSpline(without[first:], distances[first:], bc_type=ends))

    def _tangent(self, angles: Array) -> Array:
        return self._sense * zero_mode(self._chain, angles)

    def _pieces(self) -> list[_HalfLegs]:
        """Return the pieces of the orbit in order; each ends in the middle of the next leg.

        The pieces with a reflection at the last rotor are integrated. Their mirror images are the
        pieces with a reflection at the first rotor. Mirroring exchanges the first and the last
        rotor. In a flipper, it thereby exchanges the two legs in which only one edge rotor is
        toggled (see `static_wall`): legs 1 and 3 for a lean ratio d <= 1, legs 0 and 2 for d > 1.
        """
        legs = len(self.walls)
        last = [self._followed(leg) for leg in range(0, legs, 2)]
        first = [piece.mirrored(self._chain) for piece in last]
        if self._chain.lean_ratio <= 1:
            first.reverse()
        return [piece for both in zip(last, first, strict=True) for piece in both]

    def _followed(self, leg: int) -> _HalfLegs:
        start, goal = self.walls[leg], self.walls[(leg + 1) % len(self.walls)]
        tolerances = _TOLERANCE / 1e3, _TOLERANCE / math.sqrt(len(start))
        begins, ends, pieces = zip(
            *follow_zero_mode(self._chain, self._tangent, start, goal, tolerances), strict=True
        )
        solution = OdeSolution([0.0, *ends], list(pieces))
        # A last step that is much shorter than the others would make the spline oscillate.
        bounds = [*begins, ends[-1]]
        if len(bounds) > 2 and bounds[-1] - bounds[-2] < _SHORT * (bounds[-2] - bounds[-3]):
            del bounds[-2]
        steps = [np.linspace(*each, _SAMPLES_A_STEP + 1)[1:] for each in pairwise(bounds)]
        arcs = np.concatenate([np.zeros(1), *steps])
        angles = solution(arcs).T
        angles[0] = start
        return _HalfLegs(arcs, angles, np.array([self._tangent(each) for each in angles]))

    def _rate(self, arc: float, leg: int) -> float:
        """Return a quantity that changes its sign where the wall is reflected at the end of `leg`.

        In a flipper, the quantity is the lever of the edge rotor at which the leg ends. In a
        spinner, it is the derivative of sum_n sin(phi_n) with respect to the arc length.
        """
        angles, tangent = np.split(np.asarray(self._spline(arc)), 2)
        if self._chain.motion is Motion.SPINNER:
            return float(np.cos(angles) @ tangent)
        first, second = rigidity_bands(self._chain, angles)
        return float(second[-1] if leg % 2 == 0 else first[0])


_short_orbit = lru_cache(maxsize=64)(_ShortOrbit)


def _closed_spline(pieces: list[_HalfLegs], middles: list[float]) -> BSpline:
    """Return a closed spline of angles and tangents; its pieces begin at `middles` [rad]."""
    arcs, rows, end = [], [], pieces[0].angles[0]
    for piece, middle in zip(pieces, middles[:-1], strict=True):
        turns = 2 * math.pi * np.round((end - piece.angles[0]) / (2 * math.pi))
        arcs.append(middle + piece.arcs[:-1])
        rows.append(np.hstack([piece.angles + turns, piece.tangents])[:-1])
        end = piece.angles[-1] + turns
    around, samples = np.concatenate(arcs), np.concatenate(rows)
    turned = np.zeros(samples.shape[1])
    turned[: len(end)] = 2 * math.pi * np.round((end - pieces[0].angles[0]) / (2 * math.pi))
    closed = (
        np.concatenate([each[-_DEGREE - 1 :] - period, each, each[: _DEGREE + 1] + period])
        for each, period in ((around, middles[-1]), (samples, turned))
    )
    return make_interp_spline(*closed, k=_DEGREE)


@compiled(const_f8_1d, const_f8_2d, f8, f8_1d)
def spline(knots: Array, coefficients: Array, at: float, values: Array) -> None:
    """Set `values`, shape (M,), to the values of M B-splines at the position `at`.

    The splines have the same `knots`. Each column of `coefficients`, shape (K, M), belongs to one
    spline. For a single position, this recursion of Cox and de Boor is ten times as fast as scipy.
    """
    high = coefficients.shape[0]
    low = degree = knots.size - high - 1
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= at:
            low = middle
        else:
            high = middle
    basis = np.zeros(degree + 1)
    basis[0] = 1.0
    for order in range(1, degree + 1):
        saved = 0.0
        for n in range(order):
            right, left = knots[low + n + 1], knots[low + 1 + n - order]
            part = basis[n] / (right - left)
            basis[n] = saved + (right - at) * part
            saved = (at - left) * part
        basis[order] = saved
    for column in range(values.size):
        value = 0.0
        for n in range(degree + 1):
            value += basis[n] * coefficients[low - degree + n, column]
        values[column] = value


@compiled(f8, const_f8_2d, i8, f8, f8, const_f8_1d, const_f8_2d, f8_1d)
def set_near_wall(
    arc: float,
    legs: Array,
    repeats: int,
    site_arc: float,
    length: float,
    knots: Array,
    coefficients: Array,
    values: Array,
) -> tuple[int, int, int]:
    """Set the angles and tangents of the rotors near a wall in a long chain, from a short chain.

    `arc` [rad] is an arc length on the orbit of the long chain, which has 2 * `repeats` rotors
    more than the short chain. `site_arc` [rad] is the arc length per rotor spacing. The orbit of
    the short chain has the length `length` [rad] and is a spline with `knots` and `coefficients`.
    `legs` [rad] has a column with three elements for each leg: the start of the leg on the long
    orbit, its start on the short orbit, and the arc length from the start to the middle of the leg
    on the short orbit.

    The function sets `values` to the angles [rad], followed by the tangents [1], of all rotors of
    the short chain. It returns three numbers: first, low and high. The rotors low to high - 1 of
    the short chain correspond to rotor `first` and the next rotors of the long chain.
    """
    leg = legs.shape[1] - 1
    while leg > 0 and arc < legs[0, leg]:
        leg -= 1
    beyond = arc - legs[0, leg]
    passed = math.floor((beyond - legs[2, leg]) / (2 * site_arc))
    passed = min(max(passed, 0), repeats)
    offset = 2 * (passed if leg % 2 == 0 else repeats - passed)
    within = (legs[1, leg] + beyond - 2 * passed * site_arc) % length
    spline(knots, coefficients, within, values)
    # An edge rotor of the short chain corresponds only to an edge rotor of the long chain.
    low = 0 if offset == 0 else 1
    end = values.size // 2
    high = end if offset == 2 * repeats else end - 1
    return offset + low, low, high
