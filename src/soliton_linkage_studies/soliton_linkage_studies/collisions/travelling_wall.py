# SPDX-License-Identifier: Apache-2.0
"""Travelling walls that change their shape as little as possible in the discrete chain.

A wall of velocity v that keeps its shape turns the rotors of parity p (0 even, 1 odd) to the
angles phi_n(t) = f_p(n a - v t). At the rotor n, with x = n a - v t, the equation of motion is

    I v^2 f_p''(x) = spring torque for the angles f_(1-p)(x - a), f_p(x), f_(1-p)(x + a).

The functions f_p are computed on a grid. The solver minimises the squared residual plus a penalty
on tails that are not at rest. No exact solution exists, because a wall of a few rotors radiates a
resonant phonon at any speed. The contracted wall of the continuum theory would oscillate about the
shape computed here, and these oscillations would disturb a collision.
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
"""Half length of the grid, divided by twice the penetration depth l [1]."""
_QUIET_FROM = 4.0
"""The penalty on moving tails starts at this distance from the wall, divided by 2 l [1]. From 1.5
times this distance on, the penalty has its full strength."""
_QUIETNESS = 0.05
"""Strength of the penalty on moving tails, divided by I omega_0^2 [1], with the moment of inertia
I and the lowest phonon frequency omega_0. Sensitivity at initial speeds of 0.3 to 0.5 c, with the
speed of sound c: at 0.01 or 0.2, the speed after a collision changes by up to 3e-4 c."""
_POINTS_A_WIDTH = 12
"""Number of grid points per wall width [1]. Sensitivity at initial speeds of 0.3 to 0.5 c, with
the speed of sound c: at 2x, the speed after a collision changes by up to 7e-4 c."""
_ITERATIONS = 20
"""Largest number of Gauss-Newton iterations [1]; a search converges within ten iterations or not
at all."""
_LONGEST_STEP = 0.3
"""Largest change of an angle in one iteration [rad]; with longer steps, searches diverge."""
_CONVERGED = 1e-8
"""The search ends when the largest change of an angle in an iteration is below this [rad]."""
_CLOSEST = 0.9
"""Largest v / c of the initial guess [1], because continuum walls are never supersonic."""
_FIRST = (0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""Weights of the centre and of the points ahead in the stencil of order 8 for the first derivative
[1]; points behind have the opposite weights."""
_SECOND = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)
"""Weights of the centre and of the points ahead in the stencil of order 8 for the second
derivative [1]; points behind have the same weights."""


@dataclass(frozen=True)
class TravellingWall:
    """Travelling wall, sampled at evenly spaced distances from its centre."""

    points: int
    """Number of grid points per rotor spacing."""
    angles: Array
    """Angles of even and of odd rotors [rad], shape (2, J); the centre has the index J // 2."""
    slopes: Array
    """Derivatives of the angles along the chain [rad per spacing], shape (2, J)."""

    def at(self, rotors: NDArray[np.int64], position: float) -> tuple[Array, Array]:
        """Return the angles [rad] and slopes [rad/spacing] of `rotors`, each of shape (K,).

        The wall is at `position` [rotor spacings], rounded to a grid point.
        """
        last = self.angles.shape[1] - 1
        columns = np.rint((rotors - position) * self.points).astype(int) + (last + 1) // 2
        inside = (columns >= 0) & (columns <= last)
        columns = np.clip(columns, 0, last)
        return self.angles[rotors % 2, columns], self.slopes[rotors % 2, columns] * inside


def travelling_wall(chain: Chain, speed: float, charge: int, turn: int = 1) -> TravellingWall:
    """Return the wall of charge +1 or -1 that moves at `speed` [m/s].

    In a spinner, `turn` is the sign of the angle by which the wall turns the rotors (see
    `SpinnerTheory`). Raises ArithmeticError if the solver finds no wall near the continuum
    solution.
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
        f'found no travelling wall of charge {charge} in a chain with d = {chain.lean_ratio:.3g} '
        f'at {speed / speed_of_sound(chain):.3g} of the speed of sound; choose another speed'
    )


class _Grid:
    """Equations on the grid; arrays of angles contain first all even, then all odd rotors."""

    def __init__(self, ring: Chain) -> None:
        width, depth = ring.wall_width / ring.spacing, penetration_depth(ring) / ring.spacing
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
    def positions(self) -> Array:
        spacing = self.chain.spacing / self.points
        return np.asarray((np.arange(self.count) - self.count // 2) * spacing)

    def guess(self, speed: float, charge: int, turn: int) -> Array:
        chain = self.chain
        slow = min(speed, _CLOSEST * speed_of_sound(chain))
        if chain.motion is Motion.SPINNER:
            theory = SpinnerTheory(chain)
            even, odd = (
                theory.staggered_angles(self.positions, sublattice, 0.0, slow, charge, turn)
                for sublattice in (0, 1)
            )
        else:
            lean = FlipperTheory(chain).displacements(self.positions, 0.0, slow, charge)
            even = odd = np.arcsin(lean / chain.rotor_length)
        return np.concatenate([even, np.pi - odd])

    def correction(self, angles: Array, start: Array, moving: float) -> Array:
        """Return the Gauss-Newton step from `angles` [rad] that does not shift the wall.

        The ends of `start` [rad] give the rest angles of the tails. `moving` is the factor of the
        second derivative in the equation of motion [N m].
        """
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
        depth, chain = penetration_depth(self.chain), self.chain
        beyond = np.abs(self.positions) / (2 * depth * _QUIET_FROM) - 1
        strength = _QUIETNESS * chain.moment_of_inertia * gap(chain) ** 2
        return np.tile((strength * np.clip(2 * beyond, 0, 1)) ** 2, 2)

    def _rest(self, angles: Array) -> Array:
        half = self.count // 2
        sides = angles.reshape(2, -1)[:, [0, -1]]
        return np.repeat(sides, [half, self.count - half], axis=1).ravel()

    def _stiffness(self, angles: Array) -> csr_array:
        each = [coo_array(stiffness_matrix(self.chain, angles[row])) for row in self._index]
        rows, columns = (
            np.concatenate([row[sites] for row, sites in zip(self._index, found, strict=True)])
            for found in ([one.row for one in each], [one.col for one in each])
        )
        entries = np.concatenate([one.data for one in each])
        return csr_array((entries, (rows, columns)), shape=(len(angles), len(angles)))

    def _derivative(self, weights: tuple[float, ...], mirrored: int) -> csr_array:
        """Return a stencil matrix; weights behind are `mirrored` (+1 or -1) times those ahead."""
        reach = len(weights) - 1
        offsets = list(range(-reach, reach + 1))
        values = [weights[abs(k)] * (1 if k >= 0 else mirrored) for k in offsets]
        one = diags_array(values, offsets=offsets, shape=(self.count, self.count)).tolil()
        one[:reach], one[-reach:] = 0, 0
        return csr_array(block_array([[one, None], [None, one]]))
