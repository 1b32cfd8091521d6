# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain in time, sampled at exact instants, whatever its mechanics."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion, checked_rotors
from soliton_linkage.dynamics.terms import Term, TorqueFunction
from soliton_linkage.dynamics.work import work_of_kick, work_of_torques
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage.linkage.recording import Recording

SMALLEST_RELATIVE_TOLERANCE = 100 * float(np.finfo(np.float64).eps)
"""Scipy's solvers take nothing smaller; rotors that have turned far must not be less exact."""


@dataclass(frozen=True)
class SimulationSettings:
    """Tuning of every simulation."""

    max_steps: int = 1000
    """Of the solver, in a unit of time of the springs, beyond which it is said to be stuck.

    Half or twice as many: it gives up as much earlier or later.
    """


DEFAULTS = SimulationSettings()


class Simulation(ABC):
    """A chain that moves under its mechanics, gravity, damping, and applied torques and kicks.

    The frame k is the state at exactly k * period after the start, whatever steps the solver
    takes: it is read off the solver's dense output. Kicks, torques and changes of gravity act
    at the instant of the current frame. The error that the solver may make in a step is
    `tolerance` [rad] in the angles, and as much per `chain.time_unit` in the rates (norm over
    all rotors), however many rotors there are and however far they have turned. `kicks` counts
    kicks and `kick_work` is the energy that they have given [J].

    It starts from `angles` [rad] and `rates` [rad/s], shape (N,), or from rest; `period` is in
    [s]. The rotors numbered in `fixed` stay at the angle that they start from; their mounts bear
    whatever acts on them. `forces` are further terms of the equation of motion, or functions
    f(time, angles, rates) -> torques [N m]. Raises ValueError for what is out of its range or
    does not fit the chain.
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
        settings: SimulationSettings = DEFAULTS,
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
        self._most_steps = settings.max_steps
        self.frame = 0
        given = chain.check_angles(angles).copy()
        moving = np.zeros_like(given) if rates is None else chain.check_angles(rates, 'rate')
        self.torques = np.zeros_like(given)
        self.kicks = 0
        self.kick_work = 0.0
        self.angles, self.rates = self._allowed(given, moving.copy())
        self._held_from = self.angles
        self._dissipated = 0.0
        self._dissipated_before = 0.0
        self._work = self._finite_energy()
        self._stale = True
        self._gravity_at_start = float(gravity.energy(chain, self.angles))
        rounding = np.finfo(float).eps * chain.stiffness * chain.rest_length**2
        self._largest_energy = float(rounding) + gravity.scale(chain)
        self._restart()

    @property
    def time(self) -> float:
        """Time of the current frame since the start [s]."""
        return self.frame * self.period

    @property
    def energy(self) -> float:
        """Kinetic, elastic and gravitational energy of the current frame [J]."""
        weight = self.gravity.energy(self.chain, self.angles)
        return self._motion_and_springs() + float(weight)

    @property
    @abstractmethod
    def link_torques(self) -> Array:
        """Torque of the springs or bars on each rotor in the current frame [N m], shape (N,)."""

    @property
    def motion(self) -> EquationOfMotion:
        """Equation of motion from the last kick, change of torques or of gravity on."""
        if self._equation is None:
            self._equation = EquationOfMotion(
                self.chain, self.torques, self.gravity, self.fixed, self.forces, self.time
            )
        return self._equation

    @property
    def dissipated(self) -> float:
        """Energy that damping and `forces` have taken out since the start [J]."""
        return self._dissipated_before + self._dissipated

    @property
    def energy_drift(self) -> float:
        """Energy that the solver gained or lost since the start, over the largest there was [1].

        The work of kicks, torques and damping is accounted for. Energies below the rounding of
        k_e lbar^2, as a chain at rest has, count as that much, and gravity as sum_n M g r at
        least.
        """
        fallen = float(self.gravity.energy(self.chain, self.angles)) - self._gravity_at_start
        self._largest_energy = max(self._largest_energy, self._motion_and_springs(), abs(fallen))
        return (self.energy - self._expected_energy()) / self._largest_energy

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses J [N m s], shape (N,), at the instant of the current frame.

        They do the work W = J . (phi_dot before + phi_dot after) / 2.
        """
        checked = self.chain.check_angles(impulses, 'impulse')
        with np.errstate(over='ignore', invalid='ignore'):
            rates = self.rates + checked / self.chain.moments_of_inertia
            _, rates = self._allowed(self.angles, rates)
            gained = work_of_kick(checked, self.rates, rates)
        if not math.isfinite(gained):
            rotor = int(np.argmax(np.abs(checked)))
            raise ValueError(
                f'impulse of rotor {rotor} = {checked[rotor]:g} N m s gives an energy that is no '
                'finite number; kick more gently'
            )
        self.rates = rates
        self.kicks += 1
        self.kick_work += gained
        self._work += gained
        self._restart()

    def hold(self, torques: Array) -> None:
        """Apply torques [N m], shape (N,), from the current frame until told otherwise."""
        checked = self.chain.check_angles(torques, 'torque')
        if np.array_equal(checked, self.torques):
            return
        self._work += self._work_of_torques()
        self._held_from = self.angles
        self.torques = checked.copy()
        self._restart()

    def set_gravity(self, gravity: Gravity) -> None:
        """Change gravity at the instant of the current frame; the chain gains the difference."""
        if gravity == self.gravity:
            return
        before = float(self.gravity.energy(self.chain, self.angles))
        self.gravity = gravity
        gained = float(gravity.energy(self.chain, self.angles)) - before
        self._work += gained
        self._gravity_at_start += gained
        self._largest_energy = max(self._largest_energy, gravity.scale(self.chain))
        self._restart()

    @property
    def steps_per_frame(self) -> float:
        """Least number of steps of the solver from a frame to the next, 0 before the first [1]."""
        return 0.0 if self._stale else self.period / self._longest_step

    @property
    def progress(self) -> float:
        """How much of the way to the next frame is computed [1]."""
        done = 0.0 if self._stale else self._solver.t / self.period
        return 1.0 if self.ready else done - (self.frame - self._first_frame)

    @property
    def ready(self) -> bool:
        """Whether the next frame is computed."""
        return self._ahead < len(self._batch)

    def step(self) -> None:
        """Take one step of the solver towards the next frame; the current one stays as it is."""
        if self._stale:
            # It is made once however much happens at a frame.
            self._solver, longest_step = self._solver_from(self._packed())
            self._longest_step = longest_step
            self._time_unit = min(self.chain.time_unit, longest_step)
            self._stale = False
        complaint = self._solver.step()
        self._steps += 1
        if self._steps > self._most_steps * (1 + self.period / self._time_unit):
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
        """Go on to the next frame, in as many steps as it takes."""
        while not self.ready:
            self.step()
        self._steps = 0
        state = self._batch[self._ahead]
        self._ahead += 1
        self.frame += 1
        self.angles, self.rates, self._dissipated = self._unpacked(state)

    def record(self, duration: float) -> Recording:
        """Record from the current frame on: every period for a duration [s], both ends."""
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
        """Return the nearest angles and rates that the mechanics allow, or raise ValueError."""

    @abstractmethod
    def _packed(self) -> Array:
        """State of the current frame in the solver's variables, nothing dissipated so far."""

    @abstractmethod
    def _unpacked(self, state: Array) -> tuple[Array, Array, float]:
        """Angles [rad], rates [rad/s] and dissipated energy [J] of a state of the solver."""

    @abstractmethod
    def _solver_from(self, state: Array) -> tuple[OdeSolver, float]:
        """Solver from a state on, and the longest step that is stable or wanted [s]."""

    @abstractmethod
    def _after_step(self) -> None:
        """Mend what a step of the solver has spoilt."""

    def _finite_energy(self) -> float:
        with np.errstate(over='ignore', invalid='ignore'):
            energy = self.energy
        if not math.isfinite(energy):
            rotor = int(np.argmax(np.abs(self.rates)))
            raise ValueError(
                f'rate of rotor {rotor} = {self.rates[rotor]:g} rad/s gives an energy that is no '
                'finite number; start more slowly'
            )
        return energy

    def _motion_and_springs(self) -> float:
        elastic = self.chain.elastic_energy(self.angles)
        return float(elastic + self.chain.kinetic_energy(self.rates))

    def _expected_energy(self) -> float:
        return self._work + self._work_of_torques() - self.dissipated

    def _work_of_torques(self) -> float:
        """Work of the torques held now, since they were set [J]."""
        return work_of_torques(self.torques, self.angles - self._held_from)

    def _stuck(self, complaint: str) -> ArithmeticError:
        fastest = int(np.argmax(np.abs(self.rates)))
        return ArithmeticError(
            f'the chain could not be integrated beyond t = {self.time:.6g} s, where rotor '
            f'{fastest} turns at {self.rates[fastest]:.3g} rad/s: {complaint.rstrip(".")}; '
            f'kick more gently or loosen the tolerance ({self.tolerance:g} rad)'
        )

    def _restart(self) -> None:
        """Let the solver start anew at the current frame, where the state or forces jump."""
        self._equation = None
        self._first_frame = self.frame
        self._steps = 0
        self._ahead = 0
        self._dissipated_before += self._dissipated
        self._dissipated = 0.0
        self._batch = np.empty((0, 0))
        self._stale = True


def scipy_solver(
    method: type[OdeSolver],
    right_hand_side: Callable[[float, Array], Array],
    state: Array,
    tolerances: Array,
    longest_step: float,
) -> OdeSolver:
    """Solver from a state on for ever, of absolute tolerances, one a variable, and steps [s]."""
    return method(
        right_hand_side,
        0.0,
        state,
        np.inf,
        rtol=SMALLEST_RELATIVE_TOLERANCE,
        atol=tolerances,
        max_step=longest_step,
    )
