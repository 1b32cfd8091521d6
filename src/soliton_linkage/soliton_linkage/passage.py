# SPDX-License-Identifier: Apache-2.0
"""Whether a wall passes through a chain whose rotors and springs deviate.

Two neighbouring rotors, the line between their pivots and their spring make a four-bar linkage.
While every bond is one of the same class the wall passes whatever the deviations; where a bond
is of another class the rotors meet an end of their travel before the wall is through.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.chain import Array, Chain, Motion
from soliton_linkage.rigid_simulation import RigidSimulation
from soliton_linkage.rigidity import mode_centre, rigidity_bands, zero_mode
from soliton_linkage.statics import rest_state

_TOLERANCE = 1e-8
_FRAMES_A_SPACING = 4
_FRAMES_A_SWING = 40
_DEPARTED = 1.5


@dataclass(frozen=True)
class Obstacle:
    """A bond that may stop a wall, with its lengths [m]."""

    bond: int
    """Number of the spring, which joins the rotors bond and bond + 1."""
    spacing: float
    rotor_lengths: tuple[float, float]
    rest_length: float
    reason: str
    """What is broken, with the values and their limit."""


@dataclass(frozen=True)
class Leg:
    """The way of a wall from one edge of the chain towards the other."""

    direction: int
    """+1 towards the last rotor, -1 towards rotor 0."""
    crossed: bool
    """Whether it reached the other edge."""
    furthest: float
    """Where it was furthest from the edge that it left [rotor spacings]."""
    arc: float
    """Arc length of the motion [rad], the norm over all rotors."""


def reaches(chain: Chain) -> Array:
    """By how much the two rotors of each bond are longer than its spring [m], shape (springs,).

    r_n + r_{n+1} - lbar_n. Without deviations it is below 0 for d < 1, where flippers do not
    wobble, and above a for d > d_c, where the rotors spin: 4 r^2 - lbar^2 = a^2 (d^2 - 1).
    """
    lengths = chain.rotor_lengths
    left, right = _joined(chain)
    return np.asarray(lengths[left] + lengths[right] - chain.rest_lengths)


def blocked_bonds(chain: Chain) -> NDArray[np.bool_]:
    """Bonds that may stop a wall, shape (springs,); a wall surely passes where there is none.

    A wall passes, and returns, if on every bond lbar_n > a_n + |r_n - r_{n+1}| and if
    r_n + r_{n+1} - a_n - lbar_n has the same sign on all of them: below 0 each is a triple
    rocker, as in flippers, and above 0 a double crank, as in spinners (Grashof). The sign wanted
    is that of most bonds. This is sufficient: a wall may pass all the same.
    """
    excess = reaches(chain) - chain.spacings
    odd = ~(excess > 0) if _spinning(chain) else ~(excess < 0)
    return np.asarray(odd | ~(chain.rest_lengths > _shortest(chain)))


def find_obstacles(chain: Chain) -> tuple[Obstacle, ...]:
    """Return the blocked bonds with their lengths and the reason, in their order."""
    lengths, shortest = chain.rotor_lengths, _shortest(chain)
    relation = 'shorter' if _spinning(chain) else 'longer'
    left, right = _joined(chain)
    obstacles = []
    for bond in np.flatnonzero(blocked_bonds(chain)).tolist():
        first, second = float(lengths[left[bond]]), float(lengths[right[bond]])
        spacing, rest = float(chain.spacings[bond]), float(chain.rest_lengths[bond])
        if rest <= shortest[bond]:
            limit = shortest[bond]
            reason = f'must be longer than {limit:.6g} m, a + |r_n - r_(n+1)|'
        else:
            limit = first + second - spacing
            reason = f'must be {relation} than {limit:.6g} m, r_n + r_(n+1) - a, as on most bonds'
        obstacles.append(Obstacle(bond, spacing, (first, second), rest, reason))
    return tuple(obstacles)


def motion_of_bonds(chain: Chain) -> Motion | None:
    """How a wall moves along a chain with its deviations, or None where a bond may stop it.

    Where none may, it is a spinner if r_n + r_{n+1} - lbar_n is above a_n on every bond, a
    flipper if it is below 0 on every bond, and wobbles if it is not.
    """
    if blocked_bonds(chain).any():
        return None
    if _spinning(chain):
        return Motion.SPINNER
    return Motion.WOBBLING_FLIPPER if (reaches(chain) > 0).any() else Motion.FLIPPER


def follow_wall(chain: Chain, edge: Edge = Edge.FIRST, legs: int = 2) -> tuple[Leg, ...]:
    """Move the chain of rigid bars until its wall has crossed it a number of times.

    It starts from the first edge, in the state at rest that leans left, or from the last, in
    that which leans right. A leg that does not reach the other edge ends it: the wall has come
    back, or the motion is longer than two turns of every rotor. The place of a wall is the
    centre of the zero mode. A flipper's has reached an edge when the rotor there passes the line
    from its pivot to its neighbour's mass, where the mode is on this rotor alone; it goes to the
    nearest edge first. A spinner's has reached an edge when the mode is largest there. Raises
    ValueError for periodic ends, for fewer legs than one and where there is no state to start
    from, ArithmeticError where the bars jam.
    """
    _check_ends(chain)
    if legs < 1:
        raise ValueError(f'legs = {legs} must be 1 or more; give 2 for a way there and back')
    angles = rest_state(chain, 1 if edge is Edge.LAST else -1)
    mode = edge_mode(chain, angles, edge, anywhere=True)
    spinner = chain.motion is Motion.SPINNER
    rates = mode if spinner else -mode
    simulation = RigidSimulation(chain, angles, rates, _frame_arc(chain), _TOLERANCE)
    walker = _Walker(simulation, chain.number_of_rotors - 1 if edge is Edge.LAST else 0)
    if not spinner:
        walker.leg()
    ways: list[Leg] = []
    while len(ways) < legs and (not ways or ways[-1].crossed):
        ways.append(walker.leg())
    return tuple(ways)


def check_passable(chain: Chain) -> None:
    """Raise ValueError where a wall does not pass through the chain and return.

    No wall passes through a chain with periodic ends, which has no edges.
    """
    _check_ends(chain)
    obstacles = find_obstacles(chain)
    if not obstacles:
        return
    last = follow_wall(chain)[-1]
    if last.crossed:
        return
    obstacle = min(obstacles, key=lambda one: abs(one.bond + 0.5 - last.furthest))
    first, second = obstacle.rotor_lengths
    raise ValueError(
        f'the wall turns back at rotor {last.furthest:.1f} of 0 to {chain.number_of_rotors - 1}: '
        f'on bond {obstacle.bond} between rotors of {first:.6g} m and {second:.6g} m, '
        f'{obstacle.spacing:.6g} m apart, the spring of {obstacle.rest_length:.6g} m '
        f'{obstacle.reason}; lower the deviations of the chain there'
    )


class _Walker:
    """Moves a chain of rigid bars and watches its wall come to the edges."""

    def __init__(self, simulation: RigidSimulation, edge: int) -> None:
        self._simulation = simulation
        self._last = simulation.chain.number_of_rotors - 1
        self._longest = 4 * math.pi * simulation.chain.number_of_rotors
        self._edge = edge
        self._look()

    def leg(self) -> Leg:
        """Move from where the wall is now until it comes to an edge."""
        start, left = self._simulation.frame, self._edge
        direction = -1 if left else 1
        departure = furthest = self._centre
        arrived, arc = None, 0.0
        while arrived is None and arc <= self._longest:
            edges = self._edges
            self._simulation.advance()
            self._look()
            furthest = direction * max(direction * furthest, direction * self._centre)
            departed = direction * (furthest - departure) > _DEPARTED
            arrived = self._arrived(edges, left, departed)
            arc = (self._simulation.frame - start) * self._simulation.period
        if arrived is not None:
            self._edge = arrived
        return Leg(direction, arrived == self._last - left, furthest, arc)

    def _look(self) -> None:
        """Note where the mode is, and on which side of their neighbours the edge rotors are."""
        chain, angles = self._simulation.chain, self._simulation.angles
        mode = zero_mode(chain, angles)
        first, second = rigidity_bands(chain, angles)
        self._centre = mode_centre(mode)
        self._peak = int(np.argmax(np.abs(mode)))
        self._edges = (bool(first[0] > 0), bool(second[-1] > 0))

    def _arrived(self, before: tuple[bool, bool], left: int, departed: bool) -> int | None:
        """Rotor of the edge that the wall has come to in the last frame, if any."""
        if self._simulation.chain.motion is not Motion.SPINNER:
            passed = [self._edges[0] != before[0], self._edges[1] != before[1]]
            return 0 if passed[0] else self._last if passed[1] else None
        at_edge = self._peak in (0, self._last) and (self._peak != left or departed)
        return self._peak if at_edge else None


def _frame_arc(chain: Chain) -> float:
    """Arc [rad] in which a wall goes a fraction of a spacing, at a speed of 1 rad/s its time.

    A flipper's rotors turn by 2 theta_bar while the wall goes by its width. However little that
    is, an edge rotor swings by about a / r, or a radian, before the wall comes back.
    """
    spacings = 1 + chain.wall_width / chain.spacing
    of_wall = chain.rest_angle / (_FRAMES_A_SPACING * math.sqrt(spacings))
    swing = min(1.0, chain.spacing / chain.rotor_length)
    return max(of_wall, swing / _FRAMES_A_SWING)


def _check_ends(chain: Chain) -> None:
    if chain.periodic:
        raise ValueError(
            f'Chain.periodic = True joins rotor {chain.number_of_rotors - 1} to rotor 0, so that '
            'no wall can run from edge to edge; free the ends of the chain'
        )


def _joined(chain: Chain) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the left and the right rotor of each spring."""
    left = np.arange(chain.number_of_springs)
    return left, (left + 1) % chain.number_of_rotors


def _shortest(chain: Chain) -> Array:
    """Limit above which a spring reaches round both rotors [m], a_n + |r_n - r_{n+1}|."""
    left, right = _joined(chain)
    return np.asarray(
        chain.spacings + np.abs(chain.rotor_lengths[left] - chain.rotor_lengths[right])
    )


def _spinning(chain: Chain) -> bool:
    """Whether most bonds are double cranks."""
    excess = reaches(chain) - chain.spacings
    return 2 * int(np.count_nonzero(excess > 0)) > len(excess)
