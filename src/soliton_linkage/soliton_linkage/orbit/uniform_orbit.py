# SPDX-License-Identifier: Apache-2.0
"""The orbit of a chain of any length, put together from the orbit of a short one.

Away from the edges a wall looks the same at every second rotor. The closed orbit of a chain that
is just long enough for a wall to know nothing of either edge therefore holds all that a long
chain does: its swings at the edges, and in the middle of each leg a passage that is repeated,
shifted by an even number of rotors. Time and memory to make it do not depend on N.

The orbit is followed from the middle of one leg to that of the next, where the wall is known
exactly, and only past the last rotor: its mirror image runs past the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.integrate import DOP853, DenseOutput
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import brentq

from soliton_linkage.compiling import compiled, const_f8_1d, const_f8_2d, f8, f8_1d, i8
from soliton_linkage.linear.bands import couplings, penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_bands
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment
from soliton_linkage.solitons.static_wall import site_arc, static_wall

_DEPTHS_BESIDE = 15
"""Rotors beside the wall of a short chain in penetration depths [1]: e^-15 is below 1e-6 rad."""
_ROTORS_BESIDE = 6
"""And as many more [rotors], for the wall's own width where the depth goes to 0."""
_TOLERANCE = 1e-9
"""Of the whole chain in a step [rad]: errors die out or add up to less than 1e-6 rad."""
_SAMPLES_A_STEP = 3
"""Points of the spline in a step of the solver [1]: its error is then below that of the steps."""
_DEGREE = 7
"""Of the spline [1], one less than the order of the solver."""
_MOST_STEPS = 100_000
"""Of an orbit that does not end [1]: those next to d_c take one or two thousand."""
_ARRIVED = 1e-4
"""Distance from a configuration at which it is that [rad]; others are far away."""


class UniformOrbit(Orbit):
    """The orbit of a chain without deviations; those of the one given do not count.

    Angles are accurate to 1e-6 rad. To make it takes time as the orbit of the short chain is
    long, and as a wall is wide: below a second but for wobbling flippers next to d_c and for
    walls that reach over 1000 rotors. Raises ValueError for a chain of two rotors or with
    periodic ends, and as `site_arc` does.
    """

    def __init__(self, chain: Chain) -> None:
        """Follow the short chain once round its orbit."""
        if chain.number_of_rotors < 3 or chain.periodic:
            raise ValueError(
                f'a chain of {chain.number_of_rotors} rotors with '
                f'{"periodic" if chain.periodic else "free"} ends has no orbit of a wall; give it '
                '3 rotors or more and free ends'
            )
        self.chain = replace(chain, deviations=NO_DEVIATIONS)
        self.number_of_legs = 2 if chain.motion is Motion.SPINNER else 4
        self.site_arc = site_arc(chain)
        self._short = _short_chain(self.chain)
        self._repeats = (chain.number_of_rotors - self._short.number_of_rotors) // 2
        self._orbit = _short_orbit(self._short, self.number_of_legs)
        turning = self._orbit.reflections
        begins = [turning[-1] - self._orbit.length, *turning[:-1]]
        extra = 2 * self._repeats * self.site_arc
        inner = np.diff([begins[0], *turning])
        self._starts = [0.0, *np.cumsum(inner + extra).tolist()]
        before = np.subtract(self._orbit.middles[:-1], begins)
        half = self._repeats * self.site_arc
        self._halfway: list[float] = (self._starts[:-1] + before + half).tolist()
        self._legs = np.array([self._starts[:-1], begins, before])

    @property
    def wall_extent(self) -> float:
        """Arc length [rad] of a way past all the rotors that know of a wall."""
        swing = self._starts[1] - (self.chain.number_of_rotors - 1) * self.site_arc
        return self._short.number_of_rotors * self.site_arc + swing

    def site(self, arc: float) -> float:
        """Place of the wall [rotor spacings], from 0 to N - 1; at the edges it waits there."""
        leg, last = self.leg(arc), self.chain.number_of_rotors - 1.0
        beyond = (arc % self._starts[-1] - self._halfway[leg]) / self.site_arc
        place = last / 2 - beyond if leg % 2 else last / 2 + beyond
        return 0.0 if place < 0 else min(place, last)

    def arc_at(self, place: float, leg: int) -> float:
        """Arc length at which the wall is at a place [rotor spacings] in the middle of a leg."""
        beyond = place - self.middle if leg % 2 == 0 else self.middle - place
        return self._halfway[leg] + beyond * self.site_arc

    def site_arc_at(self, arc: float) -> float:
        """Arc length from one rotor to the next at an arc length [rad]: the same everywhere."""
        return self.site_arc

    def segment(self, arc: float) -> OrbitSegment:
        """Rotors about the wall at an arc length; all others are as in `background`."""
        return self._orbit.about_wall(
            arc % self._starts[-1], self._legs, self._repeats, self.site_arc
        )

    def background(self, arc: float) -> tuple[Array, Array]:
        """Angles of the chain as it is on the left and on the right of the wall [rad], (N,) each.

        Uniform, but for the edge rotors of flippers, which have toggled or not.
        """
        left, right = self.chain.uniform_state(1), self.chain.uniform_state(-1)
        if self.chain.motion is Motion.SPINNER:
            right = self.chain.uniform_state(1) + math.pi
        edges = self._orbit.walls[self.leg(arc)]
        left[0], right[-1] = edges[0], edges[-1]
        return left, right


