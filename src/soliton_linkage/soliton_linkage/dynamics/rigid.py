# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain of rigid bars, the limit of infinitely stiff springs.

The configurations phi in which all bars have their rest length form a curve. The tangent of this
curve is the zero mode t(phi), normalised so that sum_n I_n t_n^2 = 1 with the moments of inertia
I_n. With the speed s along the curve [J^(1/2)] and the kinetic energy T,

    dphi/dt = s t(phi),    ds/dt = t(phi)^T torques,    T = s^2 / 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, OdeSolver
from scipy.linalg import eigvals_banded, solveh_banded

from soliton_linkage.dynamics.simulation import Simulation, SimulationSettings
from soliton_linkage.linear.rigidity import rigidity_bands, zero_mode
from soliton_linkage.linear.statics import gram_matrix_bands, unstretched
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class RigidSettings(SimulationSettings):
    """Tuning of `RigidSimulation`."""

    max_bar_error: float = 1e-6
    """Largest allowed relative error of the length of a bar in an initial state [1]."""
    jammed: float = 1e-5
    """Threshold of jammed bars, as a fraction of r [1]. If a solver step fails while the smallest
    singular value of the rigidity matrix is below this threshold, the error message reports that
    the bars jam."""
    longest_step: float = 100.0
    """Longest solver step, divided by the frame period [1]. Sensitivity: 0.5x and 2x have no
    effect."""
    max_corrections: int = 3
    """Largest number of energy corrections after a step [1]. Sensitivity: 1 and 6 have the same
    effect as 3."""


