# SPDX-License-Identifier: Apache-2.0
"""Orbit of a chain with known deviations of its rotors and springs.

The uniform chain is the same chain without deviations. By definition, corresponding configurations
of the two chains have the same site coordinate. Let t be the zero mode of a configuration. Bond n,
between the rotors n and n + 1, halves the configuration if rotors 0 to n contribute half of the
sum of all t_j^2. A configuration of one chain corresponds to a configuration of the other chain if
the same bond halves both, and if both are in the same leg (see `Orbit`). The ends of the legs also
correspond. A monotonic cubic spline through these pairs of configurations converts the arc length
of one orbit to the arc length of the other. In the whole orbit, the springs keep their rest
lengths; such springs are called bars.
"""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment, PiecewiseCubic
from soliton_linkage.orbit.orbit_pieces import OrbitPiece, orbit_pieces
from soliton_linkage.orbit.seed_path import blocked_wall_error
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_SAMPLES_A_SITE = 4
"""Number of sampled positions of the wall per rotor, in the search for the positions at which a
bond halves the configuration [1]."""
_SAME_MODE = 1 - 1e-6
"""In the middle of each piece of the orbit (see `orbit_pieces`), the absolute scalar product of
the tangent and the zero mode of the whole chain must exceed this [1]. The tangent contains only
rotors near the wall. If the product is smaller, a rotor far from the wall also moves, and the
orbit is rejected."""


def orbit_of(chain: Chain) -> Orbit:
    """Return the `DeviatingOrbit` of a chain with deviations, otherwise the `UniformOrbit`.

    Raises the errors of these classes.
    """
    return UniformOrbit(chain) if chain.deviations == NO_DEVIATIONS else DeviatingOrbit(chain)


