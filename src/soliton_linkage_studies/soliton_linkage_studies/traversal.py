# SPDX-License-Identifier: Apache-2.0
"""Simulation of a wall from edge to edge of a chain of rigid bars; deviations may stop it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import Edge, edge_mode, mode_centre, rigidity_bands, zero_mode
from soliton_linkage.linear.statics import rest_state
from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage.solitons.passage import find_obstacles

_TOLERANCE = 1e-8
"""Tolerance of an angle in a step [rad]."""
_FRAMES_A_SPACING = 4.0
"""Number of frames while a wall moves by a rotor spacing, or by its width [1]."""
_FRAMES_A_SWING = 40.0
"""Number of frames while an edge rotor swings by 1 rad, or by spacing / rotor length if this is
smaller [1]."""
_DEPARTED = 1.5
"""Distance at which the wall of a spinner has left an edge [rotor spacings]."""


@dataclass(frozen=True)
class Leg:
    """Motion of a wall from one edge of the chain towards the other."""

    direction: int
    """+1 towards the last rotor, -1 towards rotor 0."""
    crossed: bool
    """Whether the wall reached the other edge."""
    furthest: float
    """Largest distance of the wall from its first edge, as a position [rotor spacings]."""
    arc: float
    """Arc length of the motion [rad], the norm over all rotors."""


def follow_wall(chain: Chain, edge: Edge = Edge.FIRST, legs: int = 2) -> tuple[Leg, ...]:
    """Simulate the chain with rigid bars until its wall has crossed it `legs` times.

    For the first edge the simulation starts in the left-leaning rest state, for the last edge in
    the right-leaning rest state. It ends early if the wall turns back, or if the arc length
    exceeds 4 pi [rad] per rotor. The wall position is the centre of the zero mode. The wall of a
    flipper reaches an edge when the edge rotor passes the line from its pivot to the mass of its
    neighbour. At this instant the mode is localised on this rotor. A flipper first moves to the
    nearest edge. The wall of a spinner reaches an edge when the mode is largest there.

    Raises:
        ValueError: If the ends are periodic, `legs` is less than 1 or no rest state exists.
        ArithmeticError: If the bars jam.
    """
    _check_ends(chain)
    if legs < 1:
        raise ValueError(f'legs = {legs} must be 1 or more; give 2 for a crossing and a return')
    angles = rest_state(chain, 1 if edge is Edge.LAST else -1)
    mode = edge_mode(chain, angles, edge, anywhere=True)
    spinner = chain.motion is Motion.SPINNER
    rates = mode if spinner else -mode
    simulation = RigidSimulation(chain, angles, rates, _frame_arc(chain), _TOLERANCE)
    start = chain.number_of_rotors - 1 if edge is Edge.LAST else 0
    walker = _Walker(simulation, start)
    if not spinner:
        walker.leg()
    ways: list[Leg] = []
    while len(ways) < legs and (not ways or ways[-1].crossed):
        ways.append(walker.leg())
    return tuple(ways)


def check_passable(chain: Chain) -> None:
    """Raise ValueError if a wall cannot pass through the chain and return.

    Chains with periodic ends are rejected too, because they have no edges.
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
    """Simulation of a rigid-bar chain that detects arrivals of the wall at the edges."""

    def __init__(self, simulation: RigidSimulation, edge: int) -> None:
        self._simulation = simulation
        self._last = simulation.chain.number_of_rotors - 1
        self._longest = 4 * math.pi * simulation.chain.number_of_rotors
        self._edge = edge
        self._update()

    def leg(self) -> Leg:
        """Simulate from the current wall position until the wall reaches an edge."""
        start, left = self._simulation.frame, self._edge
        direction = -1 if left else 1
        departure = furthest = self._centre
        arrived, arc = None, 0.0
        while arrived is None and arc <= self._longest:
            edges = self._edges
            self._simulation.advance()
            self._update()
            furthest = direction * max(direction * furthest, direction * self._centre)
            departed = direction * (furthest - departure) > _DEPARTED
            arrived = self._arrived(edges, left, departed)
            arc = (self._simulation.frame - start) * self._simulation.period
        if arrived is not None:
            self._edge = arrived
        return Leg(direction, arrived == self._last - left, furthest, arc)

    def _update(self) -> None:
        """Update the centre and the peak of the mode, and the side of each edge rotor."""
        chain, angles = self._simulation.chain, self._simulation.angles
        mode = zero_mode(chain, angles)
        first, second = rigidity_bands(chain, angles)
        self._centre = mode_centre(mode)
        self._peak = int(np.argmax(np.abs(mode)))
        self._edges = (bool(first[0] > 0), bool(second[-1] > 0))

    def _arrived(self, before: tuple[bool, bool], left: int, departed: bool) -> int | None:
        """Return the edge rotor that the wall reached in the last frame, or None."""
        if self._simulation.chain.motion is not Motion.SPINNER:
            passed = [self._edges[0] != before[0], self._edges[1] != before[1]]
            return 0 if passed[0] else self._last if passed[1] else None
        at_edge = self._peak in (0, self._last) and (self._peak != left or departed)
        return self._peak if at_edge else None


def _frame_arc(chain: Chain) -> float:
    """Return the arc length of a frame [rad], which is also its duration [s] at 1 rad/s.

    The rotors of a flipper turn by 2 theta_bar while the wall moves by its width. A lower limit of
    the arc resolves the swing of an edge rotor at a reflection, about a / r but at most 1 rad.
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
