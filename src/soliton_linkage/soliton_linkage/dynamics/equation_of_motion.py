# SPDX-License-Identifier: Apache-2.0
"""The equations of motion of a chain of springs, as solvers of scipy take them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity


@dataclass(frozen=True, eq=False)
class EquationOfMotion:
    """Right-hand side for `scipy.integrate.solve_ivp`, of state (angles, rates, dissipated).

    M r^2 phi_ddot = -dV/dphi - c phi_dot + g M r sin(phi + tilt) + torque,
    W_dot = sum_n c_n phi_dot_n^2,

    where W, the energy that the damping has taken out [J], belongs to the state of damped chains
    only. Raises ValueError where there is not one torque a rotor or no rotor of a fixed number.
    """

    chain: Chain
    torques: Array | None = None
    """Held at each rotor [N m], shape (N,); None where there are none."""
    gravity: Gravity = NO_GRAVITY
    fixed: tuple[int, ...] = ()
    """Numbers of the rotors that do not turn, whatever acts on them."""

    def __post_init__(self) -> None:
        """Refuse torques and rotors that do not fit the chain."""
        if self.torques is not None:
            self.chain.check_angles(self.torques, 'torque')
        for rotor in self.fixed:
            if rotor not in range(self.rotors):
                raise ValueError(f'fixed rotor {rotor!r} must be one of 0 to {self.rotors - 1}')

    @property
    def rotors(self) -> int:
        """Number of rotors N."""
        return self.chain.number_of_rotors

    @property
    def damped(self) -> bool:
        """Whether the state has the dissipated energy behind the rates."""
        return self.chain.damping > 0

    @property
    def in_field(self) -> bool:
        """Whether torques or gravity act on the rotors."""
        return self.gravity.acceleration != 0 or (
            self.torques is not None and bool(np.any(self.torques))
        )

    @cached_property
    def inverse_inertias(self) -> Array:
        """Of the rotors [1/(kg m^2)], 1 / (M r^2), and 0 of fixed ones, shape (N,)."""
        inverse = 1 / self.chain.moments_of_inertia
        inverse[list(self.fixed)] = 0.0
        return np.asarray(inverse)

    @cached_property
    def decay_rates(self) -> Array:
        """Of free rotors [1/s], c / (M r^2), shape (N,)."""
        return self.chain.dampings * self.inverse_inertias

    @cached_property
    def fastest_rate(self) -> float:
        """Bound of vibrations, sqrt(4 k_e / M + g / r), and of decay, 2 c / (M r^2) [1/s]."""
        chain = self.chain
        of_springs = 4 * float(chain.stiffnesses.max() / chain.masses.min())
        of_gravity = self.gravity.acceleration / float(chain.rotor_lengths.min())
        return max(math.sqrt(of_springs + of_gravity), 2 * float(self.decay_rates.max()))

    def state(self, angles: Array, rates: Array) -> Array:
        """State with nothing dissipated so far, shape (2N,), or (2N + 1,) of a damped chain."""
        given = self.chain.check_angles(angles), self.chain.check_angles(rates, 'rate')
        return np.concatenate([*given, [0.0] * self.damped])

    def accelerations(self, angles: Array) -> Array:
        """Angular acceleration without damping [rad/s^2], shape (N,)."""
        torques = self.chain.spring_torques(angles)
        if self.torques is not None:
            torques += self.torques
        if self.gravity.acceleration:
            torques += self.gravity.torques(self.chain, angles)
        return np.asarray(torques * self.inverse_inertias)

    def __call__(self, _time: float, state: Array) -> Array:
        """Time derivative of a state, of its shape."""
        angles, rates = state[: self.rotors], state[self.rotors : 2 * self.rotors]
        accelerations = self.accelerations(angles)
        if not self.damped:
            return np.concatenate([rates, accelerations])
        power = self.chain.dampings @ rates**2
        return np.concatenate([rates, accelerations - self.decay_rates * rates, [power]])
