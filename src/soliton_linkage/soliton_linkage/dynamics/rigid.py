# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain of rigid bars, the limit of springs of infinite stiffness.

The chain is then a mechanism of one degree of freedom: it moves along the curve of all
configurations whose bars have their length, in the direction of the zero mode t(phi). With the
unit t in the metric of the inertia, sum_n I_n t_n^2 = 1, and the speed s [J^(1/2)],

    dphi/dt = s t(phi),    ds/dt = t(phi) . torques,    T = s^2 / 2,

and no bar does work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, OdeSolver
from scipy.linalg import eigvals_banded, solveh_banded

from soliton_linkage.compiling import compiled, const_f8_1d
from soliton_linkage.dynamics.simulation import Simulation, SimulationSettings, scipy_solver
from soliton_linkage.dynamics.terms import Term, TorqueFunction
from soliton_linkage.dynamics.work import work_of_torques
from soliton_linkage.linear.rigidity import VANISHING, rigidity_bands, zero_mode
from soliton_linkage.linear.statics import gram_matrix_bands, unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

_FLUSHED = -1100
"""Power of 2 below which nothing is left of a component [1]."""


@dataclass(frozen=True)
class RigidSettings(SimulationSettings):
    """Tuning of `RigidSimulation`."""

    loosest_bar: float = 1e-6
    """Over its length, up to which a bar may miss it at the start; a refusal, no tuning."""
    jammed: float = 1e-5
    """Smallest singular value of R, over r, at which a complaint says that bars jam."""
    longest_step: float = 100.0
    """Of the solver, in periods: as many frames are computed at once, at most.

    Half or twice as many: no difference in time or energy drift.
    """
    mendings: int = 3
    """Corrections of the energy after a step, at most; 1 and 6: the same energy drift."""


DEFAULTS = RigidSettings()


