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

import numpy as np
from scipy.linalg import eigvals_banded, solveh_banded

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linear.rigidity import rigidity_bands, zero_mode
from soliton_linkage.linear.statics import banded_products, unstretched
from soliton_linkage.linkage.chain import Array, Chain

_LOOSEST_BAR = 1e-6
_JAMMED = 1e-5
_LONGEST_STEP = 100
_MENDINGS = 3


class RigidSimulation(Simulation):
    """A chain whose springs are bars of their length at rest.

    Raises ValueError for angles that the bars do not allow. Of the rates and impulses given it
    takes the part along the zero mode; the bars bear the rest. After every step of the solver
    the state is brought back onto the curve and onto the energy that it must have. Where the
    bars jam, so that no zero mode leads on, ArithmeticError says so.
    """

    @property
    def link_torques(self) -> Array:
        """Torque of the bars on each rotor in the current frame [N m], R^T s, shape (N,).

        With I phi_ddot = R^T s + torques the lengths keep still, R phi_ddot + l_ddot = 0, where
        l_ddot is that of rotors that do not accelerate; so
        R I^-1 R^T s = -(l_ddot + R I^-1 torques). Raises ValueError where the bars jam.
        """
        chain, angles, rates = self.chain, self.angles, self.rates
        first, second = rigidity_bands(chain, angles)
        free = (self._applied_torques(angles) - chain.dampings * rates) / chain.moments_of_inertia
        shrinking = _centripetal(chain, angles, rates) - first * free[:-1] - second * free[1:]
        weights = 1 / np.sqrt(chain.moments_of_inertia)
        products = banded_products(first * weights[:-1], second * weights[1:])
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
        if not abs(extensions[bar]) <= _LOOSEST_BAR * chain.rest_lengths[bar]:
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

    def _derivative(self, _time: float, state: Array) -> Array:
        angles, speed = state[:-2], float(state[-2])
        mode = self._mode(angles)
        friction = speed * float(mode @ (self.chain.dampings * mode))
        power = float(mode @ self._applied_torques(angles)) - friction
        return np.concatenate([speed * mode, [power, friction * speed]])

    def _tolerances(self) -> tuple[Array, float]:
        chain = self.chain
        rotors = chain.number_of_rotors
        of_angles = np.full(rotors, self.tolerance / math.sqrt(rotors))
        energy = max(self._energy_scale(), float(np.finfo(np.float64).tiny))
        of_rest = [self.tolerance * math.sqrt(energy), self.tolerance * energy]
        return np.concatenate([of_angles, of_rest]), _LONGEST_STEP * self.period

    def _after_step(self) -> None:
        state = self._solver.y
        angles, speed, _ = self._mended(state)
        state[:-2], state[-2] = angles, speed
        self._solver.f = self._derivative(self._solver.t, state)

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
            for _ in range(_MENDINGS):
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

    def _excess_energy(self, angles: Array, speed: float, dissipated: float) -> float:
        potential = float(self.gravity.energy(self.chain, angles))
        work = self._work + float(self.torques @ (angles - self._held_from))
        return speed**2 / 2 + potential - work + self._dissipated_before + dissipated

    def _stuck(self, complaint: str) -> ArithmeticError:
        """Say so where the bars jam: where R has next to a second null vector."""
        bands = rigidity_bands(self.chain, self._solver.y[:-2])
        squares = eigvals_banded(banded_products(*bands), select='i', select_range=(0, 0))
        jammed = squares[0] <= (_JAMMED * self.chain.rotor_length) ** 2
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