class RigidSimulation(Simulation):
    """Simulation of a chain in which a rigid bar replaces each spring.

    The length of a bar is the rest length of its spring. Rates and impulses are projected onto the
    zero mode. After each step, corrections make the bar lengths and the energy exact. Raises
    ValueError for fixed rotors, for periodic ends, and for initial angles that the bars do not
    allow. Raises ArithmeticError if the bars jam during the motion.
    """

    _settings = RigidSettings()

    @property
    def link_torques(self) -> Array:
        """Torque of the bars on each rotor in the current frame [N m], shape (N,).

        The result is R^T f with the rigidity matrix R. The bar forces f are the solution of
        R I^-1 R^T f = -(l_ddot + R I^-1 tau), where tau are the other torques on the rotors, and
        l_ddot are the second derivatives of the bar lengths for phi_ddot = 0. Raises LinAlgError,
        which is a ValueError, if the bars are jammed.
        """
        chain, angles, rates = self.chain, self.angles, self.rates
        first, second = rigidity_bands(chain, angles)
        torques, elapsed = np.zeros(len(angles)), self.time - self.motion.start
        self.motion.add_loads(torques, elapsed, angles, rates)
        free = torques / chain.moments_of_inertia
        shrinking = _centripetal(chain, angles, rates) - first * free[:-1] - second * free[1:]
        weights = 1 / np.sqrt(chain.moments_of_inertia)
        products = gram_matrix_bands(first * weights[:-1], second * weights[1:])
        forces = solveh_banded(products, shrinking)
        return chain.gathered(first * forces, second * forces)

    def _allowed(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        chain = self.chain
        if self.fixed:
            raise ValueError(
                f'a chain of rigid bars cannot move with rotor {self.fixed[0]} fixed; fix no '
                'rotor, or choose elastic mechanics'
            )
        if chain.periodic:
            raise ValueError(
                'rigid bars with periodic ends cannot move; set periodic to false, or choose '
                'elastic mechanics'
            )
        extensions = chain.spring_extensions(angles)
        bar = int(np.argmax(np.abs(extensions)))
        if not abs(extensions[bar]) <= self._settings.max_bar_error * chain.rest_lengths[bar]:
            raise ValueError(
                f'bar {bar} between rotors {bar} and {bar + 1} would be {extensions[bar]:.3g} m '
                f'longer than its rest length of {chain.rest_lengths[bar]:.6g} m; start from '
                'angles that the bars allow, for example rest_state(chain, 1)'
            )
        closed = unstretched(chain, angles)
        mode = self._mode(closed)
        return closed, mode * float(mode @ (chain.moments_of_inertia * rates))

    def _packed(self) -> Array:
        speed = float(self._mode(self.angles) @ (self.chain.moments_of_inertia * self.rates))
        return np.concatenate([self.angles, [speed, 0.0]])

    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        angles, speed, dissipated = self._corrected(state)
        return angles, speed * self._mode(angles), dissipated

    def _applied_torques(self, angles: Array) -> Array:
        torques, rest = np.zeros(len(angles)), np.zeros(len(angles))
        for term in self.motion.loads:
            if not (term.dissipative or term.active):
                term.add(torques, 0.0, angles, rest)
        return torques

    def _solver_from(self, state: Array) -> tuple[OdeSolver, float]:
        longest_step = self._settings.longest_step * self.period
        motion, rotors = self.motion, self.chain.number_of_rotors

        def derivative(time: float, state: Array) -> Array:
            mode = self._mode(state[:rotors])
            rates, torques = state[rotors] * mode, np.zeros(rotors)
            dissipated = motion.add_loads(torques, time, state[:rotors], rates)
            return np.concatenate([rates, [mode @ torques, dissipated]])

        of_angles = np.full(rotors, self.tolerance / math.sqrt(rotors))
        energy = max(self._energy_scale(), float(np.finfo(np.float64).tiny))
        of_rest = [self.tolerance * math.sqrt(energy), self.tolerance * energy]
        tolerances = np.concatenate([of_angles, of_rest])
        solver = self._solver_of(DOP853, derivative, state, tolerances, max_step=longest_step)
        return solver, longest_step

    def _after_step(self) -> None:
        state = self._solver.y
        angles, speed, _ = self._corrected(state)
        state[:-2], state[-2] = angles, speed
        self._solver.f = self._solver.fun(self._solver.t, state)

    def _corrected(self, state: Array) -> tuple[Array, float, float]:
        """Return angles, speed and dissipated energy of a state; correct bar lengths and energy.

        To correct the energy, angles and speed are changed along the gradient of the energy,
        (-t^T torques, s). This also works at turning points, where the speed s is 0.
        """
        chain = self.chain
        angles, speed, dissipated = state[:-2].copy(), float(state[-2]), float(state[-1])
        eps = float(np.finfo(np.float64).eps)
        try:
            angles = unstretched(chain, angles)
            for _ in range(self._settings.max_corrections):
                excess = self._excess_energy(angles, speed, dissipated)
                mode = self._mode(angles)
                force = chain.time_unit * float(mode @ self._applied_torques(angles))
                gradient = force**2 + speed**2
                if abs(excess) <= eps * self._energy_scale() or abs(excess) > gradient / 1000:
                    break
                speed -= excess * speed / gradient
                angles = unstretched(
                    chain, angles + mode * (chain.time_unit * excess * force / gradient)
                )
        except ValueError as error:
            raise self._stuck(str(error)) from error
        return angles, speed, dissipated

    def _motion_and_springs(self) -> float:
        return float(self.chain.kinetic_energy(self.rates))  # bars have no elastic energy

    def _excess_energy(self, angles: Array, speed: float, dissipated: float) -> float:
        potential = self.motion.external_energy(angles)
        work = self._work + self._work_of_torques(angles)
        lost = self._dissipated_before + self._dissipated_at(angles, dissipated)
        return speed**2 / 2 + potential - work + lost

    def _stuck(self, complaint: str) -> ArithmeticError:
        bands = rigidity_bands(self.chain, self._solver.y[:-2])
        squares = eigvals_banded(gram_matrix_bands(*bands), select='i', select_range=(0, 0))
        jammed = squares[0] <= (self._settings.jammed * self.chain.rotor_length) ** 2
        return super()._stuck(f'the bars jam ({complaint})' if jammed else complaint)

    def _energy_scale(self) -> float:
        moving = float(self.chain.kinetic_energy(self.rates))
        held = np.abs(self.torques) + np.abs(self.feedback_torques)
        return moving + self.motion.external_scale + float(held.sum())

    def _mode(self, angles: Array) -> Array:
        mode = zero_mode(self.chain, angles)
        return np.asarray(mode / math.sqrt(float(self.chain.moments_of_inertia @ mode**2)))


def _centripetal(chain: Chain, angles: Array, rates: Array) -> Array:
    """Return minus the second derivative of each bar length [m/s^2] at constant rates, (bars,)."""
    horizontal, vertical = chain.positions(angles)
    x, y = chain.spacings + np.diff(horizontal), np.diff(vertical)
    squares = np.diff(vertical * rates) ** 2 + np.diff(horizontal * rates) ** 2
    inward = x * np.diff(horizontal * rates**2) + y * np.diff(vertical * rates**2)
    return np.asarray((inward - squares) / np.hypot(x, y))
