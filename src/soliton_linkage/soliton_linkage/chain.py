# SPDX-License-Identifier: Apache-2.0
"""The chain of rotors: its geometry, energy and torques.

Neighbouring masses are joined by springs whose squared length differs from that at rest by

    e_n = l_n^2 - lbar^2 = c + 2 a (h_{n+1} - h_n) - 2 (h_n h_{n+1} + v_n v_{n+1}),
    c = a^2 + 2 r^2 - lbar^2 = -2 r^2 cos(2 theta_bar),

with h = r sin(phi), v = r cos(phi). Lengths and energies are computed from e_n, in which
nothing of the size of l^2 cancels: a relaxed spring has its length at rest to rounding.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soliton_linkage.quantities import check_quantities, quantity

Array = NDArray[np.float64]


class Motion(enum.Enum):
    """How a wall moves along a chain (paper, 'Topology of the unit cell')."""

    FLIPPER = 'flipper'
    WOBBLING_FLIPPER = 'wobbling flipper'
    SPINNER = 'spinner'


@dataclass(frozen=True)
class Chain:
    """Parameters of a uniform chain with free ends; raises ValueError where they are invalid."""

    number_of_rotors: int = quantity(40, 'number of rotors', '', 2, 100_000)
    spacing: float = quantity(0.1, 'distance between neighbouring pivots', 'm', 1e-6, 1e3)
    rotor_length: float = quantity(0.05, 'distance from pivot to mass', 'm', 1e-6, 1e3)
    rest_angle: float = quantity(
        0.97, 'staggered angle of the uniform right-leaning state', 'rad', 1e-3, 1.57
    )
    mass: float = quantity(0.02, 'mass at the end of each rotor', 'kg', 1e-9, 1e6)
    stiffness: float = quantity(50.0, 'stiffness of each spring', 'N/m', 1e-9, 1e12)

    def __post_init__(self) -> None:
        """Refuse parameters out of their range."""
        check_quantities(self)

    @cached_property
    def rest_length(self) -> float:
        """Length of a relaxed spring [m], lbar = sqrt(a^2 + 4 r^2 cos(theta_bar)^2)."""
        return math.hypot(self.spacing, 2 * self.rotor_length * math.cos(self.rest_angle))

    @cached_property
    def moment_of_inertia(self) -> float:
        """Of one rotor about its pivot [kg m^2], M r^2."""
        return self.mass * self.rotor_length**2

    @cached_property
    def time_unit(self) -> float:
        """Time scale of the springs [s], sqrt(M / k_e)."""
        return math.sqrt(self.mass / self.stiffness)

    @cached_property
    def lean_ratio(self) -> float:
        """How far a rotor leans, d = 2 r sin(theta_bar) / a; 1 separates flippers from wobblers."""
        return 2 * self.rotor_length * math.sin(self.rest_angle) / self.spacing

    @cached_property
    def critical_lean_ratio(self) -> float:
        """Lean ratio beyond which the rotors spin, d_c = 2 / sin(theta_bar)."""
        return 2 / math.sin(self.rest_angle)

    @cached_property
    def motion(self) -> Motion:
        """How a wall moves along this chain, decided by d < 1, 1 < d < d_c or d > d_c."""
        if self.lean_ratio > self.critical_lean_ratio:
            return Motion.SPINNER
        return Motion.WOBBLING_FLIPPER if self.lean_ratio > 1 else Motion.FLIPPER

    @cached_property
    def wall_width(self) -> float:
        """Width of a slow wall in the continuum [m].

        w = a^2 / (2 r sin(theta_bar)) for flippers (phi^4 theory), r sin(theta_bar) for
        spinners (sine-Gordon theory).
        """
        lean = self.rotor_length * math.sin(self.rest_angle)
        return lean if self.motion is Motion.SPINNER else self.spacing**2 / (2 * lean)

    def uniform_state(self, lean: int) -> Array:
        """Angles of the ground state that leans right (+1) or left (-1) [rad], shape (N,)."""
        if lean not in (-1, 1):
            raise ValueError(f'lean = {lean!r} must be +1 (right) or -1 (left)')
        return staggered(np.full(self.number_of_rotors, lean * self.rest_angle))

    def check_angles(self, angles: ArrayLike) -> Array:
        """Return angles as an array; raise ValueError unless they are finite and one a rotor."""
        checked = np.asarray(angles, dtype=np.float64)
        if checked.shape[-1:] != (self.number_of_rotors,):
            raise ValueError(
                f'angles of shape {checked.shape} do not fit a chain of '
                f'{self.number_of_rotors} rotors; give one angle a rotor on the last axis'
            )
        if not np.isfinite(checked).all():
            place = int(np.flatnonzero(~np.isfinite(checked).reshape(-1))[0])
            rotor = place % self.number_of_rotors
            raise ValueError(
                f'angle of rotor {rotor} = {checked.reshape(-1)[place]} must be a finite number'
            )
        return checked

    def positions(self, angles: Array) -> tuple[Array, Array]:
        """Horizontal and vertical positions of the masses from their pivots [m], (..., N)."""
        return self.rotor_length * np.sin(angles), self.rotor_length * np.cos(angles)

    def spring_extensions(self, angles: Array) -> Array:
        """Length of each spring beyond that at rest [m], shape (..., N-1)."""
        excess = self._squared_excess(*self.positions(angles))
        return excess / (np.sqrt(self.rest_length**2 + excess) + self.rest_length)

    def elastic_energy(self, angles: Array) -> Array:
        """Energy in the springs [J], V = (k_e / 2) sum_n (l_n - lbar)^2, shape (...)."""
        extensions = self.spring_extensions(angles)
        return np.asarray(0.5 * self.stiffness * np.sum(extensions**2, axis=-1))

    def kinetic_energy(self, rates: Array) -> Array:
        """Energy of the masses [J], T = (M r^2 / 2) sum_n phi_dot_n^2, shape (...)."""
        return np.asarray(0.5 * self.moment_of_inertia * np.sum(np.square(rates), axis=-1))

    def spring_torques(self, angles: Array) -> Array:
        """Torque of the springs on each rotor [N m], -dV/dphi, shape (..., N).

        With f_n = k_e (l_n - lbar) / l_n, the spring n pulls rotor n by f_n g_n and rotor n+1
        by -f_n g'_n, g_n = v_n (a + h_{n+1}) - h_n v_{n+1}, g'_n = v_{n+1} (a - h_n) + v_n h_{n+1}.
        """
        horizontal, vertical = self.positions(angles)
        excess = self._squared_excess(horizontal, vertical)
        length = np.sqrt(self.rest_length**2 + excess)
        pull = self.stiffness * excess / (length * (length + self.rest_length))
        cross = vertical[..., :-1] * horizontal[..., 1:] - horizontal[..., :-1] * vertical[..., 1:]
        torques = np.zeros(horizontal.shape)
        torques[..., :-1] = pull * (self.spacing * vertical[..., :-1] + cross)
        torques[..., 1:] -= pull * (self.spacing * vertical[..., 1:] + cross)
        return torques

    def _squared_excess(self, horizontal: Array, vertical: Array) -> Array:
        """Return e_n = l_n^2 - lbar^2 [m^2] of each spring, shape (..., N-1)."""
        offset = -2 * self.rotor_length**2 * math.cos(2 * self.rest_angle)
        products = (
            horizontal[..., :-1] * horizontal[..., 1:] + vertical[..., :-1] * vertical[..., 1:]
        )
        return offset + 2 * self.spacing * (horizontal[..., 1:] - horizontal[..., :-1]) - 2 * products


def staggered(angles: ArrayLike) -> Array:
    """Staggered from actual angles, and back: theta_n = phi_n or pi - phi_n, shape (..., N)."""
    converted = np.array(angles, dtype=np.float64)
    converted[..., 1::2] = np.pi - converted[..., 1::2]
    return converted
