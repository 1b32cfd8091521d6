# SPDX-License-Identifier: Apache-2.0
"""Steps of a symplectic Runge-Kutta-Nystrom method along the motion of a chain of springs.

A step of length h is a palindrome of drifts and kicks,

    drift(a_15 h) kick(b_14 h) drift(a_14 h) ... kick(b_1 h) drift(a_1 h),

both of which are exact flows: a kick changes the rates by the accelerations at the angles as they
are; a drift turns rotors at their rates, which decay with the damping gamma = c / (M r^2),

    phi_dot(t) = phi_dot e^(-gamma t),    phi(t) = phi + phi_dot (1 - e^(-gamma t)) / gamma,

and takes out the kinetic energy that they lose. Without damping the map is symplectic and each
step is undone by a step of -h. With it areas in phase space shrink exactly as those of the motion
do, by e^(-h sum gamma), and energy plus dissipated energy is what stays near its value.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.chain_solver import DEFAULTS, SolverSettings
from soliton_linkage.dynamics.integrators.forces import Numbers, forces_of, padded, places_of
from soliton_linkage.dynamics.integrators.nystrom_coefficients import DRIFTS, KICKS
from soliton_linkage.dynamics.integrators.nystrom_loops import PlainStep, advance, interpolate
from soliton_linkage.dynamics.integrators.rotor_loops import (
    ANGLES,
    RATES,
    Checks,
    load_angles,
    work_for,
)
from soliton_linkage.linkage.chain import Array

NONE: Numbers = np.empty(0, dtype=np.int64)
"""No step has its error measured."""


def steps_to_measure(taken: int, count: int, every: int) -> Numbers:
    """Which of the next steps have their error measured; the next one is 1.

    Of the first step of a length, which says little of a motion that begins, of two soon after
    it, and then of one in so many; some of this length were taken before.
    """
    regular = np.arange(every - taken % every, count + 1, every)
    early = [step for step in (1, 4, 16) if taken < step <= taken + count]
    return np.append(np.array(early) - taken, regular) if early else regular


class NystromSteps:
    """Takes steps along a motion."""

    def __init__(self, motion: EquationOfMotion, settings: SolverSettings = DEFAULTS) -> None:
        """Along a motion, with nothing taken over from one step to the next."""
        self._motion = motion
        self._until_exact = settings.steps_until_exact
        self.forces = forces_of(motion)
        half_inertias = motion.chain.moments_of_inertia / 2
        self._half_inertias = self._padded(half_inertias) if motion.damped else np.empty(0)
        self._prepared = math.nan
        self._work = work_for(places_of(motion))
        self._since_load = self._until_exact

    def advance(
        self, state: Array, length: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """States at the start and after each of count steps [s], and the largest error.

        It stops before a step in which a rotor would turn by more than half a radian in a drift,
        or whose error against two steps of half the length exceeds 1, so that the states have
        the shape (done + 1, len(state)).
        """
        number = self._motion.rotors
        states = np.empty((count + 1, len(state)))
        states[0] = state
        self._since_load += count
        if (
            self._since_load > self._until_exact
            or (self._work[ANGLES, :number] != states[0, :number]).any()
        ):
            self._since_load = 0
            load_angles(self._work, states[0, :number])
        self._work[RATES, :number] = state[number : 2 * number]
        step, plain = self._prepare(length), tuple(checks or (states[0], 0.0, NONE))
        done, error = advance(self._work, self.forces, step, plain, states)
        return states[: done + 1], error

    def interpolated(self, states: Array, length: float, places: Array) -> Array:
        """States at places, counted in steps from the first state, shape (places, len(state)).

        Polynomials in each step, degree 8 in the angles, have angles, rates and accelerations at
        its ends and its middle.
        """
        angles = states[:, : self._motion.rotors]
        output = np.empty((len(places), states.shape[1]))
        circular = np.array([np.cos(angles), np.sin(angles)])
        step = self._prepare(length)
        interpolate(self._work, self.forces, step, states, circular, places, output)
        return output

    def step(self, length: float) -> PlainStep:
        """What steps of a length [s] need, the fields of `nystrom_loops.Step`."""
        decays = self._decays(length)
        rates = self._motion.decay_rates
        return length * DRIFTS, length * KICKS, decays, self._half_inertias, rates

    def _prepare(self, length: float) -> PlainStep:
        """What steps of a length need, as the last ones may have had it."""
        if length != self._prepared:
            self._prepared, self._step = length, self.step(length)
        return self._step

    def _decays(self, length: float) -> Array:
        if not self._motion.damped:
            return np.empty((2, 2, len(DRIFTS), 0))
        times = np.multiply.outer([length / 2, length], DRIFTS)[..., np.newaxis]
        return self._padded(np.array(decay(self._motion, times)).swapaxes(0, 1))

    def _padded(self, values: Array) -> Array:
        return padded(values, places_of(self._motion))


def decay(motion: EquationOfMotion, time: float | Array) -> tuple[Array, Array]:
    """Factor of the rates after a free time [s], and the angle turned per rate [s], (N,) each.

    Of times of shape (..., 1) they have the shape (..., N).
    """
    exponents = -motion.decay_rates * time
    divisors = np.where(exponents == 0, 1.0, exponents)
    growth = np.where(exponents == 0, 1.0, np.expm1(exponents) / divisors)
    return np.exp(exponents), time * growth