class DeviatingOrbit(Orbit):
    """Orbit of a chain with deviations of its rotors and springs from the uniform chain.

    In all configurations of the orbit, the relative error of the bar lengths is at most 1e-9. The
    time and the memory of the computation are proportional to N. Raises the errors of
    `UniformOrbit` and `orbit_pieces`, and ValueError if the wall is reflected inside the chain.
    """

    def __init__(self, chain: Chain) -> None:
        self._uniform = UniformOrbit(chain)
        self.chain = chain
        self.number_of_legs = self._uniform.number_of_legs
        self._pieces = orbit_pieces(chain)
        self._ends: list[float] = np.cumsum([piece.length for piece in self._pieces]).tolist()
        self._origin = 0.0
        self._starts = [0.0, self._ends[-1]]
        reflections = self._reflections()
        self._origin = reflections[-1] - self.length
        self._starts = [0.0, *(arc - self._origin for arc in reflections)]
        legs = range(self.number_of_legs)
        self._backgrounds = [self._relaxed(leg) for leg in legs]
        self._check()
        self._uniform_arc = _ArcMap(self, self._uniform)
        ends = 0.5, chain.number_of_rotors - 1.5
        own, uniform = (
            sum(abs(orbit.arc_at(ends[1], leg) - orbit.arc_at(ends[0], leg)) for leg in legs)
            for orbit in (self, self._uniform)
        )
        self.site_arc = self._uniform.site_arc * own / uniform

    @property
    def wall_extent(self) -> float:
        """Estimate of the bound that `Orbit.wall_extent` defines [rad]."""
        return self._uniform.wall_extent * self.site_arc / self._uniform.site_arc

    def site(self, arc: float) -> float:
        """Return the site of the wall at an arc length, from 0 to N - 1 [rotor spacings]."""
        return self._uniform.site(self._uniform_arc.at(arc % self.length)[0])

    def arc_at(self, site: float, leg: int) -> float:
        """Return the arc length [rad] in a leg at which the wall is at a site; see `Orbit`."""
        uniform_arc = self._uniform.arc_at(site, leg)
        begin, end = self._uniform.leg_arcs(leg)
        within = min(max(uniform_arc, begin), end)
        return self._uniform_arc.inverse(within) + (uniform_arc - within)

    def site_arc_at(self, arc: float) -> float:
        """Return |ds / d(site)|, the arc length per rotor spacing, at an arc length s [rad]."""
        uniform_arc, slope = self._uniform_arc.at(arc % self.length)
        return self._uniform.site_arc_at(uniform_arc) / slope

    def segment(self, arc: float) -> OrbitSegment:
        """Return angles and tangent of the rotors near the wall at an arc length [rad]."""
        within = (arc + self._origin) % self._ends[-1]
        number = min(bisect_right(self._ends, within), len(self._ends) - 1)
        piece = self._pieces[number]
        values = piece.at(within - self._ends[number] + piece.length)
        return OrbitSegment(piece.first, values[: piece.rotors], values[piece.rotors :])

    def background(self, arc: float) -> tuple[Array, Array]:
        """Return the angles on the left and on the right of the wall [rad]; see `Orbit`."""
        left, right = self._backgrounds[self.leg(arc)]
        return left.copy(), right.copy()

    def _reflections(self) -> list[float]:
        """Return the arc lengths at which legs end [rad].

        These arc lengths count from the start of the first piece, in the middle of leg 0 (see
        `orbit_pieces`). In a flipper, a leg ends where the edge rotor and its bar are collinear,
        because the rotor next to the edge then reverses its rotation. In a spinner, a leg ends at
        an extremum of sum_n sin(phi_n).
        """
        last = self.chain.number_of_rotors - 1
        spinner = self.chain.motion is Motion.SPINNER
        found: list[float] = []
        following = [*self._pieces[1:], self._pieces[0]]
        for piece, after, end in zip(self._pieces, following, self._ends, strict=True):
            if not spinner and piece.seed not in (0, last):
                continue
            rotor = None if spinner else -2 if piece.seed == last else 1
            within = spinner or after.seed == piece.seed
            rate = _rate(0.0, after, rotor) if within else _rate(piece.length, piece, rotor)
            begins, ends = (_rate(arc, piece, rotor) > 0 for arc in (0.0, piece.length))
            if begins != (rate > 0):
                reversal = piece.length
                if begins != ends:
                    reversal = brentq(_rate, 0, piece.length, args=(piece, rotor), xtol=1e-14)
                found.append(end - piece.length + float(reversal))
        if len(found) != self.number_of_legs:
            number = bisect_right(self._ends, found[0] if found else 0.0)
            raise blocked_wall_error(self.chain, self._pieces[number].seed)
        return found

    def _check(self) -> None:
        for piece, end in zip(self._pieces, self._ends, strict=True):
            arc = end - piece.length / 2 - self._origin
            mode = zero_mode(self.chain, self.configuration(arc))
            tangent = np.split(piece.at(piece.length / 2), 2)[1]
            near = mode[piece.first : piece.first + piece.rotors]
            if not abs(float(near @ tangent)) > _SAME_MODE:
                raise blocked_wall_error(self.chain, piece.seed)

    def _relaxed(self, leg: int) -> tuple[Array, Array]:
        last = self.chain.number_of_rotors - 1
        left, right = self._uniform.background(self._uniform.leg_arcs(leg)[0])
        begin, end = self.leg_arcs(leg)
        at_last, at_first = (end, begin) if leg % 2 == 0 else (begin, end)
        arcs = sorted((arc - self._origin) % self.length for arc in self._ends)
        inner = [arc for arc in arcs if begin < arc < end]
        if leg % 2 == 1:
            inner.reverse()
        return (
            self._left_behind([*inner, self._nearest(last, float(left[-1]), at_last)]),
            self._left_behind([*inner[::-1], self._nearest(0, float(right[0]), at_first)]),
        )

    def _left_behind(self, arcs: list[float]) -> Array:
        angles = np.empty(self.chain.number_of_rotors)
        for arc in arcs:
            segment = self.segment(arc)
            angles[segment.within] = segment.angles
        return angles

    def _nearest(self, rotor: int, angle: float, turning: float) -> float:
        """Return the arc length [rad] at which an edge rotor is nearest to `angle` [rad].

        The search includes the pieces around the arc length `turning` [rad], at which the wall is
        reflected at this rotor.
        """
        pieces, count = self._pieces, len(self._pieces)
        number = bisect_right(self._ends, (turning + self._origin) % self._ends[-1]) % count
        column = 0 if rotor == 0 else -1
        low = high = number
        while pieces[low - 1].seed == rotor:
            low -= 1
        while pieces[(high + 1) % count].seed == rotor:
            high += 1
        nearest = math.pi, 0.0
        for n in range(low, high + 1):
            piece = pieces[n % count]
            begin = self._ends[n % count] - piece.length - self._origin
            away = [_difference(arc, piece, column, angle) for arc in (0.0, piece.length)]
            if away[0] * away[1] < 0 and abs(away[0] - away[1]) < math.pi:
                arguments = (piece, column, angle)
                return begin + float(brentq(_difference, 0, piece.length, args=arguments))
            nearest = min(nearest, (abs(away[0]), begin), (abs(away[1]), begin + piece.length))
        return nearest[1]


