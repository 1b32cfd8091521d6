# SPDX-License-Identifier: Apache-2.0
"""Walls that travel along the discrete chain and keep their shape as well as they can.

A rotor of parity p (0 even, 1 odd) at a distance x from the wall has the angle f_p(x). A wall of
velocity v that keeps its shape, phi_n(t) = f_p(n a - v t), balances

    I v^2 f_p''(x) = torque of the springs (f_(1-p)(x - a), f_p(x), f_(1-p)(x + a)).

On a grid of m points a spacing these are 2 m chains, shifted against each other, which the
derivatives couple. What is found leaves least of the balance with tails that are at rest, since
a wall of a few rotors is in step with some phonon at any speed and radiates it. A wall that was
only contracted as the continuum says would swing about its shape, and so would meet another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from soliton_linkage.linear.bands import gap, penetration_depth, speed_of_sound
from soliton_linkage.linear.statics import stiffness_matrix
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.continuum import FlipperTheory, SpinnerTheory

_REACH = 11.0
"""Of the grid on both sides in 2 l, l the penetration depth [1]: tails e^(-x / l) are cut."""
_QUIET_FROM = 4.0
"""Distance in 2 l from which the tails are held to rest, more and more up to half as far again."""
_QUIETNESS = 0.05
"""How strongly they are held, over I gap^2 [1]; 0.01 and 0.2 change speeds afterwards by 1e-4."""
_POINTS_A_WIDTH = 12
"""Of the grid [1]; twice as many change no speed afterwards by 1e-5."""
_ITERATIONS = 20
"""Of Gauss and Newton's method [1], which converges within ten or not at all."""
_LONGEST_STEP = 0.3
"""Of an angle in one iteration [rad]: longer ones leave the wall."""
_CONVERGED = 1e-8
"""Change of an angle after which the next one is nothing [rad], as it converges."""
_CLOSEST = 0.9
"""To the speed of sound [1], for a first guess of walls that outrun it."""
_FIRST = (0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""First derivative of order 8 at a point and at those ahead [1], the opposite behind."""
_SECOND = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)
"""Second derivative of order 8 [1], the same on both sides."""


@dataclass(frozen=True)
class TravellingWall:
    """A wall on a grid of places from its centre."""

    points: int
    """Of the grid, in a rotor spacing."""
    angles: Array
    """Actual angles of even and of odd rotors [rad], shape (2, J), the centre at J // 2."""
    slopes: Array
    """Their change along the chain [rad a spacing], shape (2, J)."""

    def at(self, rotors: NDArray[np.int64], place: float) -> tuple[Array, Array]:
        """Angles [rad] and slopes [rad a spacing] of rotors by number, (K,), about a place.

        The place [rotor spacings] is rounded to the grid.
        """
        last = self.angles.shape[1] - 1
        columns = np.rint((rotors - place) * self.points).astype(int) + (last + 1) // 2
        inside = (columns >= 0) & (columns <= last)
        columns = np.clip(columns, 0, last)
        return self.angles[rotors % 2, columns], self.slopes[rotors % 2, columns] * inside


def travelling_wall(chain: Chain, speed: float, charge: int, turn: int = 1) -> TravellingWall:
    """Wall of a charge +1 or -1 that moves at a speed [m/s], in either direction.

    Of spinners the rotors turn forwards (turn +1) or backwards (-1), see `SpinnerTheory`. Raises
    ArithmeticError where there is none near that of the continuum.
    """
    grid = _Grid(chain)
    start = grid.guess(speed, charge, turn)
    angles = start
    moving = chain.moment_of_inertia * (speed * grid.points / chain.spacing) ** 2
    for _ in range(_ITERATIONS):
        step = grid.correction(angles, start, moving)
        longest = float(np.abs(step).max())
        angles = angles + step * min(1.0, _LONGEST_STEP / longest)
        if longest < _CONVERGED:
            slopes = grid.points * (grid.first @ angles)
            return TravellingWall(grid.points, angles.reshape(2, -1), slopes.reshape(2, -1))
    raise ArithmeticError(
        f'no wall of charge {charge} travels along a chain with d = {chain.lean_ratio:.3g} at '
        f'{speed / speed_of_sound(chain):.3g} of the speed of sound, as far as was found; take '
        'another speed'
    )


class _Grid:
    """Angles of both parities on a grid, flat: those of even rotors, then those of odd ones."""

    def __init__(self, ring: Chain) -> None:
        width, depth = (
            length / ring.spacing for length in (ring.wall_width, penetration_depth(ring))
        )
        self.points = max(1, math.ceil(_POINTS_A_WIDTH / width))
        sites = 2 * math.ceil(2 * _REACH * depth) + 8
        lengths = ring.spacing, ring.rotor_length, ring.rest_angle
        self.chain = Chain(sites, *lengths, ring.mass, ring.stiffness)
        self.count = sites * self.points
        site, shift = np.arange(sites), np.array([[[0]], [[1]]])
        offset = np.arange(self.points)[:, None]
        index = self.count * ((site + shift) % 2) + self.points * site + offset
        self._index = index.reshape(-1, sites)
        margin = len(_FIRST) + self.points
        column = np.arange(2 * self.count) % self.count
        self._free = np.flatnonzero((column >= margin) & (column < self.count - margin))
        self.first = self._derivative(_FIRST, -1)
        self._second = self._derivative(_SECOND, 1)

    @cached_property
    def places(self) -> Array:
        """Of the points from the wall [m], shape (J,)."""
        spacing = self.chain.spacing / self.points
        return np.asarray((np.arange(self.count) - self.count // 2) * spacing)

    def guess(self, speed: float, charge: int, turn: int) -> Array:
        """Wall of the continuum [rad], flat."""
        chain = self.chain
        slow = min(speed, _CLOSEST * speed_of_sound(chain))
        if chain.motion is Motion.SPINNER:
            theory = SpinnerTheory(chain)
            even, odd = (
                theory.staggered_angles(self.places, sublattice, 0.0, slow, charge, turn)
                for sublattice in (0, 1)
            )
        else:
            lean = FlipperTheory(chain).displacements(self.places, 0.0, slow, charge)
            even = odd = np.arcsin(lean / chain.rotor_length)
        return np.concatenate([even, np.pi - odd])

    def correction(self, angles: Array, start: Array, moving: float) -> Array:
        """Step of Gauss and Newton's method that does not shift the wall [rad], flat."""
        free, chain = self._free, self.chain
        torques = np.empty_like(angles)
        torques[self._index] = chain.spring_torques(angles[self._index])
        left = (moving * (self._second @ angles) - torques)[free]
        matrix = (moving * self._second + self._stiffness(angles)).tocsr()[free][:, free]
        held = self._held[free]
        normal = matrix.T @ matrix + diags_array(held)
        pull = matrix.T @ left + held * (angles - self._rest(start))[free]
        along = (self.first @ angles)[free] * float(normal.diagonal().mean())
        tangent = coo_array(along[:, None])
        bordered = block_array([[normal, tangent], [tangent.T, None]], format='csc')
        step = np.zeros_like(angles)
        step[free] = splu(bordered).solve(np.append(-pull, 0.0))[:-1]
        return step

    @cached_property
    def _held(self) -> Array:
        """Square of the strength with which each point is held to rest, flat."""
        depth, chain = penetration_depth(self.chain), self.chain
        beyond = np.abs(self.places) / (2 * depth * _QUIET_FROM) - 1
        strength = _QUIETNESS * chain.moment_of_inertia * gap(chain) ** 2
        return np.tile((strength * np.clip(2 * beyond, 0, 1)) ** 2, 2)

    def _rest(self, angles: Array) -> Array:
        """Uniform states on both sides of a wall, flat."""
        half = self.count // 2
        sides = angles.reshape(2, -1)[:, [0, -1]]
        return np.repeat(sides, [half, self.count - half], axis=1).ravel()

    def _stiffness(self, angles: Array) -> csr_array:
        """Minus the change of the torques with the angles, on the grid."""
        each = [coo_array(stiffness_matrix(self.chain, angles[row])) for row in self._index]
        rows, columns = (
            np.concatenate([row[sites] for row, sites in zip(self._index, found, strict=True)])
            for found in ([one.row for one in each], [one.col for one in each])
        )
        entries = np.concatenate([one.data for one in each])
        return csr_array((entries, (rows, columns)), shape=(len(angles), len(angles)))

    def _derivative(self, weights: tuple[float, ...], mirrored: int) -> csr_array:
        """Differences of both parities by a step of the grid; points at its ends have none."""
        reach = len(weights) - 1
        offsets = list(range(-reach, reach + 1))
        values = [weights[abs(k)] * (1 if k >= 0 else mirrored) for k in offsets]
        one = diags_array(values, offsets=offsets, shape=(self.count, self.count)).tolil()
        one[:reach], one[-reach:] = 0, 0
        return csr_array(block_array([[one, None], [None, one]]))
