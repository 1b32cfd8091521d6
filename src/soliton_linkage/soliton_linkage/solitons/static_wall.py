# SPDX-License-Identifier: Apache-2.0
"""Walls at rest, and the arc length of the orbit per rotor spacing.

Bar n joins rotors n and n + 1. The levers A_n and B_n of the bar are the derivatives of its length
with respect to the angles of these two rotors. For a given angle of one rotor, the bar to its
neighbour allows two angles of the neighbour (two branches), with opposite signs of the lever of
the neighbour. Therefore, the sign of B_n selects the branch on the right of the wall, and the sign
of A_n on the left. Errors of the angles decay outwards from the wall as fast as the zero mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.integrate import DOP853, DenseOutput, OdeSolution
from scipy.optimize import brentq

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import mode_towards_last, rigidity_bands, zero_mode
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered

_DEPTHS_BESIDE = 19
"""Largest distance from a wall at which rotors are computed [penetration depths]. At larger
distances, the squared zero mode is below the rounding errors."""
_MOST_BESIDE = 49_000
"""Largest number of rotors that are computed on each side of a wall [1]. A chain whose walls need
more is rejected."""
_MOST_STEPS = 100_000
"""Largest number of solver steps along an orbit [1]; near d_c, one or two thousand are needed."""
_TRANSITION = 1e-9
"""A chain is rejected if |d - d_c| / d_c is below this [1], because rounding errors could then
exchange the orbit of a flipper and the orbit of a spinner."""
_TOLERANCE = 1e-13
"""Relative [1] and absolute [rad] tolerance of a step. With this tolerance, the errors of arc
lengths are 1e-11 rad."""
_ARRIVED = 1e-4
"""Limit of |sin(x / 2)| for the difference x between an angle and the goal of `follow_zero_mode`
[1]. The goal is reached when no angle differs from it by more than 2e-4 rad."""


def static_wall(chain: Chain, site: float, leg: int = 0, inverted: bool = False) -> Array:
    """Return the angles [rad], (N,), of a chain at rest whose wall is at a site coordinate.

    The site coordinate [rotor spacings] is n if the wall is at rotor n, and n + 1/2 if it is in
    the middle between rotors n and n + 1. In an infinite chain, the site coordinate is
    proportional to the arc length of the zero-energy orbit. A finite chain has the same angles as
    an infinite chain, except that an edge rotor may be toggled: it is then at the other one of the
    two angles that its bar allows. `Orbit` calls an edge rotor toggled in comparison with the
    left-leaning state instead; `toggled_edges` explains the difference.

    In flippers with d <= 1, no edge rotor is toggled in `leg` 0 of the `Orbit`, the last one is
    toggled in leg 1, both are toggled in leg 2, and the first one in leg 3. In wobbling flippers,
    the first one is toggled in leg 0, both are toggled in leg 1, the last one in leg 2, and none
    in leg 3. In a spinner, a wall turns the rotors over in one direction in leg 0, and in the
    opposite direction in leg 1. If `inverted` is true, the chain is assembled upside down, with
    pi - phi in place of phi. In a chain with deviations, the rotor nearest to the wall has the
    same angle as without deviations, and the other angles follow from the lengths of the bars.
    Therefore the wall is only approximately at the same site as in `DeviatingOrbit`, which defines
    the site by the zero mode.

    Raises ValueError for a chain of two rotors or with periodic ends, for a site outside the range
    0 to N - 1, for an unknown leg, for bars of impossible length, and if `site_arc` raises it.

        >>> import soliton_linkage as sl
        >>> chain = sl.Chain(number_of_rotors=20)
        >>> angles = sl.static_wall(chain, 12.5)
        >>> float(chain.elastic_energy(angles)) < 1e-25
        True
    """
    rotors = chain.number_of_rotors
    legs = 2 if chain.motion is Motion.SPINNER else 4
    if rotors < 3 or chain.periodic:
        raise ValueError(
            f'a wall does not fit a chain of {rotors} rotors with '
            f'{"periodic" if chain.periodic else "free"} ends; give it 3 rotors or more and free '
            'ends'
        )
    if not 0 <= site <= rotors - 1:
        raise ValueError(f'site = {site} must lie in the range 0 to N - 1 = {rotors - 1}')
    if leg not in range(legs):
        raise ValueError(f'leg = {leg} must be one of 0 to {legs - 1} for a {chain.motion.value}')
    first, last = toggled_edges(chain, leg)
    seed = min(max(round(site), int(first)), rotors - 1 - last)
    angle = _seed_angle(chain, seed, site - seed, leg, inverted)
    return angles_from_seed(chain, seed, angle, *bar_branches(chain, leg, inverted))


def site_arc(chain: Chain) -> float:
    """Return Lambda, the arc length of the zero-energy orbit per rotor spacing [rad].

    Lambda is the integral of sqrt(sum_n dphi_n^2) over one rotor spacing of the chain without
    deviations. A slow wall has the speed v = a |phi_dot| / Lambda with the norm |phi_dot| of all
    rates. Raises ValueError for a lean ratio d within 1e-9 d_c of d_c or below 2e-4.

        >>> chain = Chain(rest_angle=0.97)
        >>> round(site_arc(chain) * chain.rotor_length / chain.spacing, 6)
        0.494867
    """
    return _passage(_shape(chain), 0, False).arc


def effective_mass(chain: Chain) -> float:
    """Return the effective mass of a slow wall, M_eff = M r^2 Lambda^2 / a^2 [kg]."""
    return chain.moment_of_inertia * (site_arc(chain) / chain.spacing) ** 2


def angles_from_seed(
    chain: Chain, seed: int, angle: float, left_branches: Array, right_branches: Array
) -> Array:
    """Return all angles of a chain of bars [rad], (N,), given the angle of the rotor `seed`.

    For each bar n on the left of the seed, the lever A_n has the sign left_branches[n]. For each
    bar n on the right, the lever B_n has the sign right_branches[n]. Both arrays have the shape
    (springs,). Raises ValueError if a bar is too short or too long.
    """
    spacings, angles = chain.spacings.tolist(), [0.0] * chain.number_of_rotors
    angles[seed] = angle
    for n in range(seed, chain.number_of_rotors - 1):
        branch = right_branches.item(n)
        angles[n + 1] = neighbour_angle(chain, n, n + 1, angles[n], -spacings[n], branch)
    for n in range(seed - 1, -1, -1):
        branch = left_branches.item(n)
        angles[n] = neighbour_angle(chain, n, n, angles[n + 1], spacings[n], branch)
    return np.array(angles)


def neighbour_angle(
    chain: Chain, bar: int, rotor: int, known_angle: float, offset: float, branch: float
) -> float:
    """Return the angle of `rotor` [rad] at which a bar joins it to its neighbour.

    The neighbour has the angle `known_angle` [rad]. `offset` [m] is the position of the
    neighbour's pivot relative to the rotor's pivot. The line from the rotor's pivot to the
    neighbour's mass has the length D. The angle of the rotor is the direction of this line plus
    `branch` (+1 or -1) times beta, where lbar^2 = D^2 + r^2 - 2 D r cos(beta), with the length
    lbar of the bar and the rotor length r. Raises ValueError if the bar is too short or too long.
    """
    r, length = chain.rotor_lengths.item(rotor), chain.rest_lengths.item(bar)
    known = chain.rotor_lengths.item(bar if rotor > bar else bar + 1)
    h, v = offset + known * math.sin(known_angle), known * math.cos(known_angle)
    distance = math.hypot(h, v)
    above = (length - distance + r) * (length + distance - r)
    below = (distance + r - length) * (distance + r + length)
    if above < 0 or below < 0:
        raise ValueError(
            f'bar {bar} of length {length:.6g} m cannot join rotor {rotor} of length {r:.6g} m to '
            f'its neighbour, whose mass is {distance:.6g} m from its pivot: it must have from '
            f'{abs(distance - r):.6g} to {distance + r:.6g} m'
        )
    return math.atan2(h, v) + branch * 2 * math.atan2(math.sqrt(above), math.sqrt(below))


@lru_cache(maxsize=16)
def bar_branches(chain: Chain, leg: int, inverted: bool) -> tuple[Array, Array]:
    """Return the signs of the levers A_n on the left of a wall, and of B_n on the right of it.

    The docstring of `static_wall` explains `leg` and `inverted`. The arrays have the shape
    (springs,) and are read-only.
    """
    first, _ = rigidity_bands(chain, _uniform_state(chain, 1, inverted))
    _, second = rigidity_bands(chain, _uniform_state(chain, -1, inverted))
    left, right = np.sign(first), np.sign(second)
    first_toggled, last_toggled = toggled_edges(chain, leg)
    left[0] *= -1 if first_toggled else 1
    right[-1] *= -1 if last_toggled else 1
    left.flags.writeable = right.flags.writeable = False
    return left, right


def toggled_edges(chain: Chain, leg: int) -> tuple[bool, bool]:
    """Return whether the first, and whether the last rotor of a flipper is toggled in a leg.

    A toggled rotor has another angle than in an infinite chain (see `static_wall`). `Orbit`
    defines toggled differently, by the sign of the lever in the left-leaning state. On the left of
    a wall the chain leans right, and for d > 1 the lever A_0 has opposite signs in the two states.
    Therefore, the two definitions give opposite results for the first rotor if d > 1.
    """
    if chain.motion is Motion.SPINNER:
        return False, False
    return (leg in (2, 3)) == (chain.lean_ratio <= 1), leg in (1, 2)


def follow_zero_mode(
    chain: Chain,
    tangent: Callable[[Array], Array],
    start: Array,
    goal: Array,
    tolerances: tuple[float, float],
) -> Iterator[tuple[float, float, DenseOutput]]:
    """Yield the solver steps along an orbit from `start` to `goal` [rad] as (begin, end, angles).

    `tangent` returns the tangent at a configuration. `tolerances` are the relative [1] and the
    absolute [rad] tolerance of the solver. `begin` and `end` are arc lengths from `start` [rad],
    and `angles` is a function that interpolates the angles between them. Raises ArithmeticError if
    `goal` is not reached.
    """
    limits = dict(zip(('rtol', 'atol'), tolerances, strict=True))
    solver = DOP853(lambda _, angles: tangent(angles), 0.0, start, np.inf, **limits)
    at_goal = tangent(goal)
    for _ in range(_MOST_STEPS):
        if solver.step():
            break
        dense = solver.dense_output()
        end = _arrival(dense, goal, at_goal)
        yield solver.t_old, solver.t if end is None else end, dense
        if end is not None:
            return
    raise ArithmeticError(
        f'the wall of a chain with d = {chain.lean_ratio:.9g} and d_c = '
        f'{chain.critical_lean_ratio:.9g} did not reach its next symmetric configuration within '
        f'an arc of {solver.t:.3g} rad; take parameters further from the transition'
    )


def _arrival(dense: DenseOutput, goal: Array, tangent: Array) -> float | None:
    def to_go(arc: float) -> float:
        return float(np.sin(goal - dense(arc)) @ tangent)

    if to_go(dense.t_old) < 0 or to_go(dense.t) > 0:
        return None
    arc = float(brentq(to_go, dense.t_old, dense.t, xtol=1e-15))
    distance = np.abs(np.sin((dense(arc) - goal) / 2)).max()
    return arc if distance < _ARRIVED else None


def _uniform_state(chain: Chain, lean: int, inverted: bool) -> Array:
    theta = lean * chain.rest_angle
    if chain.motion is Motion.SPINNER and lean < 0:
        theta = chain.rest_angle + math.pi
    return staggered(np.full(chain.number_of_rotors, math.pi - theta if inverted else theta))


def _seed_angle(chain: Chain, seed: int, beyond: float, leg: int, inverted: bool) -> float:
    """Return the angle [rad] of rotor `seed` if the wall is `beyond` spacings past this rotor."""
    if chain.motion is not Motion.SPINNER:
        leg = 0
    elif inverted:
        leg = 1 - leg
    ahead = round(beyond)
    passage = _passage(_shape(chain), leg, (seed + ahead) % 2 == 1)
    angle = passage.angle(beyond - ahead, -ahead)
    return math.pi - angle if inverted else angle


def _symmetric_wall(chain: Chain, rotor: int, leg: int) -> Array:
    """Return the angles of a wall in the middle between `rotor` and the next rotor [rad], (N,).

    The reflection n -> 2 rotor + 1 - n changes phi to phi + pi in flippers and to -phi in
    spinners. The bar between the two rotors has the length lbar. Therefore r sin(phi) of `rotor`
    is r^2 sin(theta_bar)^2 / a in flippers. In spinners, r sin(phi) is (a - lbar) / 2 if `leg` +
    `rotor` is even, and (a + lbar) / 2 if it is odd. In flippers, cos(phi) is positive if `rotor`
    is even; in spinners, it is positive in leg 0.
    """
    spinner, crossed = chain.motion is Motion.SPINNER, False
    if spinner:
        crossed = (leg + rotor) % 2 == 1
        h = (chain.spacing + (chain.rest_length if crossed else -chain.rest_length)) / 2
    else:
        h = (chain.rotor_length * math.sin(chain.rest_angle)) ** 2 / chain.spacing
    angle = math.asin(h / chain.rotor_length)
    upright = (rotor % 2 == 0) != crossed
    branches = bar_branches(chain, leg if spinner else 0, False)
    return angles_from_seed(chain, rotor, angle if upright else math.pi - angle, *branches)


@lru_cache(maxsize=64)
def _shape(chain: Chain) -> Chain:
    # Chains that differ only in masses, springs or motors have the same walls, which are cached
    # once.
    return Chain(3, chain.spacing, chain.rotor_length, chain.rest_angle)


def _rotors_beside(chain: Chain) -> int:
    """Return the number of rotors to compute on each side of a wall; ValueError if too many."""
    d, critical = chain.lean_ratio, chain.critical_lean_ratio
    if abs(d - critical) < _TRANSITION * critical:
        raise ValueError(
            f'd = {d:.12g} is too near to d_c = {critical:.12g} to distinguish orbits of '
            f'flippers and spinners; take d further than {_TRANSITION:g} d_c from it'
        )
    beside = math.ceil(_DEPTHS_BESIDE * penetration_depth(chain) / chain.spacing) + 10
    if beside > _MOST_BESIDE:
        raise ValueError(
            f'd = {chain.lean_ratio:.6g} makes a wall extend over {beside} rotors on each side, '
            f'more than {_MOST_BESIDE}; take longer rotors or a larger rest angle'
        )
    return beside


class _SitePassage:
    """Motion of a wall past one rotor, by one rotor spacing; `arc` is its arc length [rad]."""

    def __init__(self, chain: Chain, leg: int, odd: bool) -> None:
        beside = _rotors_beside(chain)
        self._rotor = 2 * (beside // 2) + odd
        window = replace(chain, number_of_rotors=2 * self._rotor + 1)
        goal = _symmetric_wall(window, self._rotor, leg)
        start = _symmetric_wall(window, self._rotor - 1, leg)
        mode = zero_mode(window, start)
        sense = 1.0 if mode @ mode_towards_last(window, start) > 0 else -1.0

        def tangent(angles: Array) -> Array:
            return sense * zero_mode(window, angles)

        steps = follow_zero_mode(window, tangent, start, goal, (_TOLERANCE, _TOLERANCE))
        _, ends, pieces = zip(*steps, strict=True)
        self.arc = float(ends[-1])
        self._solution = OdeSolution([0.0, *ends], list(pieces))

    def angle(self, beyond: float, other: int = 0) -> float:
        """Return the angle [rad] of the rotor that is `other` rotors after the passed rotor.

        The wall is `beyond` rotor spacings (-1/2 to 1/2) beyond the passed rotor.
        """
        return float(self._solution((beyond + 0.5) * self.arc)[self._rotor + other])


_passage = lru_cache(maxsize=64)(_SitePassage)
