# SPDX-License-Identifier: Apache-2.0
"""Motion of the chain in time, sampled at exact instants."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import DOP853

from soliton_linkage.chain import Array, Chain
from soliton_linkage.recording import Recording

_SMALLEST_RELATIVE_TOLERANCE = 100 * np.finfo(float).eps
_MOST_STEPS_A_TIME_UNIT = 1000
# No spring vibrates faster than 2 / time_unit, for which DOP853 is stable in steps of 3 units. A
# chain at rest asks for no accuracy, and longer steps would make a motion of rounding errors.
_LONGEST_STEP = 2.5


class Simulation:
    """A chain of springs that moves by M r^2 phi_ddot = -dV/dphi + applied torque.

    The frame k is the state at exactly k * period after the start, whatever steps the solver
    takes: it is read off the solver's dense output. Kicks and torques act at the instant of the
    current frame. The error that the solver may make in a step is `tolerance` [rad] in the
    angles, and as much per `chain.time_unit` in the rates (norm over all rotors), however many
    rotors there are and however far they have turned.
    """

    def __init__(
        self,
        chain: Chain,
        angles: Array,
        rates: Array | None = None,
        period: float = 0.01,
        tolerance: float = 1e-11,
    ) -> None:
        """Start from angles [rad] and rates [rad/s], shape (N,); period in [s]."""
        if not (math.isfinite(period) and period > 0):
            raise ValueError(f'period = {period} s must be a finite number above 0')
        if not 1e-13 <= tolerance <= 1e-2:
            raise ValueError(f'tolerance = {tolerance} rad must lie in the range 1e-13 to 0.01')
        self.chain = chain
        self.period = period
        self.tolerance = tolerance
        self.frame = 0
        self.angles = chain.check_angles(angles).copy()
        self.rates = np.zeros_like(self.angles)
        if rates is not None:
            self.rates = chain.check_angles(rates, 'rate').copy()
        self.torques = np.zeros_like(self.angles)
        self._held_from = self.angles
        self._work = self.energy
        rounding = np.finfo(float).eps * chain.stiffness * chain.rest_length**2
        self._largest_energy = max(self._work, float(rounding))
        self._restart()

    @property
    def time(self) -> float:
        """Time of the current frame since the start [s]."""
        return self.frame * self.period

    @property
    def energy(self) -> float:
        """Kinetic and elastic energy of the current frame [J]."""
        elastic = self.chain.elastic_energy(self.angles)
        return float(elastic + self.chain.kinetic_energy(self.rates))

    @property
    def energy_drift(self) -> float:
        """Energy that the solver gained or lost since the start, over the largest there was [1].

        The work of kicks and torques is accounted for. Energies below the rounding of
        k_e lbar^2, as a chain at rest has, count as that much.
        """
        energy = self.energy
        self._largest_energy = max(self._largest_energy, energy)
        expected = self._work + self._work_of_torques()
        return (energy - expected) / self._largest_energy

    def kick(self, impulses: Array) -> None:
        """Apply angular impulses [N m s], shape (N,), at the instant of the current frame."""
        checked = self.chain.check_angles(impulses, 'impulse')
        with np.errstate(over='ignore'):
            rates = self.rates + checked / self.chain.moment_of_inertia
            gained = float(
                self.chain.kinetic_energy(rates) - self.chain.kinetic_energy(self.rates)
            )
        if not math.isfinite(gained):
            rotor = int(np.argmax(np.abs(checked)))
            raise ValueError(
                f'impulse of rotor {rotor} = {checked[rotor]:g} N m s gives an energy that is no '
                'finite number; kick more gently'
            )
        self.rates = rates
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

    @property
    def ready(self) -> bool:
        """Whether the next frame is computed."""
        return self._ahead < len(self._batch)

    def step(self) -> None:
        """Take one step of the solver towards the next frame; the current one stays as it is."""
        complaint = self._solver.step()
        self._steps += 1
        if self._steps > _MOST_STEPS_A_TIME_UNIT * (1 + self.period / self.chain.time_unit):
            complaint = f'the next frame takes more than {self._steps - 1} steps'
        if complaint:
            fastest = int(np.argmax(np.abs(self.rates)))
            raise ArithmeticError(
                f'the chain could not be integrated beyond t = {self.time:.6g} s, where rotor '
                f'{fastest} turns at {self.rates[fastest]:.3g} rad/s: {complaint.rstrip(".")}; '
                f'kick more gently or loosen the tolerance ({self.tolerance:g} rad)'
            )
        done = self.frame - self._first_frame
        last = math.floor(self._solver.t / self.period)
        frames = np.arange(done + 1, max(done, last) + 1)
        self._batch = np.ascontiguousarray(self._solver.dense_output()(frames * self.period).T)
        self._ahead = 0

    def advance(self) -> None:
        """Go on to the next frame, in as many steps as it takes."""
        while not self.ready:
            self.step()
        self._steps = 0
        state = self._batch[self._ahead]
        self._ahead += 1
        self.frame += 1
        rotors = self.chain.number_of_rotors
        self.angles, self.rates = state[:rotors], state[rotors:]

    def _work_of_torques(self) -> float:
        """Work of the torques held now, since they were set [J]."""
        return float(self.torques @ (self.angles - self._held_from))

    def _restart(self) -> None:
        """Start the solver anew at the current frame, whose forces are not those of the last."""
        self._first_frame = self.frame
        self._steps = 0
        self._ahead = 0
        self._batch = np.empty((0, 2 * self.chain.number_of_rotors))
        # The solver takes the root mean square over its variables, in which a wall in a long
        # chain would be drowned by the rotors at rest.
        rotors = self.chain.number_of_rotors
        tolerance = np.full(rotors, self.tolerance / math.sqrt(2 * rotors))
        self._solver: DOP853 = DOP853(
            self._derivative,
            0.0,
            np.concatenate([self.angles, self.rates]),
            np.inf,
            rtol=_SMALLEST_RELATIVE_TOLERANCE,
            atol=np.concatenate([tolerance, tolerance / self.chain.time_unit]),
            max_step=_LONGEST_STEP * self.chain.time_unit,
        )

    def _derivative(self, _time: float, state: Array) -> Array:
        rotors = self.chain.number_of_rotors
        torques = self.chain.spring_torques(state[:rotors]) + self.torques
        return np.concatenate([state[rotors:], torques / self.chain.moment_of_inertia])


def simulate(
    chain: Chain,
    angles: Array,
    rates: Array,
    duration: float,
    period: float,
    tolerance: float = 1e-11,
) -> Recording:
    """Record the free motion from a state: every period [s] for a duration [s], both ends."""
    if not (math.isfinite(duration) and duration >= 0):
        raise ValueError(f'duration = {duration} s must be a finite number of 0 or more')
    simulation = Simulation(chain, angles, rates, period, tolerance)
    frames = [(simulation.angles, simulation.rates)]
    for _ in range(math.floor(duration / period * (1 + 1e-12))):
        simulation.advance()
        frames.append((simulation.angles, simulation.rates))
    return Recording(
        times=period * np.arange(len(frames), dtype=np.float64),
        angles=np.array([angles for angles, _ in frames]),
        rates=np.array([rates for _, rates in frames]),
    )