def _difference(arc: float, piece: OrbitPiece, column: int, angle: float) -> float:
    return math.remainder(float(piece.at(arc)[: piece.rotors][column]) - angle, 2 * math.pi)


def _rate(arc: float, piece: OrbitPiece, rotor: int | None) -> float:
    angles, tangent = np.split(piece.at(arc), 2)
    return float(np.cos(angles) @ tangent) if rotor is None else float(tangent[rotor])


class _ArcMap(PiecewiseCubic):
    """Smooth, increasing map from arc lengths of an orbit to arc lengths of the uniform orbit."""

    def __init__(self, orbit: Orbit, uniform: UniformOrbit) -> None:
        arcs: list[float] = []
        uniform_arcs: list[float] = []
        for leg in range(orbit.number_of_legs):
            here, there = (_arcs_at_bonds(each, leg)[:: (-1) ** leg] for each in (orbit, uniform))
            kept = np.isfinite(here) & np.isfinite(there)
            here, there = here[kept], there[kept]
            rising = here == np.maximum.accumulate(here)
            rising &= here == np.minimum.accumulate(here[::-1])[::-1]
            arcs += [orbit.leg_arcs(leg)[0], *here[rising].tolist()]
            uniform_arcs += [uniform.leg_arcs(leg)[0], *there[rising].tolist()]
        self._arcs = [*arcs, orbit.length]
        self._uniform_arcs = [*uniform_arcs, uniform.length]
        periodic = [
            [knots[-2] - knots[-1], *knots, knots[-1] + knots[1]]
            for knots in (self._arcs, self._uniform_arcs)
        ]
        super().__init__(PchipInterpolator(*periodic))

    def inverse(self, uniform_arc: float) -> float:
        number = bisect_right(self._uniform_arcs, uniform_arc) - 1
        number = min(max(number, 0), len(self._arcs) - 2)
        begin, end = self._arcs[number : number + 2]
        low, high = self._uniform_arcs[number : number + 2]
        if uniform_arc <= low or uniform_arc >= high:
            return begin if uniform_arc <= low else end
        return float(brentq(lambda arc: self.at(arc)[0] - uniform_arc, begin, end, xtol=1e-13))


def _arcs_at_bonds(orbit: Orbit, leg: int) -> Array:
    """Return the arc length in a leg at which each bond halves the sum of t_n^2 [rad], (N - 1,).

    Here t is the tangent. The element of a bond is NaN if the leg contains no such arc length, or
    more than one.
    """
    rotors = orbit.chain.number_of_rotors
    arcs = np.linspace(*orbit.leg_arcs(leg), _SAMPLES_A_SITE * rotors)
    if leg % 2 == 1:
        arcs = arcs[::-1]
    medians = np.array([_median(orbit.segment(arc)) for arc in arcs.tolist()])

    def excess(arc: float, bond: int) -> float:
        segment = orbit.segment(arc)
        squares = segment.tangent**2
        left = squares[: max(bond + 1 - segment.first, 0)]
        return float(left.sum() - squares.sum() / 2)

    found = np.full(rotors - 1, np.nan)
    for bond in range(rotors - 1):
        passed = np.flatnonzero(np.diff(medians > bond + 0.5))
        if len(passed) == 1:
            bracket = arcs[passed[0] : passed[0] + 2]
            found[bond] = brentq(excess, *bracket, args=(bond,), xtol=1e-12)
    return found


def _median(segment: OrbitSegment) -> float:
    """Return the position [rotor spacings] that divides the sum of t_n^2 into equal halves."""
    sums = np.cumsum(segment.tangent**2)
    half = sums[-1] / 2
    n = int(np.searchsorted(sums, half))
    before = sums[n - 1] if n else 0.0
    return segment.first + n - 0.5 + float((half - before) / (sums[n] - before))