class RigidSimulation(Simulation):
    """A chain whose springs are bars of their length at rest.

    Raises ValueError for angles that the bars do not allow. Of the rates and impulses given it
    takes the part along the zero mode; the bars bear the rest. After every step of the solver
    the state is brought back onto the curve and onto the energy that it must have. Where the
    bars jam, so that no zero mode leads on, ArithmeticError says so. Arguments are those of
    `Simulation`; no rotor can be fixed, and ends are free.
    """

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
        settings: RigidSettings = DEFAULTS,
    ) -> None:
        self._settings = settings
        start = chain, angles, rates, period, tolerance
        super().__init__(*start, gravity, fixed, forces=forces, settings=settings)

    @property
    def link_torques(self) -> Array:
        """Torque of the bars on each rotor in the current frame [N m], R^T s, shape (N,).

        With I phi_ddot = R^T s + torques the lengths keep still, R phi_ddot + l_ddot = 0, where
        l_ddot is that of rotors that do not accelerate; so
        R I^-1 R^T s = -(l_ddot + R I^-1 torques). Raises ValueError where the bars jam.
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
                f'a chain of rigid bars does not move with rotor {self.fixed[0]} fixed; fix none, '
                'or simulate springs'
            )
        if chain.periodic:
            raise ValueError(
                'rigid bars between periodic ends do not move; free the ends of the chain, or '
                'simulate springs'
            )
        extensions = chain.spring_extensions(angles)
        bar = int(np.argmax(np.abs(extensions)))
        if not abs(extensions[bar]) <= self._settings.loosest_bar * chain.rest_lengths[bar]:
            raise ValueError(
                f'bar {bar} between rotors {bar} and {bar + 1} would be {extensions[bar]:.3g} m '
                f'longer than its {chain.rest_lengths[bar]:.6g} m; start from angles that the '
                'bars allow, as rest_state gives them'
            )
        closed = unstretched(chain, angles)
        mode = self._mode(closed)
        return closed, mode * float(mode @ (chain.moments_of_inertia * rates))

    def _packed(self) -> Array:
        speed = float(self._mode(self.angles) @ (self.chain.moments_of_inertia * self.rates))
        return np.concatenate([self.angles, [speed, 0.0]])

    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        angles, speed, dissipated = self._mended(state)
        return angles, speed * self._mode(angles), dissipated

    def _applied_torques(self, angles: Array) -> Array:
        return self.torques + self.gravity.torques(self.chain, angles)

    def _solver_from(self, state: Array) -> tuple[OdeSolver, float]:
        longest_step = self._settings.longest_step * self.period
        motion, rotors, chain = self.motion, self.chain.number_of_rotors, self.chain
        parameters = chain.rotor_lengths, chain.spacings, chain.moments_of_inertia

        def derivative(time: float, state: Array) -> Array:
            mode = mode_of_bars(state[:rotors], *parameters)
            rates, torques = state[rotors] * mode, np.zeros(rotors)
            dissipated = motion.add_loads(torques, time, state[:rotors], rates)
            return np.concatenate([rates, [mode @ torques, dissipated]])

        solver = scipy_solver(DOP853, derivative, state, self._tolerances(), longest_step)
        return solver, longest_step

    def _tolerances(self) -> Array:
        """Absolute tolerance of each variable of the solver."""
        chain = self.chain
        rotors = chain.number_of_rotors
        of_angles = np.full(rotors, self.tolerance / math.sqrt(rotors))
        energy = max(self._energy_scale(), float(np.finfo(np.float64).tiny))
        of_rest = [self.tolerance * math.sqrt(energy), self.tolerance * energy]
        return np.concatenate([of_angles, of_rest])

    def _after_step(self) -> None:
        state = self._solver.y
        angles, speed, _ = self._mended(state)
        state[:-2], state[-2] = angles, speed
        self._solver.f = self._solver.fun(self._solver.t, state)

    def _mended(self, state: Array) -> tuple[Array, float, float]:
        """Angles with every bar at its length, and the speed that goes with their energy.

        The energy is set right by the smallest change of place and speed along its gradient
        (-t . torques, s), which holds at turning points as well, where s vanishes.
        """
        chain = self.chain
        angles, speed, dissipated = state[:-2].copy(), float(state[-2]), float(state[-1])
        eps = float(np.finfo(np.float64).eps)
        try:
            angles = unstretched(chain, angles)
            for _ in range(self._settings.mendings):
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
        return float(self.chain.kinetic_energy(self.rates))  # bars hold no energy

    def _excess_energy(self, angles: Array, speed: float, dissipated: float) -> float:
        potential = float(self.gravity.energy(self.chain, angles))
        work = self._work + work_of_torques(self.torques, angles - self._held_from)
        return speed**2 / 2 + potential - work + self._dissipated_before + dissipated

    def _stuck(self, complaint: str) -> ArithmeticError:
        """Say so where the bars jam: where R has next to a second null vector."""
        bands = rigidity_bands(self.chain, self._solver.y[:-2])
        squares = eigvals_banded(gram_matrix_bands(*bands), select='i', select_range=(0, 0))
        jammed = squares[0] <= (self._settings.jammed * self.chain.rotor_length) ** 2
        return super()._stuck(f'the bars jam ({complaint})' if jammed else complaint)

    def _energy_scale(self) -> float:
        """What energies are made of: the motion, and a radian against gravity and torques [J]."""
        moving = float(self.chain.kinetic_energy(self.rates))
        return moving + self.gravity.scale(self.chain) + float(np.abs(self.torques).sum())

    def _mode(self, angles: Array) -> Array:
        """Zero mode of unit length in the metric of the inertia [kg^(-1/2) m^(-1)], (N,)."""
        mode = zero_mode(self.chain, angles)
        return np.asarray(mode / math.sqrt(float(self.chain.moments_of_inertia @ mode**2)))


def _centripetal(chain: Chain, angles: Array, rates: Array) -> Array:
    """Minus l_ddot of rotors that turn steadily [m/s^2], for bars of constant length, (bars,).

    With (x, y) from mass to mass, l_ddot = (x_dot^2 + y_dot^2 + x x_ddot + y y_ddot) / l.
    """
    horizontal, vertical = chain.positions(angles)
    x, y = chain.spacings + np.diff(horizontal), np.diff(vertical)
    squares = np.diff(vertical * rates) ** 2 + np.diff(horizontal * rates) ** 2
    inward = x * np.diff(horizontal * rates**2) + y * np.diff(vertical * rates**2)
    return np.asarray((inward - squares) / np.hypot(x, y))


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, const_f8_1d)
def mode_of_bars(angles: Array, lengths: Array, spacings: Array, inertias: Array) -> Array:
    """Zero mode of unit length in the metric of the inertia [kg^(-1/2) m^(-1)], shape (N,).

    It is that of `linear.rigidity.zero_mode`; each number has an exponent of its own, because the
    mode may vary by more than the range of floating-point numbers.
    """
    rotors = angles.size
    mode, exponents = np.empty(rotors), np.empty(rotors, np.int64)
    mode[0], exponents[0], largest, sign = 1.0, 0, 0, 1.0
    h_left = lengths[0] * math.sin(angles[0])
    v_left = lengths[0] * math.cos(angles[0])
    for n in range(1, rotors):
        h = lengths[n] * math.sin(angles[n])
        v = lengths[n] * math.cos(angles[n])
        across, up = spacings[n - 1] + (h - h_left), v - v_left
        first, second = h_left * up - v_left * across, v * across - h * up
        first = VANISHING if abs(first) < VANISHING else first
        second = VANISHING if abs(second) < VANISHING else second
        sign = -sign if second < 0 else sign
        mode[n], shift = math.frexp(-mode[n - 1] * first / second)
        exponents[n] = exponents[n - 1] + shift
        largest = max(largest, exponents[n])
        h_left, v_left = h, v
    mass = 0.0
    for n in range(rotors):
        mode[n] = math.ldexp(mode[n], max(exponents[n] - largest, _FLUSHED))
        mass += inertias[n] * mode[n] ** 2
    return mode * (sign / math.sqrt(mass))
