# SPDX-License-Identifier: Apache-2.0
"""Base class of the simulations, which compute the state of a chain at equally spaced instants."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion, checked_rotors
from soliton_linkage.dynamics.motor_controllers import MotorControllers
from soliton_linkage.dynamics.terms import Term, TorqueFunction
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage.linkage.recording import Recording

SMALLEST_RELATIVE_TOLERANCE = 100 * float(np.finfo(np.float64).eps)
"""Smallest relative tolerance that scipy's solvers accept [1]. Because this tolerance is so small,
the absolute tolerance limits the error even for large unwrapped angles."""


@dataclass(frozen=True)
class SimulationSettings:
    """Tuning of every simulation."""

    max_steps: int = 1000
    """Factor in the largest number of solver steps per frame, `max_steps` (1 + `period` / T) [1].
    T is the smaller of `Chain.time_unit` and the longest step that the solver may take."""


class Simulation(ABC):
    """Simulation of a chain with gravity, applied torques, kicks and the force terms of the chain.

    Frame k is the state at the time k * `period` [s] after the start. A kick, a new torque or a
    change of gravity takes effect at the current frame. The torques of `Chain.feedback` are
    computed at each frame and are constant until the next frame. In each solver step, the norm of
    the errors of all angles (the square root of the sum of their squares) is at most `tolerance`
    [rad], and the norm of the errors of all rates is at most `tolerance` / `chain.time_unit`.
    `kicks` is the number of kicks so far, and `kick_work` is their total work [J].

    The simulation starts from `angles` [rad] and `rates` [rad/s], by default from rest. Rotors in
    `fixed` do not turn. `forces` contains additional terms of the equation of motion, or functions
    f(time, angles, rates) -> torques [N m]. Raises ValueError for invalid arguments.
    """

    _settings = SimulationSettings()

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
        settings: SimulationSettings | None = None,
    ) -> None:
        if not (math.isfinite(period) and period > 0):
            raise ValueError(f'period = {period} s must be a finite number above 0')
        if not 1e-13 <= tolerance <= 1e-2:
            raise ValueError(f'tolerance = {tolerance} rad must lie in the range 1e-13 to 0.01')
        self.chain = chain
        self.period = period
        self.tolerance = tolerance
        self.gravity = gravity
        self.fixed = checked_rotors(chain, fixed)
        self.forces = tuple(forces)
        self._equation: EquationOfMotion | None = None
        self._settings = settings or self._settings
        self.frame = 0
        given = chain.check_angles(angles).copy()
        moving = np.zeros_like(given) if rates is None else chain.check_angles(rates, 'rate')
        self.torques = np.zeros_like(given)
        self._controllers = MotorControllers(chain) if chain.feedback.acts else None
        self.kicks = 0
        self.kick_work = 0.0
        self.angles, self.rates = self._allowed(given, moving.copy())
        self.feedback_torques = self._feedback()
        self._held_from = self._feedback_from = self.angles
        self._dissipated = 0.0
        self._dissipated_before = 0.0
        self._work = self._finite_energy()
        self._stale = True
        self._external_at_start = self.motion.external_energy(self.angles)
        rounding = np.finfo(float).eps * chain.stiffness * chain.rest_length**2
        self._largest_energy = float(rounding) + self.motion.external_scale
        self._restart()

    @property
    def time(self) -> float:
        """Time of the current frame since the start [s]."""
        return self.frame * self.period

    @property
    def energy(self) -> float:
        """Kinetic, elastic, gravitational and on-site energy of the current frame [J]."""
        return self._motion_and_springs() + self.motion.external_energy(self.angles)

    @property
    @abstractmethod
    def link_torques(self) -> Array:
        """Torque of the springs or bars on each rotor in the current frame [N m], shape (N,)."""

    @property
    def motion(self) -> EquationOfMotion:
        """Current equation of motion; its torques include the feedback torques."""
        if self._equation is None:
            torques = self.torques + self.feedback_torques
            self._equation = EquationOfMotion(
                self.chain, torques, self.gravity, self.fixed, self.forces, self.time
            )
        return self._equation

    @property
    def dissipated(self) -> float:
        """Energy dissipated since the start minus energy that the motors have added [J]."""
        return self._dissipated_before + self._dissipated_at(self.angles, self._dissipated)

    @property
    def energy_drift(self) -> float:
        """Relative error of the energy balance [1].

        The error is energy - initial energy - work + dissipated energy, divided by the largest
        energy that has occurred.
        """
        change = self.motion.external_energy(self.angles) - self._external_at_start
        self._largest_energy = max(self._largest_energy, self._motion_and_springs(), abs(change))
        expected = self._work + self._work_of_torques(self.angles) - self.dissipated
        return (self.energy - expected) / self._largest_energy

    def kick(self, impulses: Array) -> None:
        """Apply impulses [N m s], shape (N,), at the current frame.

        Raises ValueError if the work of the impulses is not finite.
        """
        checked = self.chain.check_angles(impulses, 'impulse')
        with np.errstate(over='ignore', invalid='ignore'):
            rates = self.rates + checked / self.chain.moments_of_inertia
            _, rates = self._allowed(self.angles, rates)
            gained = float(np.add.reduce(checked * (self.rates + rates))) / 2
        if not math.isfinite(gained):
            rotor = int(np.argmax(np.abs(checked)))
            raise ValueError(
                f'impulse of rotor {rotor} = {checked[rotor]:g} N m s gives an energy that is not '
                'finite; apply smaller impulses'
            )
        self.rates = rates
        self.kicks += 1
        self.kick_work += gained
        self._work += gained
        self._restart()

    def hold(self, torques: Array) -> None:
        """Apply constant torques [N m], shape (N,), from now until the next call of `hold`."""
        checked = self.chain.check_angles(torques, 'torque')
        if np.array_equal(checked, self.torques):
            return
        self._work += self._work_of_torques(self.angles)
        self._held_from = self.angles
        self.torques = checked.copy()
        self._restart()

    def set_gravity(self, gravity: Gravity) -> None:
        """Change gravity at the current frame; the change of energy counts as work."""
        if gravity != self.gravity:
            before = self.energy
            self.gravity = gravity
            self._restart_with(before)

    def set_non_reciprocity(self, value: float) -> None:
        """Change the non-reciprocity [N m/rad] of all bonds at the current frame."""
        if value != self.chain.non_reciprocity:
            before = self.energy
            self.chain = replace(self.chain, non_reciprocity=value)
            self._restart_with(before)

    @property
    def steps_per_frame(self) -> float:
        """Lower bound of the number of solver steps per frame [1].

        The bound is the frame period divided by the longest step that the solver may take. It is 0
        if the solver has taken no step since the last restart, for example after a kick.
        """
        return 0.0 if self._stale else self.period / self._longest_step

    @property
    def progress(self) -> float:
        """Computed fraction of the interval from the current frame to the next [1]."""
        done = 0.0 if self._stale else self._solver.t / self.period
        return 1.0 if self.ready else done - (self.frame - self._first_frame)

    @property
    def ready(self) -> bool:
        """Whether the next frame has been computed."""
        return self._ahead < len(self._batch)

    def step(self) -> None:
        """Take one solver step towards the next frame; the current frame does not change."""
        if self._stale:
            # The solver is created here, not at each kick or change of torques. Therefore several
            # changes at one frame create only one solver.
            self._solver, longest_step = self._solver_from(self._packed())
            self._longest_step = longest_step
            self._time_unit = min(self.chain.time_unit, longest_step)
            self._stale = False
        complaint = self._solver.step()
        self._steps += 1
        if self._steps > self._settings.max_steps * (1 + self.period / self._time_unit):
            complaint = f'the next frame takes more than {self._steps - 1} steps'
        if complaint:
            raise self._stuck(complaint)
        done = self.frame - self._first_frame
        last = math.floor(self._solver.t / self.period)
        frames = np.arange(done + 1, max(done, last) + 1)
        self._batch = np.ascontiguousarray(self._solver.dense_output()(frames * self.period).T)
        self._ahead = 0
        self._after_step()

    def advance(self) -> None:
        """Advance to the next frame; take solver steps until this frame is computed."""
        while not self.ready:
            self.step()
        self._steps = 0
        state = self._batch[self._ahead]
        self._ahead += 1
        self.frame += 1
        self.angles, self.rates, self._dissipated = self._unpacked(state)
        if self._controllers is not None:
            self._restart()
            self.feedback_torques = self._feedback()

    def record(self, duration: float) -> Recording:
        """Record the current frame and all following frames for `duration` [s]."""
        if not (math.isfinite(duration) and duration >= 0):
            raise ValueError(f'duration = {duration} s must be a finite number of 0 or more')
        start = self.frame
        frames = [(self.angles, self.rates)]
        for _ in range(math.floor(duration / self.period * (1 + 1e-12))):
            self.advance()
            frames.append((self.angles, self.rates))
        return Recording(
            times=self.period * (start + np.arange(len(frames), dtype=np.float64)),
            angles=np.array([angles for angles, _ in frames]),
            rates=np.array([rates for _, rates in frames]),
        )

    @abstractmethod
    def _allowed(self, angles: Array, rates: Array) -> tuple[Array, Array]:
        """Return the nearest allowed angles and rates; raise ValueError if there are none."""

    @abstractmethod
    def _packed(self) -> Array:
        """Return the solver state of the current frame, with the dissipated energy set to 0."""

    @abstractmethod
    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        """Return angles [rad], rates [rad/s] and dissipated energy [J] of a solver state."""

    @abstractmethod
    def _solver_from(self, state: Array) -> tuple[OdeSolver, float]:
        """Return a solver that starts at a state, and the longest step that it may take [s]."""

    @staticmethod
    def _solver_of(
        method: type[OdeSolver], fun: Any, state: Array, tolerances: Array, **options: float
    ) -> OdeSolver:
        rtol = SMALLEST_RELATIVE_TOLERANCE
        return method(fun, 0.0, state, np.inf, rtol=rtol, atol=tolerances, **options)

    @abstractmethod
    def _after_step(self) -> None:
        """Adjust the solver or its state after a solver step."""

    def _finite_energy(self) -> float:
        with np.errstate(over='ignore', invalid='ignore'):
            energy = self.energy
        if not math.isfinite(energy):
            rotor = int(np.argmax(np.abs(self.rates)))
            raise ValueError(
                f'rate of rotor {rotor} = {self.rates[rotor]:g} rad/s gives an energy that is not '
                'finite; start with smaller rates'
            )
        return energy

    def _motion_and_springs(self) -> float:
        elastic = self.chain.elastic_energy(self.angles)
        return float(elastic + self.chain.kinetic_energy(self.rates))

    def _work_of_torques(self, angles: Array) -> float:
        """Return the work of `torques` since the last `hold`, up to given angles [J]."""
        return float(self.torques @ (angles - self._held_from))

    def _dissipated_at(self, angles: Array, dissipated: float) -> float:
        """Return `dissipated` minus the work of the feedback torques [J].

        Both count from the last restart of the solver. The work is done until the angles `angles`
        [rad] are reached.
        """
        return dissipated - float(self.feedback_torques @ (angles - self._feedback_from))

    def _feedback(self) -> Array:
        if self._controllers is None:
            return np.zeros_like(self.angles)
        return self._controllers.torques(self.time, self.angles)

    def _stuck(self, complaint: str) -> ArithmeticError:
        fastest = int(np.argmax(np.abs(self.rates)))
        return ArithmeticError(
            f'the chain could not be integrated beyond t = {self.time:.6g} s, where rotor '
            f'{fastest} turns at {self.rates[fastest]:.3g} rad/s: {complaint.rstrip(".")}; '
            f'apply smaller impulses or raise the tolerance ({self.tolerance:g} rad)'
        )

    def _restart_with(self, before: float) -> None:
        """Restart after a change of forces. The energy change counts as work.

        `before` is the energy before the change [J].
        """
        self._restart()
        gained = self.energy - before
        self._work += gained
        self._external_at_start += gained
        self._largest_energy = max(self._largest_energy, self.motion.external_scale)

    def _restart(self) -> None:
        self._equation = None
        self._first_frame = self.frame
        self._steps = 0
        self._ahead = 0
        self._dissipated_before += self._dissipated_at(self.angles, self._dissipated)
        self._dissipated, self._feedback_from = 0.0, self.angles
        self._batch = np.empty((0, 0))
        self._stale = True
