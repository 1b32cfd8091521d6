# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain whose rotors and springs deviate by known amounts.

Where the wall is, is told by the halves of the zero mode t: the chain without deviations is
taken that has half of |t|^2 on the left of the same bond, and between bonds, and from the begin
to the end of each leg, its arc length grows smoothly with that of this chain. The wall is at the
place where it is in that one.
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
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.orbit.orbit_pieces import OrbitPiece, orbit_pieces
from soliton_linkage.orbit.seed_path import impassable
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

_SAMPLES_A_SITE = 4
"""How often the halves of the zero mode are looked at [1/site], to bracket where they pass."""
_SAME_MODE = 1 - 1e-6
"""Cosine between tangent and zero mode [1] below which rotors move that the pieces leave out."""


def orbit_of(chain: Chain) -> Orbit:
    """Orbit of a chain: its own where rotors or springs deviate, else that of a uniform chain.

    Raises ValueError as `UniformOrbit` and `DeviatingOrbit` do.
    """
    return UniformOrbit(chain) if chain.deviations == NO_DEVIATIONS else DeviatingOrbit(chain)


class DeviatingOrbit(Orbit):
    """The orbit of a chain with its deviations.

    Bars have their length to 1e-9 of it on all configurations. Time and memory to make it grow
    as N. Raises ValueError as `UniformOrbit` and `orbit_pieces` do, and where the wall is
    reflected other than at the edges.
    """

    def __init__(self, chain: Chain) -> None:
        """Make the orbit and find its reflections and places."""
        self._uniform = UniformOrbit(chain)
        self.chain = chain
        self.number_of_legs = self._uniform.number_of_legs
        self._pieces = orbit_pieces(chain)
        self._ends: list[float] = np.cumsum([piece.length for piece in self._pieces]).tolist()
        self._origin = 0.0
        self._starts = [0.0, self._ends[-1]]
        turning = self._reflections()
        self._origin = turning[-1] - self.length
        self._starts = [0.0, *(arc - self._origin for arc in turning)]
        legs = range(self.number_of_legs)
        self._backgrounds = [self._relaxed(leg) for leg in legs]
        self._check()
        self._counterpart = _Counterpart(self, self._uniform)
        inner = chain.number_of_rotors - 2
        ways = [self.arc_at(inner + 0.5, leg) - self.arc_at(0.5, leg) for leg in legs]
        self.site_arc = sum(map(abs, ways)) / (inner * len(ways))

    @property
    def wall_extent(self) -> float:
        """Arc length [rad] of a way past all the rotors that know of a wall."""
        return self._uniform.wall_extent * self.site_arc / self._uniform.site_arc

    def site(self, arc: float) -> float:
        """Place of the wall [rotor spacings], from 0 to N - 1; at the edges it waits there."""
        return self._uniform.site(self._counterpart.value(arc % self.length))

    def arc_at(self, place: float, leg: int) -> float:
        """Arc length at which the wall is at a place [rotor spacings] in the middle of a leg.

        Places beyond the leg lie as far in arc length beyond its ends as without deviations.
        """
        counterpart = self._uniform.arc_at(place, leg)
        begin, end = self._uniform.leg_arcs(leg)
        within = min(max(counterpart, begin), end)
        return self._counterpart.inverse(within) + (counterpart - within)

    def site_arc_at(self, arc: float) -> float:
        """Arc length from one rotor to the next [rad] as it is at an arc length, ds / dplace."""
        return self._uniform.site_arc / self._counterpart.slope(arc % self.length)

    def segment(self, arc: float) -> OrbitSegment:
        """Rotors about the wall at an arc length; all others are as in `background`."""
        within = (arc + self._origin) % self._ends[-1]
        number = min(bisect_right(self._ends, within), len(self._ends) - 1)
        piece = self._pieces[number]
        values = piece.at(within - self._ends[number] + piece.length)
        return OrbitSegment(piece.first, values[: piece.rotors], values[piece.rotors :])

    def background(self, arc: float) -> tuple[Array, Array]:
        """Angles of the chain as it is on the left and on the right of the wall [rad], (N,) each.

        Relaxed without a wall, but for the edge rotors of flippers, which have toggled or not.
        """
        left, right = self._backgrounds[self.leg(arc)]
        return left.copy(), right.copy()

    def _reflections(self) -> list[float]:
        """Arc lengths from the begin of the first piece at which the legs end [rad].

        There a flipper's edge rotor is in line with its bar, so that its neighbour turns back,
        and a spinner's sum of sin(phi_n) does.
        """
        last = self.chain.number_of_rotors - 1
        spinner = self.chain.motion is Motion.SPINNER
        found: list[float] = []
        following = [*self._pieces[1:], self._pieces[0]]
        for piece, after, end in zip(self._pieces, following, self._ends, strict=True):
            if not spinner and piece.seed not in (0, last):
                continue
            rotor = None if spinner else -2 if piece.seed == last else 1
            goes_on = spinner or after.seed == piece.seed
            turned = (
                _turning(0.0, after, rotor) if goes_on else _turning(piece.length, piece, rotor)
            )
            if (_turning(0.0, piece, rotor) > 0) != (turned > 0):
                found.append(end - piece.length + _turning_arc(piece, rotor))
        if len(found) != self.number_of_legs:
            number = bisect_right(self._ends, found[0] if found else 0.0)
            raise impassable(self.chain, self._pieces[number].seed)
        return found

    def _check(self) -> None:
        """Refuse an orbit on which rotors move far from the wall, where it is stopped."""
        for piece, end in zip(self._pieces, self._ends, strict=True):
            arc = end - piece.length / 2 - self._origin
            mode = zero_mode(self.chain, self.configuration(arc))
            tangent = np.split(piece.at(piece.length / 2), 2)[1]
            about = mode[piece.first : piece.first + piece.rotors]
            if not abs(float(about @ tangent)) > _SAME_MODE:
                raise impassable(self.chain, piece.seed)

    def _relaxed(self, leg: int) -> tuple[Array, Array]:
        """Background of a leg: as the wall leaves it behind on its way to the edges.

        There the edge rotors are as without deviations, or as near to it as they get.
        """
        last = self.chain.number_of_rotors - 1
        left, right = self._uniform.background(self._uniform.leg_arcs(leg)[0])
        begin, end = self.leg_arcs(leg)
        at_last = (last, float(left[-1]), end) if leg % 2 == 0 else (last, float(left[-1]), begin)
        at_first = (0, float(right[0]), begin) if leg % 2 == 0 else (0, float(right[0]), end)
        arcs = sorted((arc - self._origin) % self.length for arc in self._ends)
        inner = [arc for arc in arcs if begin < arc < end]
        if leg % 2 == 1:
            inner.reverse()
        return (
            self._left_behind([*inner, self._nearest(*at_last)]),
            self._left_behind([*inner[::-1], self._nearest(*at_first)]),
        )

    def _left_behind(self, arcs: list[float]) -> Array:
        """Angles of the chain as they were last along a series of arcs [rad], shape (N,)."""
        angles = np.empty(self.chain.number_of_rotors)
        for arc in arcs:
            about = self.segment(arc)
            angles[about.first : about.first + len(about.angles)] = about.angles
        return angles

    def _nearest(self, rotor: int, angle: float, turning: float) -> float:
        """Arc at which an edge rotor is nearest to an angle, as the wall swings about it [rad]."""
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
            away = [math.remainder(each - angle, 2 * math.pi) for each in piece.edge(column)]
            if away[0] * away[1] < 0 and abs(away[0] - away[1]) < math.pi:
                return begin + float(brentq(_away, 0, piece.length, args=(piece, column, angle)))
            nearest = min(nearest, (abs(away[0]), begin), (abs(away[1]), begin + piece.length))
        return nearest[1]