@dataclass(frozen=True)
class _BetweenMiddles:
    """The orbit from the middle of a leg to that of the next, in samples."""

    arcs: Array
    """Arc lengths from the start of the piece [rad], shape (K,)."""
    angles: Array
    """Actual angles [rad], without jumps, shape (K, N)."""
    tangents: Array
    """Change of the angles with the arc length [1], shape (K, N)."""

    def mirrored(self, chain: Chain) -> _BetweenMiddles:
        """Return the mirror image, n -> N - 1 - n and phi -> -phi, run through the other way.

        Where that is the orbit of the chain assembled upside down, phi -> pi + phi brings it
        back: in a chain with an odd number of spinners or an even one of flippers. It also turns
        spinners from one leg to the other, so that they run the same way again.
        """
        spinner, odd = chain.motion is Motion.SPINNER, chain.number_of_rotors % 2 == 1
        angles, tangents = self.angles[:, ::-1], self.tangents[:, ::-1]
        if spinner and odd:
            return _BetweenMiddles(self.arcs, angles + math.pi, tangents)
        arcs = self.arcs[-1] - self.arcs[::-1]
        if spinner or odd:
            return _BetweenMiddles(arcs, -angles[::-1], tangents[::-1])
        return _BetweenMiddles(arcs, angles[::-1] + math.pi, -tangents[::-1])


