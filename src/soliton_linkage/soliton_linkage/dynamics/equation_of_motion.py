# SPDX-License-Identifier: Apache-2.0
"""Equation of motion of a chain of springs, as the right-hand side for the solvers of scipy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from soliton_linkage.dynamics.terms import (
    AppliedFunction,
    CompiledTerm,
    HeldTorques,
    SpringTorques,
    Term,
    TermTable,
    TorqueFunction,
    Weights,
    of_chain,
    term_table,
    torques_of,
)
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity


@dataclass(frozen=True, eq=False)
class EquationOfMotion:
    """Right-hand side for `scipy.integrate.solve_ivp` with the state (angles, rates, W).

    M r^2 phi_ddot is the sum of the torques of all terms. W_dot is the sum of the powers that the
    terms dissipate.

    The dissipated energy W [J] is part of the state only if a term is dissipative or active (see
    `Term`). The terms are the springs, `torques`, gravity, `forces`, and the damping, friction,
    on-site and non-reciprocal torques that the parameters of the chain specify. Compiled loops
    compute the terms of the class `CompiledTerm`. If a `Simulation` creates the equation,
    `torques` includes the torques of `Chain.feedback`, which are constant between frames. Raises
    ValueError for invalid torques and invalid fixed rotors.
    """

    chain: Chain
    torques: Array | None = None
    """Constant torque on each rotor [N m], shape (N,), or None."""
    gravity: Gravity = NO_GRAVITY
    fixed: tuple[int, ...] = ()
    """Indices of the rotors that do not turn."""
    forces: tuple[Term | TorqueFunction, ...] = ()
    """Terms in addition to the springs, `torques`, gravity and the terms of the chain."""
    start: float = 0.0
    """Python functions in `forces` receive the solver time plus this offset [s]."""

    def __post_init__(self) -> None:
        if self.torques is not None:
            self.chain.check_angles(self.torques, 'torque')
        checked_rotors(self.chain, self.fixed)

    @property
    def rotors(self) -> int:
        """Number of rotors N."""
        return self.chain.number_of_rotors

    @cached_property
    def damped(self) -> bool:
        """Whether the last element of the state is the dissipated energy."""
        return any(term.dissipative or term.active for term in self.loads)

    @cached_property
    def loads(self) -> tuple[Term, ...]:
        """All terms except the springs; the active terms are the last ones."""
        loads: list[Term] = []
        if self.torques is not None and self.torques.any():
            loads.append(HeldTorques(self.torques))
        if self.gravity.acceleration:
            loads.append(Weights(self.chain, self.gravity))
        loads += of_chain(self.chain)
        loads += [f if isinstance(f, Term) else AppliedFunction(f) for f in self.forces]
        return tuple(sorted(loads, key=lambda term: term.active))

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """All terms; the first one is the torque of the springs."""
        return (SpringTorques(self.chain), *self.loads)

    def table(self, terms: Sequence[Term]) -> TermTable:
        """Return the kinds and parameters of the given terms; omit terms that are not compiled."""
        return term_table([t for t in terms if isinstance(t, CompiledTerm)], self.rotors)

    @cached_property
    def plain_terms(self) -> tuple[Term, ...]:
        """Terms that are not of the class `CompiledTerm`, for example Python functions."""
        return tuple(term for term in self.loads if not isinstance(term, CompiledTerm))

    @cached_property
    def inertias(self) -> Array:
        """Moment of inertia of each rotor [kg m^2], infinite for fixed rotors, shape (N,)."""
        inertias = self.chain.moments_of_inertia.copy()
        inertias[list(self.fixed)] = np.inf
        return inertias

    @property
    def decay_rates(self) -> Array:
        """Decay rates c / (M r^2) by linear damping c [1/s]; 0 for fixed rotors, shape (N,)."""
        return np.asarray(self.chain.dampings / self.inertias)

    @cached_property
    def fastest_vibration(self) -> float:
        """Upper bound of the angular frequency of small vibrations with relaxed springs [rad/s].

        The bound is sqrt(4 k_e / M + g / r + (4 abs(kappa) + m abs(A)) / (M r^2)). The symbols are
        the largest stiffness k_e, the smallest mass M, the gravitational acceleration g, the
        smallest rotor length r, the largest non-reciprocity kappa, the smallest moment of inertia
        M r^2, and the order m and the largest torque A of the on-site potential.
        """
        chain = self.chain
        of_springs = 4 * float(chain.stiffnesses.max() / chain.masses.min())
        of_gravity = self.gravity.acceleration / float(chain.rotor_lengths.min())
        of_motors = 4 * float(np.abs(chain.non_reciprocities).max())
        of_sites = chain.on_site_order * float(np.abs(chain.on_site_torques).max())
        inertia = float(chain.moments_of_inertia.min())
        return math.sqrt(of_springs + of_gravity + (of_motors + of_sites) / inertia)

    @cached_property
    def fastest_decay(self) -> float:
        """Upper bound of the decay rate of the angular rates [1/s].

        The bound includes linear damping, and dry friction at rates below `Chain.friction_rate`,
        where this friction is proportional to the rate.
        """
        of_friction = self.chain.dry_frictions / self.chain.friction_rate / self.inertias
        return float((self.decay_rates + of_friction).max())

    @property
    def fastest_rate(self) -> float:
        """The larger of `fastest_vibration` and twice `fastest_decay` [1/s]."""
        return max(self.fastest_vibration, 2 * self.fastest_decay)

    def external_energy(self, angles: Array) -> float:
        """Return the energy of all terms except the springs, for example of gravity [J]."""
        return sum(term.energy(angles) for term in self.loads)

    @property
    def external_scale(self) -> float:
        """Typical size of the energy of gravity and of the on-site potential [J]."""
        wells = np.abs(self.chain.on_site_torques).sum() / self.chain.on_site_order
        return self.gravity.scale(self.chain) + float(wells)

    def state(self, angles: Array, rates: Array) -> Array:
        """Return the state for angles [rad] and rates [rad/s], (2N,), or (2N + 1,) if `damped`."""
        given = self.chain.check_angles(angles), self.chain.check_angles(rates, 'rate')
        return np.concatenate([*given, [0.0] * self.damped])

    def accelerations(self, angles: Array) -> Array:
        """Return the angular accelerations if all rotors are at rest [rad/s^2], shape (N,)."""
        at_rest = self.state(angles, np.zeros(self.rotors))
        return self(0.0, at_rest)[self.rotors : 2 * self.rotors]

    def __call__(self, time: float, state: Array) -> Array:
        """Return the time derivative of a state."""
        state = np.ascontiguousarray(state)
        rotors = self.rotors
        angles, rates = state[:rotors], state[rotors : 2 * rotors]
        torques = np.zeros(rotors)
        power = torques_of(angles, rates, *self._table, torques)
        power += self._add_plain(torques, time, angles, rates)
        return np.concatenate([rates, torques / self.inertias, [power] * (state.size % 2)])

    def add_loads(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        """Add the torques of all terms except springs [N m]; return the dissipated power [W]."""
        power = torques_of(angles, rates, *self._table_of_loads, torques)
        return power + self._add_plain(torques, time, angles, rates)

    def _add_plain(self, torques: Array, time: float, angles: Array, rates: Array) -> float:
        time += self.start
        return sum(term.add(torques, time, angles, rates) for term in self.plain_terms)

    @cached_property
    def _table(self) -> TermTable:
        return self.table(self.terms)

    @cached_property
    def _table_of_loads(self) -> TermTable:
        return self.table(self.loads)


def checked_rotors(chain: Chain, rotors: Sequence[int]) -> tuple[int, ...]:
    """Return sorted unique indices of rotors; raise ValueError for an index out of range."""
    for rotor in rotors:
        if rotor not in range(chain.number_of_rotors):
            raise ValueError(
                f'fixed rotor {rotor!r} must be one of 0 to {chain.number_of_rotors - 1}'
            )
    return tuple(sorted({int(rotor) for rotor in rotors}))
