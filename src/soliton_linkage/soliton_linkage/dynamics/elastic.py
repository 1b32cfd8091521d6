# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain of elastic springs."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.chain_solver import ChainSolver
from soliton_linkage.dynamics.integrators.multistep import SymmetricMultistep
from soliton_linkage.dynamics.integrators.multistep_steps import load_loops
from soliton_linkage.dynamics.integrators.nystrom import SymplecticNystrom
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording

INTEGRATORS = ('DOP853', 'symplectic', 'multistep')
"""Of springs: scipy's explicit Runge-Kutta method, `SymplecticNystrom`, `SymmetricMultistep`."""

_SOLVERS = {'symplectic': SymplecticNystrom, 'multistep': SymmetricMultistep}

# In units of the fastest rate; DOP853 is stable in steps of 6. A chain at rest asks for no
# accuracy, and longer steps would make a motion of rounding errors.
_LONGEST_STEP = 5
_ROTORS_TOGETHER = 400


class ElasticSimulation(Simulation):
    """A chain of springs: M r^2 phi_ddot = -dV/dphi - damping phi_dot + torques of gravity etc.

    The integrator is one of INTEGRATORS; all else is as in `Simulation`.
    """

    def __init__(self, *arguments: Any, integrator: str = 'DOP853', **others: Any) -> None:
        if integrator not in INTEGRATORS:
            raise ValueError(f'integrator = {integrator!r} must be one of {INTEGRATORS}')
        self.integrator = integrator
        self._length: float | None = None
        if integrator in _SOLVERS:
            with suppress(ImportError):  # of which the first step will tell
                load_loops()
        super().__init__(*arguments, **others)
        if integrator == 'multistep' and self._damped:
            raise ValueError(
                f"integrator = 'multistep' takes no damping, and the chain has "
                f"{self.chain.damping:g} kg m^2/s; take 'symplectic' or 'DOP853'"
            )

    @property
    def link_torques(self) -> Array:
        """Torque of the springs on each rotor in the current frame [N m], shape (N,)."""
        return self.chain.spring_torques(self.angles)

    def _allowed(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        if self.fixed:
            rates[list(self.fixed)] = 0.0
        return angles, rates

    def _packed(self) -> Array:
        return np.concatenate([self.angles, self.rates, [0.0] * self._damped])

    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        rotors = self.chain.number_of_rotors
        dissipated = float(state[-1]) if self._damped else 0.0
        return state[:rotors], state[rotors : 2 * rotors], dissipated

    def _derivative(self, _time: float, state: Array) -> Array:
        chain = self.chain
        angles, rates, _ = self._unpacked(state)
        torques = chain.spring_torques(angles) + self._applied_torques(angles)
        if not self._damped:
            return np.concatenate([rates, torques / self._inertias])
        friction = chain.dampings * rates
        accelerations = (torques - friction) / self._inertias
        return np.concatenate([rates, accelerations, [friction @ rates]])

    def _new_solver(self, state: Array, tolerances: Array, longest_step: float) -> OdeSolver:
        if self.integrator not in _SOLVERS:
            return super()._new_solver(state, tolerances, longest_step)
        motion = EquationOfMotion(self.chain, self.torques, self.gravity, self.fixed)
        return _SOLVERS[self.integrator](
            motion,
            0.0,
            state,
            np.inf,
            rtol=0.0,
            atol=tolerances,
            first_step=self._length,
            together=1,
        )

    def _tolerances(self) -> tuple[Array, float]:
        # The solver takes the root mean square over its variables, in which a wall in a long
        # chain would be drowned by the rotors at rest.
        chain = self.chain
        rotors = chain.number_of_rotors
        of_angles = np.full(rotors, self.tolerance / math.sqrt(2 * rotors))
        of_energy = [self.tolerance * chain.stiffness * chain.rest_length**2] * self._damped
        tolerances = np.concatenate([of_angles, of_angles / chain.time_unit, of_energy])
        return tolerances, _LONGEST_STEP / self._fastest_rate()

    def _fastest_rate(self) -> float:
        """Bound of vibrations, sqrt(4 k_e / M + g / r), and of decay, c / (M r^2) [rad/s]."""
        chain = self.chain
        of_springs = 4 * float(chain.stiffnesses.max() / chain.masses.min())
        of_gravity = self.gravity.acceleration / float(chain.rotor_lengths.min())
        decay = float((chain.dampings / chain.moments_of_inertia).max())
        return max(math.sqrt(of_springs + of_gravity), decay)

    def _after_step(self) -> None:
        """Let the longer steps together the longer nothing happens; the state stays as it is."""
        if isinstance(self._solver, ChainSolver):
            most = max(1, _ROTORS_TOGETHER // self.chain.number_of_rotors)
            self._solver.together = min(2 * self._solver.together, most)
            self._length = self._solver.length

    @property
    def _damped(self) -> bool:
        return self.chain.damping > 0


def simulate(
    chain: Chain,
    angles: Array,
    rates: Array,
    duration: float,
    period: float,
    tolerance: float = 1e-11,
) -> Recording:
    """Record the free motion of springs from a state: every period [s] for a duration [s]."""
    return ElasticSimulation(chain, angles, rates, period, tolerance).record(duration)