class _ShortOrbit:
    """The orbit of a chain, from the middle of leg 0 through all legs and back, as a spline."""

    def __init__(self, chain: Chain, legs: int) -> None:
        self._chain = chain
        middle = (chain.number_of_rotors - 1) / 2
        self.walls = [static_wall(chain, middle, leg) for leg in range(legs)]
        self._scale = 1 / max(map(abs, couplings(chain)))
        self._signs = (-1.0) ** np.arange(chain.number_of_rotors)
        if mode_towards_last(chain, self.walls[0]) @ self._tangent(self.walls[0]) < 0:
            self._signs *= -1
        pieces = self._pieces()
        self.middles: list[float] = [
            0.0,
            *np.cumsum([piece.arcs[-1] for piece in pieces]).tolist(),
        ]
        self.length: float = self.middles[-1]
        self._spline = _closed_spline(pieces, self.middles)
        self._knots: Array = np.ascontiguousarray(self._spline.t)
        self._coefficients: Array = np.ascontiguousarray(self._spline.c)
        self.reflections = [self._reflection(leg) for leg in range(legs)]

    def about_wall(self, arc: float, legs: Array, repeats: int, site_arc: float) -> OrbitSegment:
        """Rotors about the wall of a long chain, of which some passages repeat in each leg.

        Legs are as in `set_about_wall`.
        """
        rotors = self._chain.number_of_rotors
        values = np.empty(2 * rotors)
        first, low, high = set_about_wall(
            arc,
            legs,
            repeats,
            site_arc,
            self.length,
            self._knots,
            self._coefficients,
            values,
        )
        return OrbitSegment(first, values[low:high], values[rotors + low : rotors + high])

    def _tangent(self, angles: Array) -> Array:
        """Unit zero mode in the direction of the orbit [1], (N,), quicker than `zero_mode`.

        t_n ~ (-1)^n A_0 ... A_{n-1} B_n ... B_{N-2}, in units of the larger coupling: as far as
        the short chain reaches no product leaves the range of numbers but to vanish.
        """
        first, second = rigidity_bands(self._chain, angles)
        mode = self._signs.copy()
        with np.errstate(over='ignore', invalid='ignore'):
            mode[1:] *= np.cumprod(self._scale * first)
            mode[:-1] *= np.cumprod(self._scale * second[::-1])[::-1]
            square = float(mode @ mode)
        if not 0 < square < math.inf:
            return self._wide(first, second)
        return np.asarray(mode / math.sqrt(square))

    def _wide(self, first: Array, second: Array) -> Array:
        """The same where the products leave the range of numbers, by their logarithms."""
        signs, logarithms = self._signs.copy(), np.zeros(len(self._signs))
        with np.errstate(divide='ignore'):
            logarithms[1:] += np.cumsum(np.log(np.abs(first)))
            logarithms[:-1] += np.cumsum(np.log(np.abs(second[::-1])))[::-1]
        signs[1:] *= np.cumprod(np.sign(first))
        signs[:-1] *= np.cumprod(np.sign(second[::-1]))[::-1]
        mode = signs * np.exp(logarithms - logarithms.max())
        return np.asarray(mode / math.sqrt(mode @ mode))

    def _pieces(self) -> list[_BetweenMiddles]:
        """All pieces in the order of the orbit, of which those past the first are mirrored.

        Toggled is meant against the left-leaning state at both ends, whose coupling A_0 is not
        that of the mirrored right-leaning one for d > 1: there the mirror image of leg 0 is leg
        2 for flippers, while that of leg 1 is leg 3 for d < 1.
        """
        legs = len(self.walls)
        last = [self._followed(leg) for leg in range(0, legs, 2)]
        first = [piece.mirrored(self._chain) for piece in last]
        if self._chain.lean_ratio <= 1:
            first.reverse()
        return [piece for both in zip(last, first, strict=True) for piece in both]

    def _followed(self, leg: int) -> _BetweenMiddles:
        """Follow the zero mode to the middle of the next leg."""
        start = self.walls[leg]
        arcs, angles = [np.zeros(1)], [start[None]]
        for begin, end, dense in self._steps(start, self.walls[(leg + 1) % len(self.walls)]):
            arcs.append(np.linspace(begin, end, _SAMPLES_A_STEP + 1)[1:])
            angles.append(dense(arcs[-1]).T)
        joined = np.concatenate(angles)
        tangents = np.array([self._tangent(each) for each in joined])
        return _BetweenMiddles(np.concatenate(arcs), joined, tangents)

    def _steps(self, start: Array, goal: Array) -> Iterator[tuple[float, float, DenseOutput]]:
        """Steps of the solver, the last one only as far as the goal: begin, end [rad], angles."""
        solver = DOP853(
            lambda _, angles: self._tangent(angles),
            0.0,
            start,
            np.inf,
            rtol=_TOLERANCE / 1e3,
            atol=_TOLERANCE / math.sqrt(len(start)),
        )
        to_goal = self._tangent(goal)
        for _ in range(_MOST_STEPS):
            complaint = solver.step()
            if complaint:
                break
            dense = solver.dense_output()
            end = _arrival(dense, goal, to_goal)
            yield solver.t_old, solver.t if end is None else end, dense
            if end is not None:
                return
        chain = self._chain
        raise ArithmeticError(
            f'a wall of a chain with d = {chain.lean_ratio:.9g} and d_c = '
            f'{chain.critical_lean_ratio:.9g} did not come back from its edge within an arc of '
            f'{solver.t:.3g} rad; take parameters further from the transition'
        )

    def _reflection(self, leg: int) -> float:
        """Arc length at which a leg ends [rad], where its wall turns back."""
        begin, end = self.middles[leg : leg + 2]
        return float(brentq(self._turn, begin, end, args=(leg,), xtol=1e-12))

    def _turn(self, arc: float, leg: int) -> float:
        """Changes sign where the wall turns back at the end of a leg.

        A flipper's edge rotor is then in line with its bar, and a spinner's sum of all
        horizontal positions turns back.
        """
        angles, tangent = np.split(np.asarray(self._spline(arc)), 2)
        if self._chain.motion is Motion.SPINNER:
            return float(np.cos(angles) @ tangent)
        first, second = rigidity_bands(self._chain, angles)
        return float(second[-1] if leg % 2 == 0 else first[0])


