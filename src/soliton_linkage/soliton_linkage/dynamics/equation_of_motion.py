# SPDX-License-Identifier: Apache-2.0
"""The equations of motion of a chain of springs, as solvers of scipy take them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from soliton_linkage.dynamics.terms import (
    AppliedFunction,
    HeldTorques,
    LinearDamping,
    SpringTorques,
    Term,
    TorqueFunction,
    Weights,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity


@dataclass(frozen=True, eq=False)
class EquationOfMotion:
    """Right-hand side for `scipy.integrate.solve_ivp`, of state (angles, rates, dissipated).

    M r^2 phi_ddot = sum of the torques of all terms,
    W_dot = sum of the powers that they take out,

    where W, the energy that damping and `forces` have taken out [J], belongs only to the state of
    a motion with such terms. The terms are held torques, gravity, linear damping, `forces` and
    springs. Raises ValueError for torques or fixed rotors that do not fit the chain.
    """

    chain: Chain
    torques: Array | None = None
    """Held at each rotor [N m], shape (N,); None where there are none."""
    gravity: Gravity = NO_GRAVITY
    fixed: tuple[int, ...] = ()
    """Numbers of the rotors that do not turn, whatever acts on them."""
    forces: tuple[Term | TorqueFunction, ...] = ()
    """Terms beyond those of the chain."""
    start: float = 0.0
    """Time of `forces` at time 0 of the solver [s]."""

    def __post_init__(self) -> None:
        """Refuse torques and rotors that do not fit the chain."""
        if self.torques is not None:
            self.chain.check_angles(self.torques, 'torque')
        checked_rotors(self.chain, self.fixed)

    @property
    def rotors(self) -> int:
        """Number of rotors N."""
        return self.chain.number_of_rotors

    @property
    def damped(self) -> bool:
        """Whether the state has the dissipated energy behind the rates."""
        return any(term.dissipative for term in self.loads)

    @cached_property
    def weights(self) -> Weights:
        """Term of gravity."""
        return Weights(self.chain, self.gravity)

    @cached_property
    def loads(self) -> tuple[Term, ...]:
        """Terms other than those of springs."""
        loads: list[Term] = []
        if self.held_torques.any():
            loads.append(HeldTorques(self.held_torques))
        if self.gravity.acceleration:
            loads.append(self.weights)
        if self.chain.damping > 0:
            loads.append(LinearDamping(self.chain.dampings))
        loads += [f if isinstance(f, Term) else AppliedFunction(f) for f in self.forces]
        return tuple(loads)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """All terms."""
        return (*self.loads, SpringTorques(self.chain))

    @cached_property
    def held_torques(self) -> Array:
        """Torques [N m], shape (N,)."""
        return np.zeros(self.rotors) if self.torques is None else self.torques

    @property
    def in_field(self) -> bool:
        """Whether torques or gravity act on the rotors."""
        return self.gravity.acceleration != 0 or bool(np.any(self.held_torques))

    @cached_property
    def inertias(self) -> Array:
        """Of the rotors [kg m^2], M r^2, and infinite of fixed ones, shape (N,)."""
        inertias = self.chain.moments_of_inertia.copy()
        inertias[list(self.fixed)] = np.inf
        return inertias

    @cached_property
    def inverse_inertias(self) -> Array:
        """Of the rotors [1/(kg m^2)], 1 / (M r^2), and 0 of fixed ones, shape (N,)."""
        return np.asarray(1 / self.inertias)

    @cached_property
    def decay_rates(self) -> Array:
        """Of free rotors [1/s], c / (M r^2), shape (N,)."""
        return self.chain.dampings * self.inverse_inertias

    @cached_property
    def fastest_vibration(self) -> float:
        """Bound of vibrations, sqrt(4 k_e / M + g / r) [1/s]."""
        chain = self.chain
        of_springs = 4 * float(chain.stiffnesses.max() / chain.masses.min())
        of_gravity = self.gravity.acceleration / float(chain.rotor_lengths.min())
        return math.sqrt(of_springs + of_gravity)

    @cached_property
    def fastest_decay(self) -> float:
        """Of free rotors' rates, c / (M r^2) [1/s]."""
        return float(self.decay_rates.max())

    @property
    def fastest_rate(self) -> float:
        """Bound of vibrations and of the decay of energies, 2 c / (M r^2) [1/s]."""
        return max(self.fastest_vibration, 2 * self.fastest_decay)

    def state(self, angles: Array, rates: Array) -> Array:
        """State with nothing dissipated so far, shape (2N,), or (2N + 1,) of a damped chain."""
        given = self.chain.check_angles(angles), self.chain.check_angles(rates, 'rate')
        return np.concatenate([*given, [0.0] * self.damped])

    def accelerations(self, angles: Array) -> Array:
        """Angular acceleration without damping [rad/s^2], shape (N,)."""
        at_rest = self.state(angles, np.zeros(self.rotors))
        return self(0.0, at_rest)[self.rotors : 2 * self.rotors]

    def __call__(self, time: float, state: Array) -> Array:
        """Time derivative of a state, of its shape."""
        state = np.ascontiguousarray(state)
        number = state.size // 2
        angles, rates = state[:number], state[number : 2 * number]
        changes = np.zeros(state.size)
        changes[:number] = rates
        torques = changes[number : 2 * number]
        dissipated = self.add(self.terms, torques, time, angles, rates)
        torques /= self.inertias
        if state.size > 2 * number:
            changes[-1] = dissipated
        return changes

    def add(
        self, terms: Sequence[Term], torques: Array, time: float, angles: Array, rates: Array
    ) -> float:
        """Add the torques of terms [N m], shape (N,); return the power they take out [W]."""
        dissipated = 0.0
        for term in terms:
            dissipated += term.add(torques, self.start + time, angles, rates)
        return dissipated


def checked_rotors(chain: Chain, rotors: Sequence[int]) -> tuple[int, ...]:
    """Return the rotors in order, each once; raise ValueError where there is no such rotor."""
    for rotor in rotors:
        if rotor not in range(chain.number_of_rotors):
            raise ValueError(
                f'fixed rotor {rotor!r} must be one of 0 to {chain.number_of_rotors - 1}'
            )
    return tuple(sorted({int(rotor) for rotor in rotors}))
