# SPDX-License-Identifier: Apache-2.0
"""Walls at rest, built bar by bar, and the arc of the way from one rotor to the next.

Given the angle of one rotor, the next hangs on it by a bar of fixed length, on one of two sides.
The side is the sign of the coupling to the rotor that hangs, B_n to the right and A_n to the
left. Built outwards from a wall, where |A_n| < |B_n| on its right and |A_n| > |B_n| on its left,
errors die out as the zero mode does; a recurrence from an end would multiply them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.integrate import DOP853, DenseOutput, OdeSolution
from scipy.optimize import brentq

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_bands, zero_mode
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.linkage.deviations import NO_DEVIATIONS

_DEPTHS_BESIDE = 19
"""Rotors beside a wall in penetration depths [1]: e^-19 squared is the rounding of a norm."""
_MOST_BESIDE = 49_000
"""Rotors beside a wall [1], so that the chain that holds it has fewer than a `Chain` may."""
_MOST_STEPS = 1000
"""Of a wall that does not pass its rotor [1]: others take some dozens."""
_TRANSITION = 1e-9
"""Of d from d_c, relative [1]: nearer, rounding tells which way a rotor turns."""
_TOLERANCE = 1e-13
"""Of a step, relative and [rad]: rounding, so that arcs are exact to eleven digits."""
_ARRIVED = 1e-6
"""Distance from a configuration at which it is that [rad]; others are far away."""


def static_wall(chain: Chain, place: float, leg: int = 0, turned: bool = False) -> Array:
    """Angles of a chain at rest with its wall at a place [rad], shape (N,).

    The place [rotor spacings] counts the arc of the zero-energy orbit: it is n + 1/2 where the
    wall is symmetric about the middle between rotors n and n + 1, and between such walls it
    grows as the arc length does. Legs are those of the orbit: 0 to 3 for flippers, told apart
    by which edge rotors have toggled (none, the last, both, the first), 0 and 1 for spinners,
    by the side on which the rotors in the wall turn over. Turned is the image phi -> pi - phi,
    as of a chain that was assembled upside down. In a chain with deviations the rotor nearest
    to the wall is as without, and all others follow by their own bars. Raises ValueError for a
    chain of two rotors or with periodic ends, a place within half a spacing of an end, a leg that
    there is not, where bars are too short or too long to reach, and as `site_arc` does.

    >>> import soliton_linkage as sl
    >>> chain = sl.Chain(number_of_rotors=20)
    >>> angles = sl.static_wall(chain, 12.5)
    >>> float(chain.elastic_energy(angles)) < 1e-25
    True
    >>> np.sign(sl.displacement(chain, angles))[10:15].astype(int).tolist()
    [1, 1, 1, -1, -1]
    """
    rotors = chain.number_of_rotors
    legs = 2 if chain.motion is Motion.SPINNER else 4
    if rotors < 3 or chain.periodic:
        raise ValueError(
            f'a wall does not fit a chain of {rotors} rotors with '
            f'{"periodic" if chain.periodic else "free"} ends; give it 3 rotors or more and free '
            'ends'
        )
    if not 0.5 <= place <= rotors - 1.5:
        raise ValueError(
            f'place = {place} must lie from 0.5 to the number of rotors less 1.5 = {rotors - 1.5}'
        )
    if leg not in range(legs):
        raise ValueError(f'leg = {leg} must be one of 0 to {legs - 1} for a {chain.motion.value}')
    seed = min(max(round(place), 1), rotors - 2)
    angle = _seed_angle(chain, seed, place - seed, leg, turned)
    return hung_from(chain, seed, angle, *bar_sides(chain, leg, turned))


def site_arc(chain: Chain) -> float:
    """Arc length of the zero-energy orbit from one rotor to the next [rad], Lambda.

    sqrt(sum_n dphi_n^2) along the way of a wall through one spacing, without deviations; a slow
    wall moves at v = a |phi_dot| / Lambda and has the mass M_eff = M r^2 Lambda^2 / a^2. Raises
    ValueError for d within 1e-9 d_c of d_c, where the ways of flippers and spinners meet, and for
    d below 2e-4, where a wall is too wide to follow.

    >>> chain = Chain(rest_angle=0.97)
    >>> round(site_arc(chain) * chain.rotor_length / chain.spacing, 6)
    0.494867
    """
    return _passage(_undeviating(chain), 0, False).arc


def check_transition(chain: Chain) -> None:
    """Raise ValueError for d within 1e-9 d_c of d_c, where flippers become spinners."""
    d, critical = chain.lean_ratio, chain.critical_lean_ratio
    if abs(d - critical) < _TRANSITION * critical:
        raise ValueError(
            f'd = {d:.12g} is too near to d_c = {critical:.12g} to tell the way of a flipper from '
            f'that of a spinner; take d further than {_TRANSITION:g} d_c from it'
        )


def effective_mass(chain: Chain) -> float:
    """Mass of a slow wall [kg], M_eff = M r^2 Lambda^2 / a^2, so that T = M_eff v^2 / 2."""
    return chain.moment_of_inertia * (site_arc(chain) / chain.spacing) ** 2


def hung_from(
    chain: Chain, seed: int, angle: float, left_sides: Array, right_sides: Array
) -> Array:
    """Angles of the chain in which one rotor has a given angle [rad], shape (N,).

    Rotors on its left hang on the sides with sign(A_n) = left_sides[n], those on its right with
    sign(B_n) = right_sides[n], each of shape (springs,). Raises ValueError where a bar cannot
    reach.
    """
    if seed not in range(chain.number_of_rotors):
        raise ValueError(f'seed = {seed} must be a rotor from 0 to {chain.number_of_rotors - 1}')
    if not math.isfinite(angle):
        raise ValueError(f'angle of rotor {seed} = {angle} rad must be a finite number')
    angles = np.empty(chain.number_of_rotors)
    angles[seed] = angle
    for n in range(seed, chain.number_of_rotors - 1):
        angles[n + 1] = hung_angle(chain, n, n + 1, angles[n], -chain.spacings[n], right_sides[n])
    for n in range(seed - 1, -1, -1):
        angles[n] = hung_angle(chain, n, n, angles[n + 1], chain.spacings[n], left_sides[n])
    return angles


def hung_angle(
    chain: Chain, bar: int, rotor: int, neighbour_angle: float, offset: float, side: float
) -> float:
    """Angle of a rotor on a bar from its neighbour, whose pivot lies at an offset from its own.

    With D the distance of the neighbour's mass from this pivot and beta the angle between the
    two, lbar^2 = D^2 + r^2 - 2 D r cos(beta); tan(beta / 2) follows from differences of lengths.
    """
    neighbour = bar if rotor > bar else bar + 1
    reach, length = float(chain.rotor_lengths[rotor]), float(chain.rest_lengths[bar])
    h = offset + float(chain.rotor_lengths[neighbour]) * math.sin(neighbour_angle)
    v = float(chain.rotor_lengths[neighbour]) * math.cos(neighbour_angle)
    distance = math.hypot(h, v)
    beyond = (length - distance + reach) * (length + distance - reach)
    short = (distance + reach - length) * (distance + reach + length)
    if beyond < 0 or short < 0:
        raise ValueError(
            f'bar {bar} of length {length:.6g} m cannot join rotor {rotor} of length '
            f'{reach:.6g} m to its neighbour, whose mass is {distance:.6g} m from its pivot: '
            f'it must have from {abs(distance - reach):.6g} to {distance + reach:.6g} m'
        )
    return math.atan2(h, v) + side * 2 * math.atan2(math.sqrt(beyond), math.sqrt(short))


def bar_sides(chain: Chain, leg: int, turned: bool) -> tuple[Array, Array]:
    """Signs of A_n of the right-leaning and of B_n of the left-leaning state, (springs,) each.

    An edge rotor that has toggled hangs on the other side. A flipper's first rotor has not
    toggled where A_0 has the sign that it has in the left-leaning state.
    """
    first, _ = rigidity_bands(chain, _ground_state(chain, 1, turned))
    _, second = rigidity_bands(chain, _ground_state(chain, -1, turned))
    left_sides, right_sides = np.sign(first), np.sign(second)
    if chain.motion is not Motion.SPINNER:
        from_left_leaning = 1 if chain.lean_ratio <= 1 else -1
        left_sides[0] *= from_left_leaning * (-1 if leg in (2, 3) else 1)
        right_sides[-1] *= -1 if leg in (1, 2) else 1
    return left_sides, right_sides


def _ground_state(chain: Chain, lean: int, turned: bool) -> Array:
    """The uniform state on this orbit that leans right or left [rad], shape (N,)."""
    theta = lean * chain.rest_angle
    if chain.motion is Motion.SPINNER and lean < 0:
        theta = chain.rest_angle + math.pi
    return staggered(np.full(chain.number_of_rotors, math.pi - theta if turned else theta))


def _seed_angle(chain: Chain, seed: int, beyond: float, leg: int, turned: bool) -> float:
    """Angle of the rotor nearest to a wall that is by so much beyond it [rad].

    The image phi -> pi - phi of a flipper is on the same leg, that of a spinner on the other.
    """
    if chain.motion is not Motion.SPINNER:
        leg = 0
    elif turned:
        leg = 1 - leg
    angle = _passage(_undeviating(chain), leg, seed % 2 == 1).angle(beyond)
    return math.pi - angle if turned else angle


def _symmetric_wall(chain: Chain, rotor: int, leg: int) -> Array:
    """Angles of a wall half way between a rotor and the next [rad], shape (N,).

    The chain is its own image there, n -> 2 rotor + 1 - n with phi -> phi + pi for flippers, so
    that h = r^2 sin(theta_bar)^2 / a, and with phi -> -phi for spinners, whose masses have
    crossed, h = (a + lbar) / 2, or not, h = (a - lbar) / 2, by turns.
    """
    if chain.motion is Motion.SPINNER:
        crossed = (leg + rotor) % 2 == 1
        h = (chain.spacing + (chain.rest_length if crossed else -chain.rest_length)) / 2
    else:
        crossed = False
        h = (chain.rotor_length * math.sin(chain.rest_angle)) ** 2 / chain.spacing
    angle = math.asin(h / chain.rotor_length)
    upright = (rotor % 2 == 0) != crossed
    sides = bar_sides(chain, leg if chain.motion is Motion.SPINNER else 0, False)
    return hung_from(chain, rotor, angle if upright else math.pi - angle, *sides)


def _undeviating(chain: Chain) -> Chain:
    return replace(chain, number_of_rotors=3, periodic=False, deviations=NO_DEVIATIONS)


def _rotors_beside(chain: Chain) -> int:
    """How many rotors on each side of a wall its zero mode reaches, to rounding in its norm."""
    check_transition(chain)
    beside = math.ceil(_DEPTHS_BESIDE * penetration_depth(chain) / chain.spacing) + 10
    if beside > _MOST_BESIDE:
        raise ValueError(
            f'd = {chain.lean_ratio:.6g} makes a wall reach over {beside} rotors on each side, '
            f'more than {_MOST_BESIDE}; take longer rotors or a larger rest angle'
        )
    return beside


class _SitePassage:
    """A wall on its way past one rotor, from half a spacing before it to half a spacing beyond."""

    def __init__(self, chain: Chain, leg: int, odd: bool) -> None:
        beside = _rotors_beside(chain)
        self._rotor = 2 * (beside // 2) + odd
        self._window = replace(chain, number_of_rotors=2 * self._rotor + 1)
        self._arrival = _symmetric_wall(self._window, self._rotor, leg)
        start = _symmetric_wall(self._window, self._rotor - 1, leg)
        mode = zero_mode(self._window, start)
        self._sense = 1.0 if mode @ mode_towards_last(self._window, start) > 0 else -1.0
        self._solution, self.arc = self._followed(start)

    def angle(self, beyond: float) -> float:
        """Angle of the rotor [rad] when the wall is beyond it by -0.5 to 0.5 spacings."""
        return float(self._solution((beyond + 0.5) * self.arc)[self._rotor])

    def _followed(self, start: Array) -> tuple[OdeSolution, float]:
        """Follow the zero mode until the wall has arrived; the way and its length [rad]."""
        solver = DOP853(self._direction, 0.0, start, np.inf, rtol=_TOLERANCE, atol=_TOLERANCE)
        pieces, ends = [], [0.0]
        for _ in range(_MOST_STEPS):
            complaint = solver.step()
            pieces.append(solver.dense_output())
            ends.append(solver.t)
            if complaint:
                break
            there = self._arc_of_arrival(pieces[-1], ends[-2], ends[-1])
            if there is not None:
                return OdeSolution(ends, pieces), there
        raise ArithmeticError(
            f'a wall of a chain with d = {self._window.lean_ratio:.9g} and d_c = '
            f'{self._window.critical_lean_ratio:.9g} did not pass its rotor within an arc of '
            f'{solver.t:.3g} rad; take parameters further from the transition'
        )

    def _arc_of_arrival(self, piece: DenseOutput, begin: float, end: float) -> float | None:
        if self._still_to_go(piece(begin)) < 0 or self._still_to_go(piece(end)) > 0:
            return None
        there = float(brentq(lambda arc: self._still_to_go(piece(arc)), begin, end, xtol=1e-15))
        apart = np.sin((piece(there) - self._arrival) / 2)
        return there if float(np.abs(apart).max()) < _ARRIVED else None

    def _direction(self, _arc: float, angles: Array) -> Array:
        return self._sense * zero_mode(self._window, angles)

    def _still_to_go(self, angles: Array) -> float:
        """Arc to the arrival, close to it; smooth in angles that count turns."""
        arrival = self._sense * zero_mode(self._window, self._arrival)
        return float(np.sin(self._arrival - angles) @ arrival)


_passage = lru_cache(maxsize=16)(_SitePassage)
"""Ways past a rotor as they were last made [1]: a chain has four, by leg and by parity."""