def _away(arc: float, piece: OrbitPiece, column: int, angle: float) -> float:
    """How far one of the rotors of a piece is from an angle, -pi to pi [rad]."""
    return math.remainder(float(piece.at(arc)[: piece.rotors][column]) - angle, 2 * math.pi)


def _turning(arc: float, piece: OrbitPiece, rotor: int | None) -> float:
    """Growth of the angle of one of the rotors of a piece [1], or of their sum of sin(phi_n)."""
    angles, tangent = np.split(piece.at(arc), 2)
    return float(np.cos(angles) @ tangent) if rotor is None else float(tangent[rotor])


def _turning_arc(piece: OrbitPiece, rotor: int | None) -> float:
    """Where in a piece, or at its end but for rounding, a rotor or the sum turns back [rad]."""
    if (_turning(0.0, piece, rotor) > 0) == (_turning(piece.length, piece, rotor) > 0):
        return piece.length
    return float(brentq(_turning, 0, piece.length, args=(piece, rotor), xtol=1e-14))


class _Counterpart:
    """Arc of the uniform orbit as a smooth, growing function of the arc of another."""

    def __init__(self, orbit: Orbit, uniform: UniformOrbit) -> None:
        """Find bonds that the wall passes once and in their order, and join them smoothly."""
        arcs: list[float] = []
        counterparts: list[float] = []
        for leg in range(orbit.number_of_legs):
            halves, others = (_half_ways(each, leg)[:: (-1) ** leg] for each in (orbit, uniform))
            kept = np.isfinite(halves) & np.isfinite(others)
            halves, others = halves[kept], others[kept]
            rising = (halves == np.maximum.accumulate(halves)) & (
                halves == np.minimum.accumulate(halves[::-1])[::-1]
            )
            arcs += [orbit.leg_arcs(leg)[0], *halves[rising].tolist()]
            counterparts += [uniform.leg_arcs(leg)[0], *others[rising].tolist()]
        self._arcs = [*arcs, orbit.length]
        self._counterparts = [*counterparts, uniform.length]
        self._cubics = self._joined()

    def _joined(self) -> list[list[float]]:
        """Cubic between each knot and the next, on an orbit without end."""
        arcs, counterparts = self._arcs, self._counterparts
        around = [arcs[-2] - arcs[-1], *arcs, arcs[-1] + arcs[1]]
        others = [counterparts[-2] - counterparts[-1], *counterparts]
        others.append(counterparts[-1] + counterparts[1])
        cubics: list[list[float]] = PchipInterpolator(around, others).c.T[1:-1].tolist()
        return cubics

    def value(self, arc: float) -> float:
        """Arc of the uniform orbit [rad]."""
        number = _interval(self._arcs, arc)
        a, b, c, d = self._cubics[number]
        beyond = arc - self._arcs[number]
        return float(((a * beyond + b) * beyond + c) * beyond + d)

    def slope(self, arc: float) -> float:
        """Its growth with the arc [1]."""
        number = _interval(self._arcs, arc)
        a, b, c, _ = self._cubics[number]
        beyond = arc - self._arcs[number]
        return float((3 * a * beyond + 2 * b) * beyond + c)

    def inverse(self, counterpart: float) -> float:
        """Arc at which it is so much [rad]."""
        number = _interval(self._counterparts, counterpart)
        begin, end = self._arcs[number : number + 2]
        low, high = self._counterparts[number : number + 2]
        if counterpart <= low or counterpart >= high:
            return begin if counterpart <= low else end
        return float(brentq(lambda arc: self.value(arc) - counterpart, begin, end, xtol=1e-13))


