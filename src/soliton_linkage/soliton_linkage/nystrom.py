# SPDX-License-Identifier: Apache-2.0
"""A fast solver for chains of springs, beside those of scipy.

    motion = ChainMotion(chain)
    solve_ivp(motion, (0, 100), motion.state(angles, rates), method=SymplecticNystrom)

It takes the steps of `nystrom_steps`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DenseOutput, OdeSolver

from soliton_linkage.chain import Array
from soliton_linkage.chain_motion import ChainMotion
from soliton_linkage.nystrom_steps import DRIFTS, KICKS, ORDER, STABLE_STEP, Steps, steps_of

_STEPS_BETWEEN_CHECKS = 32
_ROTORS_TOGETHER = 4000
_FEWEST_TOGETHER = 8
_SAFETY = 0.8
_AIM = 0.3
_WORTH_GROWING = 1.25
_TRIALS = 60
_LARGEST_TURN = 0.5


class SymplecticNystrom(OdeSolver):
    """Symplectic Runge-Kutta-Nystrom method of order 6 for `ChainMotion`.

    The step is chosen so that its error, in the norm of scipy's solvers, is below atol + rtol
    abs(y), and then kept: a step of constant length has a bounded error of the energy, which is
    lost with every change. Every 32 steps the error is measured, against two of half the length,
    and the step is changed where it has become too large or several times too small. It is never
    longer than what keeps the fastest vibration bounded.

    One step of this solver is as many of the method as make it worth a call, or `together`.
    Dense output interpolates in each of these with angles, rates and accelerations at its ends
    and its middle, degree 8 in the angles. `compiled` chooses between loops compiled by numba
    and numpy; None takes numpy, with a RuntimeWarning, where numba is absent.

    Raises TypeError for a right-hand side that is no `ChainMotion` and ValueError for a state
    or options that do not fit.
    """

    def __init__(
        self,
        fun: ChainMotion,
        t0: float,
        y0: ArrayLike,
        t_bound: float,
        vectorized: bool = False,
        rtol: float = 1e-3,
        atol: ArrayLike = 1e-6,
        first_step: float | None = None,
        max_step: float = math.inf,
        together: int | None = None,
        compiled: bool | None = None,
    ) -> None:
        if not isinstance(fun, ChainMotion):
            raise TypeError(
                f'SymplecticNystrom integrates a ChainMotion, not {fun!r}; take DOP853 for others'
            )
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self._motion = fun
        self._check_state()
        self._rtol, self._atol = _checked_tolerances(rtol, atol, self.n)
        self.max_step = _checked_positive('max_step', max_step)
        if first_step is not None:
            _checked_positive('first_step', first_step)
        if together is not None and together < 1:
            raise ValueError(f'together = {together} must be a number of steps, 1 or more')
        crowd = max(_FEWEST_TOGETHER, _ROTORS_TOGETHER // fun.rotors)
        self._together = min(together or crowd, _STEPS_BETWEEN_CHECKS)
        self._steps = steps_of(fun, compiled)
        self._step = min(first_step or 1 / fun.fastest_rate, self._longest(self.y))
        self._chosen = first_step is not None
        self._unchecked = _STEPS_BETWEEN_CHECKS if first_step is None else 0
        self._even_from, self._even_steps = float(t0), 0
        self._states = self.y[np.newaxis]

    def _step_impl(self) -> tuple[bool, str | None]:
        self._shorten_to(self._longest(self.y))
        if self._unchecked >= _STEPS_BETWEEN_CHECKS and not self._adapt():
            return False, 'no step is short enough for the tolerances'
        remaining = abs(self.t_bound - self.t)
        count, last = self._together, False
        if remaining <= count * self._step * (1 + 1e-9):
            count, last = max(1, math.ceil(remaining / self._step * (1 - 1e-9))), True
        step = self.direction * (remaining / count if last else self._step)
        states = self._advance(self.y, step, count)
        done = len(states) - 1
        if not (done and np.isfinite(states[-1]).all()):
            return False, 'the motion has become too fast for any step'
        self._even_steps += done
        self._unchecked += done
        self._states, self.y = states, states[-1].copy()
        self.t = self._even_from + self._even_steps * self.direction * self._step
        if last:
            self.t = self.t_bound if done == count else self.t_old_after(step, done)
            self._start_even_steps()
        return True, None

    def t_old_after(self, step: float, done: int) -> float:
        """Time after some of the last, shortened steps [s]."""
        start = self._even_from + (self._even_steps - done) * self.direction * self._step
        return start + done * step

    def _dense_output_impl(self) -> DenseOutput:
        return _NystromOutput(self.t_old, self.t, self._states, self._motion, self._steps)

    def _advance(self, state: Array, step: float, count: int) -> Array:
        states = self._steps.advance(state, step, count)
        self.nfev += len(KICKS) * (len(states) - 1)
        return states

    def _adapt(self) -> bool:
        """Choose the length of the step from its error; return whether there is one."""
        self._unchecked = 0
        for _ in range(_TRIALS):
            error = self._error(self._step)
            if not math.isfinite(error):
                self._shorten_to(self._step / 4)
                continue
            factor = min(4.0, (_AIM / error) ** (1 / (ORDER + 1))) if error else 4.0
            if error > 1:
                self._shorten_to(self._step * max(0.2, min(factor, 0.9)))
                continue
            longer = min(self._step * factor, self._longest(self.y))
            if longer < _WORTH_GROWING * self._step:
                return True
            self._step = longer
            self._start_even_steps()
        return False

    def _error(self, step: float) -> float:
        """Error of a step in units of what is tolerated, by two of half the length."""
        signed = self.direction * step
        whole = self._advance(self.y, signed, 1)
        halves = self._advance(self.y, signed / 2, 2)
        if len(whole) < 2 or len(halves) < 3:
            return math.inf
        sizes = np.maximum(np.abs(self.y), np.abs(halves[-1]))
        difference = (whole[-1] - halves[-1]) / (self._atol + self._rtol * sizes)
        return math.sqrt(float(np.mean(difference**2)))

    def _longest(self, state: Array) -> float:
        """Longest step that is stable and turns no rotor too far in a drift [s]."""
        number = self._motion.rotors
        fastest = float(np.abs(state[number : 2 * number]).max())
        turning = float(np.abs(DRIFTS).max()) * fastest / _LARGEST_TURN
        limit = max(turning, self._motion.fastest_rate / STABLE_STEP)
        return min(self.max_step, _SAFETY / limit)

    def _shorten_to(self, step: float) -> None:
        if step < self._step:
            self._step = step
            self._start_even_steps()

    def _start_even_steps(self) -> None:
        self._even_from, self._even_steps = float(self.t), 0

    def _check_state(self) -> None:
        expected = 2 * self._motion.rotors + self._motion.damped
        if self.n != expected:
            raise ValueError(
                f'a state of {self.n} numbers does not fit the motion of {self._motion.rotors} '
                f'rotors, which has {expected}; take ChainMotion.state'
            )


class _NystromOutput(DenseOutput):
    """Polynomials of degree 8 through ends and middle of each step of the method."""

    def __init__(
        self, t_old: float, t: float, states: Array, motion: ChainMotion, steps: Steps
    ) -> None:
        super().__init__(t_old, t)
        self._states, self._motion, self._steps = states, motion, steps
        self._step = (t - t_old) / (len(states) - 1)

    def _call_impl(self, t: Any) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        places = (times - self.t_old) / self._step
        found = np.clip(np.floor(places), 0, len(self._states) - 2).astype(int)
        values = np.empty((self._states.shape[1], len(times)))
        for step in np.unique(found):
            here = found == step
            values[:, here] = self._within(int(step), 2 * (places[here] - step) - 1)
        return values if np.ndim(t) else values[:, 0]

    def _within(self, step: int, places: Array) -> Array:
        """States at places from -1 to 1 in a step, shape (len(state), len(places))."""
        number, half = self._motion.rotors, self._step / 2
        middle = self._steps.advance(self._states[step], half, 1)[-1]
        knots = self._states[step], middle, self._states[step + 1]
        data = np.array([self._with_derivatives(knot, half) for knot in knots]).reshape(9, -1)
        data[6] -= data[0]
        data[3] -= data[0]
        origin = data[0].copy()
        data[0] = 0.0
        coefficients = _POLYNOMIALS @ data
        powers = places ** np.arange(9)[:, np.newaxis]
        values = origin[:, np.newaxis] + coefficients.T @ powers
        slopes = np.arange(1, 9)[:, np.newaxis] * coefficients[1:, :number]
        rates = slopes.T @ powers[:-1] / half
        return np.concatenate([values[:number], rates, values[number:]])

    def _with_derivatives(self, state: Array, unit: float) -> Array:
        """Angles, and dissipated energy, and their derivatives in a unit of time, (3, ...)."""
        number, motion = self._motion.rotors, self._motion
        slope = motion(0.0, state)
        rates, accelerations = slope[:number], slope[number : 2 * number]
        heating = 2 * motion.chain.dampings * rates @ accelerations
        values = np.concatenate([state[:number], state[2 * number :]])
        first = np.concatenate([rates, slope[2 * number :]])
        second = np.concatenate([accelerations, [heating] * motion.damped])
        return np.array([values, unit * first, unit**2 * second])


def _polynomials() -> Array:
    """Coefficients of 1 to x^8 from value, slope and curvature at -1, 0 and 1, shape (9, 9)."""
    rows = []
    for place in (-1.0, 0.0, 1.0):
        for derivative in range(3):
            factors = [math.perm(power, derivative) for power in range(9)]
            powers = [place ** max(0, power - derivative) for power in range(9)]
            rows.append(np.multiply(factors, powers))
    # The exact ones are multiples of 1/16.
    return np.asarray(np.round(16 * np.linalg.inv(np.array(rows))) / 16)


_POLYNOMIALS = _polynomials()


def _checked_tolerances(rtol: float, atol: ArrayLike, size: int) -> tuple[float, Array]:
    absolute = np.asarray(atol, dtype=np.float64)
    if absolute.ndim and absolute.shape != (size,):
        raise ValueError(f'atol of shape {absolute.shape} must be a number or of shape ({size},)')
    if not (rtol >= 0 and (absolute >= 0).all()):
        raise ValueError(f'rtol = {rtol} and atol = {atol} must be 0 or more')
    if rtol == 0 and not (absolute > 0).all():
        raise ValueError(f'rtol = {rtol} and atol = {atol} must not both be 0')
    return rtol, absolute


def _checked_positive(name: str, value: float) -> float:
    if not value > 0:
        raise ValueError(f'{name} = {value} s must be above 0')
    return value