_short_orbit = lru_cache(maxsize=4)(_ShortOrbit)
"""Orbits of short chains as they were last followed [1]: who filters, shapes walls and steers, and
chains that differ in their length alone or in what deviates, take the same one."""


def _short_chain(chain: Chain) -> Chain:
    """The chain, or the shortest like it in whose middle a wall knows nothing of the edges."""
    depth = penetration_depth(chain) / chain.spacing
    beside = math.ceil(_DEPTHS_BESIDE * depth) + _ROTORS_BESIDE
    fewest = 2 * beside + chain.number_of_rotors % 2
    return replace(chain, number_of_rotors=min(chain.number_of_rotors, fewest))


def _arrival(dense: DenseOutput, goal: Array, tangent: Array) -> float | None:
    """Arc length [rad] within a step at which a configuration is reached, up to whole turns."""

    def to_go(arc: float) -> float:
        return float(np.sin(goal - dense(arc)) @ tangent)

    if to_go(dense.t_old) < 0 or to_go(dense.t) > 0:
        return None
    arc = float(brentq(to_go, dense.t_old, dense.t, xtol=1e-14))
    apart = np.abs(np.sin((dense(arc) - goal) / 2)).max()
    return arc if apart < _ARRIVED else None


def _closed_spline(pieces: list[_BetweenMiddles], middles: list[float]) -> BSpline:
    """Angles and tangents of pieces joined end to end, shape (2 N,), over one cycle.

    It runs on into the next cycle and the last, so as to be smooth where they meet.
    """
    arcs, rows, end = [], [], pieces[0].angles[0]
    for piece, middle in zip(pieces, middles[:-1], strict=True):
        turns = 2 * math.pi * np.round((end - piece.angles[0]) / (2 * math.pi))
        arcs.append(middle + piece.arcs[:-1])
        rows.append(np.hstack([piece.angles + turns, piece.tangents])[:-1])
        end = piece.angles[-1] + turns
    around, samples = np.concatenate(arcs), np.concatenate(rows)
    turned = np.zeros(samples.shape[1])
    turned[: len(end)] = 2 * math.pi * np.round((end - pieces[0].angles[0]) / (2 * math.pi))
    beyond = _DEGREE + 1
    length = middles[-1]
    return make_interp_spline(
        np.concatenate([around[-beyond:] - length, around, around[:beyond] + length]),
        np.concatenate([samples[-beyond:] - turned, samples, samples[:beyond] + turned]),
        k=_DEGREE,
    )


@compiled(const_f8_1d, const_f8_2d, f8, f8_1d)
def spline(knots: Array, coefficients: Array, at: float, values: Array) -> None:
    """Set values of B-splines with knots in common, shape (M,); coefficients of shape (K, M).

    By the recursion of Cox and de Boor: scipy's splines take ten times as long for one place.
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
            share = basis[n] / (right - left)
            basis[n] = saved + (right - at) * share
            saved = (at - left) * share
        basis[order] = saved
    for column in range(values.size):
        value = 0.0
        for n in range(degree + 1):
            value += basis[n] * coefficients[low - degree + n, column]
        values[column] = value


@compiled(f8, const_f8_2d, i8, f8, f8, const_f8_1d, const_f8_2d, f8_1d)
def set_about_wall(
    arc: float,
    legs: Array,
    repeats: int,
    site_arc: float,
    length: float,
    knots: Array,
    coefficients: Array,
    values: Array,
) -> tuple[int, int, int]:
    """Set angles [rad], up to whole turns, and tangents [1] of a short chain, shape (2 n,).

    At an arc [rad] of the long chain, in whose legs so many passages repeat; legs are where each
    begins in the long chain, where in the short one, and the way from there to the middle of the
    short one [rad], shape (3, legs). The length [rad] is that of the short orbit, whose angles
    and tangents are a spline. Returns the first rotor of the long chain that is among those of
    the short one, and of these the first and the end.
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
    # Edge rotors of the short chain stand where the long one has none, but at its ends.
    low = 0 if offset == 0 else 1
    end = values.size // 2
    high = end if offset == 2 * repeats else end - 1
    return offset + low, low, high