def _interval(knots: list[float], at: float) -> int:
    return min(max(bisect_right(knots, at) - 1, 0), len(knots) - 2)


def _half_ways(orbit: Orbit, leg: int) -> Array:
    """Arc lengths [rad] of a leg at which half of |t|^2 is on the left of each bond, (N - 1,).

    NaN for bonds at the edges, where there is no such arc.
    """
    rotors = orbit.chain.number_of_rotors
    begin, end = orbit.leg_arcs(leg)
    arcs = np.linspace(begin, end, _SAMPLES_A_SITE * rotors)
    if leg % 2 == 1:
        arcs = arcs[::-1]
    medians = np.array([_median(orbit.segment(arc)) for arc in arcs.tolist()])
    found = np.full(rotors - 1, np.nan)
    for bond in range(rotors - 1):
        passed = np.flatnonzero(np.diff(medians > bond + 0.5))
        if len(passed) == 1:
            bracket = arcs[passed[0] : passed[0] + 2]
            found[bond] = brentq(
                lambda arc, n: _left_half(orbit.segment(arc), n),
                *bracket,
                args=(bond,),
                xtol=1e-12,
            )
    return found


def _median(about: OrbitSegment) -> float:
    """Where half of |t|^2 is on the left [rotor spacings]."""
    shares = np.cumsum(about.tangent**2)
    half = shares[-1] / 2
    n = int(np.searchsorted(shares, half))
    before = shares[n - 1] if n else 0.0
    return about.first + n - 0.5 + float((half - before) / (shares[n] - before))


def _left_half(about: OrbitSegment, bond: int) -> float:
    """How much more of |t|^2 than half is on the left of a bond [1]."""
    squares = about.tangent**2
    left = squares[: max(bond + 1 - about.first, 0)]
    return float(left.sum() - squares.sum() / 2)
