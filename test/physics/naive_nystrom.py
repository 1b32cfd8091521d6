# SPDX-License-Identifier: Apache-2.0
"""Naive twin of `NystromSteps`: its steps as the equations have them."""

import math

import numpy as np
from chain_motions import motor_torque_rates, motor_torques

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import LARGEST_TURN, Checks
from soliton_linkage.dynamics.integrators.nystrom_steps import DRIFTS, KICKS
from soliton_linkage.linkage.chain import Array


class NaiveNystrom:
    def __init__(self, motion: EquationOfMotion) -> None:
        self._motion = motion

    def advance(
        self, state: Array, step: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        number = self._motion.rotors
        longest_drift = abs(step) * float(np.abs(DRIFTS).max())
        states, largest = [state.copy()], 0.0
        for index in range(1, count + 1):
            before = states[-1]
            if not longest_drift * np.abs(before[number : 2 * number]).max() <= LARGEST_TURN:
                break
            after = self.after(before, step)
            if checks and index in checks.measured:
                halves = self.after(self.after(before, step / 2), step / 2)
                sizes = np.maximum(np.abs(before), np.abs(halves))
                differences = (after - halves) / (checks.absolute + checks.relative * sizes)
                error = math.sqrt(float(np.mean(differences**2)))
                largest = max(largest, error)
                if not error <= 1:
                    return np.array(states), error
            states.append(after)
        return np.array(states), largest

    def after(self, state: Array, step: float) -> Array:
        motion, number = self._motion, self._motion.rotors
        after = state.copy()
        angles, rates, dissipated = after[:number], after[number : 2 * number], after[-1:]
        for stage, drift in enumerate(DRIFTS):
            if stage:
                before, kick = rates.copy(), step * KICKS[stage - 1]
                rates += kick * motion.accelerations(angles)
                if motion.damped:
                    impulses = kick * motor_torques(motion.chain, angles)
                    dissipated -= impulses @ (before + rates) / 2
            time, gamma = step * drift, motion.decay_rates
            factors = np.exp(-gamma * time)
            safe = np.where(gamma == 0, 1.0, gamma)
            angles += np.where(gamma == 0, time, -np.expm1(-gamma * time) / safe) * rates
            if motion.damped:
                lost = motion.chain.moments_of_inertia * (1 - factors**2) * rates**2 / 2
                dissipated += lost.sum()
                rates *= factors
        return after

    def interpolated(self, states: Array, step: float, places: Array) -> Array:
        found = np.clip(np.floor(places), 0, len(states) - 2).astype(int)
        values = np.empty((len(places), states.shape[1]))
        for number in np.unique(found):
            here = found == number
            ends = states[number], states[number + 1]
            values[here] = self._within(*ends, step / 2, 2 * (places[here] - number) - 1)
        return values

    def _within(self, start: Array, end: Array, half: float, places: Array) -> Array:
        """States at places from -1 to 1 in a step."""
        number = self._motion.rotors
        knots = start, self.after(start, half), end
        data = np.array([self._with_derivatives(knot, half) for knot in knots]).reshape(9, -1)
        origin = data[3].copy()
        data[[0, 3, 6]] -= origin
        coefficients = POLYNOMIALS @ data
        powers = places[:, np.newaxis] ** np.arange(9)
        values = origin + powers @ coefficients
        slopes = np.arange(1, 9)[:, np.newaxis] * coefficients[1:, :number]
        rates = powers[:, :-1] @ slopes / half
        return np.concatenate([values[:, :number], rates, values[:, number:]], axis=1)

    def _with_derivatives(self, state: Array, unit: float) -> Array:
        """Angles, and dissipated energy, and their derivatives in a unit of time, (3, ...)."""
        number, motion = self._motion.rotors, self._motion
        slope = motion(0.0, state)
        rates, accelerations = slope[:number], slope[number : 2 * number]
        motors = motor_torques(motion.chain, state[:number])
        heating = 2 * motion.chain.dampings * rates @ accelerations - motors @ accelerations
        heating -= motor_torque_rates(motion.chain, rates) @ rates
        values = np.concatenate([state[:number], state[2 * number :]])
        first = np.concatenate([rates, slope[2 * number :]])
        second = np.concatenate([accelerations, [heating] * motion.damped])
        return np.array([values, unit * first, unit**2 * second])


def polynomials() -> Array:
    """Coefficients of 1 to x^8 from value, slope and curvature at -1, 0 and 1, shape (9, 9)."""
    rows = []
    for place in (-1.0, 0.0, 1.0):
        for derivative in range(3):
            factors = [math.perm(power, derivative) for power in range(9)]
            powers = [place ** max(0, power - derivative) for power in range(9)]
            rows.append(np.multiply(factors, powers))
    return np.linalg.inv(np.array(rows))


POLYNOMIALS = polynomials()
