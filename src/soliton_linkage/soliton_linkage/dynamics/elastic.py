# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain of elastic springs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.dynamics.integrators.symplectic_nystrom import SymplecticNystrom
from soliton_linkage.dynamics.simulation import Simulation, SimulationSettings
from soliton_linkage.dynamics.terms import Term, TorqueFunction
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage.linkage.recording import Recording


@dataclass(frozen=True)
class ElasticSettings(SimulationSettings):
    """Tuning of `ElasticSimulation`."""

    longest_step: float = 5.0
    """Longest step of scipy's solvers, multiplied by the larger of `fastest_vibration` and
    `fastest_decay` of the `EquationOfMotion` [1]. DOP853 is stable up to 6. With longer steps,
    vibrations grow until the error control shortens the steps. Sensitivity: at 0.5x, the
    computation takes 1.6 times as long for a moving soliton and twice as long for a chain at rest;
    at 2x, it takes equally long for a moving soliton and half as long for a chain at rest."""
    symplectic_fraction: float = 0.1
    """Tolerance of `SymplecticNystrom`, divided by the tolerance of the simulation [1]. At 0.1,
    a simulation of a kicked chain of 12 rotors has the same error as a simulation by DOP853.
    Sensitivity: at 1, the error is 13 times as large and the steps are 1.4 times as long."""
    rotors_per_step: int = 400
    """Largest number of integration steps in one call of `SymplecticNystrom.step`, multiplied by
    the number of rotors [1]. A call takes 0.05 to 0.07 ms. Calls must be short, because the
    simulator node runs its other callbacks between calls. Sensitivity for a chain of 40 rotors: at
    0.5x, the computation of a frame takes 20 to 60 % longer; at 2x, it takes 10 to 30 % less time,
    but a call takes 0.12 ms."""


class ElasticSimulation(Simulation):
    """Simulation of a chain of springs by integration of an `EquationOfMotion`.

    Raises ValueError for an unknown `integrator`, and for `forces` that the integrator does not
    support.
    """

    _settings = ElasticSettings()

    def __init__(
        self,
        chain: Chain,
        angles: Array,
        rates: Array | None = None,
        period: float = 0.01,
        tolerance: float = 1e-11,
        gravity: Gravity = NO_GRAVITY,
        fixed: Sequence[int] = (),
        *,
        forces: Sequence[Term | TorqueFunction] = (),
        integrator: str = 'symplectic',
        settings: ElasticSettings | None = None,
    ) -> None:
        if integrator not in INTEGRATORS:
            raise ValueError(f'integrator = {integrator!r} must be one of {tuple(INTEGRATORS)}')
        self.integrator = integrator
        self._method = INTEGRATORS[integrator]
        start = chain, angles, rates, period, tolerance
        super().__init__(*start, gravity, fixed, forces=forces, settings=settings)
        if issubclass(self._method, SymplecticNystrom):
            self._method.check(self.motion)
            self._method.load()

    @property
    def link_torques(self) -> Array:
        """Torque of the springs on each rotor in the current frame [N m], shape (N,)."""
        return self.chain.spring_torques(self.angles)

    def _allowed(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        if self.fixed:
            rates[list(self.fixed)] = 0.0
        return angles, rates

    def _packed(self) -> Array:
        return np.concatenate([self.angles, self.rates, [0.0] * self.motion.damped])

    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        rotors = self.chain.number_of_rotors
        dissipated = float(state[-1]) if self.motion.damped else 0.0
        return state[:rotors], state[rotors : 2 * rotors], dissipated

    def _solver_from(self, state: Array) -> tuple[OdeSolver, float]:
        motion = self.motion
        fastest_rate = max(motion.fastest_vibration, motion.fastest_decay)
        longest_step = self._settings.longest_step / fastest_rate
        options = {'max_step': longest_step}
        tolerances = absolute_tolerances(motion, self.tolerance)
        if issubclass(self._method, SymplecticNystrom):
            options = {'together': 1}
            tolerances *= self._settings.symplectic_fraction
        return self._solver_of(self._method, motion, state, tolerances, **options), longest_step

    def _after_step(self) -> None:
        if isinstance(self._solver, SymplecticNystrom):
            most = max(1, self._settings.rotors_per_step // self.chain.number_of_rotors)
            self._solver.together = min(2 * self._solver.together, most)


def absolute_tolerances(motion: EquationOfMotion, tolerance: float) -> Array:
    """Return the absolute tolerance of each variable of a solver.

    With these tolerances, the square root of the sum of the squared errors of all angles in a step
    is at most `tolerance` [rad].
    """
    # The solver compares the root mean square of the errors of all variables with the tolerance.
    # In a long chain most rotors rest and have no error. Without the division by sqrt(N) they
    # would reduce the mean so much that a large error of the rotors in the wall is accepted.
    chain = motion.chain
    angles = np.full(motion.rotors, tolerance / math.sqrt(2 * motion.rotors))
    energy = [tolerance * chain.stiffness * chain.rest_length**2] * motion.damped
    return np.concatenate([angles, angles / chain.time_unit, energy])


def simulate(
    chain: Chain,
    angles: Array,
    rates: Array,
    duration: float,
    period: float,
    tolerance: float = 1e-11,
) -> Recording:
    """Record the free motion of a chain of springs for `duration` [s], a frame every `period` [s].

    `Simulation` describes `tolerance` [rad]. Raises ValueError for invalid arguments, and
    ArithmeticError if the solver fails.
    """
    return ElasticSimulation(chain, angles, rates, period, tolerance).record(duration)
