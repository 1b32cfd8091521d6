# SPDX-License-Identifier: Apache-2.0
"""A fast solver for chains of springs, beside those of scipy.

    motion = EquationOfMotion(chain)
    solve_ivp(motion, (0, 100), motion.state(angles, rates), method=SymplecticNystrom)

It takes the steps of `nystrom_steps`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DenseOutput, OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_steps import (
    DEFAULTS,
    DRIFTS,
    KICKS,
    ORDER,
    STABLE_STEP,
    NystromSteps,
    SolverSettings,
    steps_to_measure,
)
from soliton_linkage.dynamics.integrators.rotor_loops import LARGEST_TURN, Checks
from soliton_linkage.linkage.chain import Array, Chain

LONGEST_DRIFT = float(np.abs(DRIFTS).max())
"""Of those of a step, over its length."""


class SymplecticNystrom(OdeSolver):
    """Symplectic Runge-Kutta-Nystrom method of order 6 for `EquationOfMotion`.

    The step is chosen so that its error, in the norm of scipy's solvers, is below atol + rtol
    abs(y), and then kept: a step of constant length has a bounded error of the energy, which is
    lost with every change. The error is measured in the first, fourth, sixteenth and every 32nd
    step of a length, against two of half the length. Where it has become too large, the steps
    since it was last measured are taken back and the step is shortened; where it is several times
    too small, the step is made longer, but never so long that the fastest vibration could grow.

    Dense output interpolates in each of these with angles, rates and accelerations at its ends
    and its middle, degree 8 in the angles.

    `length` is that of a step of the method [s], and `together` the largest number of them that
    make one step of the solver. Raises TypeError for a right-hand side that is no
    `EquationOfMotion` and ValueError for a motion with `forces`, a state or options that do not
    fit.
    """

    _tried = 4
    """Steps of the first length after which it is no longer on trial; the fourth is measured."""

    n: int
    t: float
    t_bound: float
    t_old: float
    y: Array
    direction: float

    def __init__(
        self,
        fun: EquationOfMotion,
        t0: float,
        y0: ArrayLike,
        t_bound: float,
        *,
        vectorized: bool = False,
        rtol: float = 1e-3,
        atol: ArrayLike = 1e-6,
        first_step: float | None = None,
        max_step: float = math.inf,
        together: int | None = None,
        settings: SolverSettings = DEFAULTS,
    ) -> None:
        """Begin at a state y0 of a motion; times and steps in [s], `atol` shape () or (len(y0),).

        As in scipy's solvers the error of a step is below atol + rtol abs(y), root mean square.
        """
        if not isinstance(fun, EquationOfMotion):
            raise TypeError(
                f'{type(self).__name__} integrates an EquationOfMotion, not {fun!r}; '
                'take DOP853 for others'
            )
        self.check(fun)
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self._motion = fun
        self._settings = settings
        self._check_state()
        self._relative, self._absolute = _checked_tolerances(rtol, atol, self.n)
        self._max_step = float(_checked_positive('max_step', max_step))
        if first_step is not None:
            _checked_positive('first_step', first_step)
        if together is not None and together < 1:
            raise ValueError(f'together = {together} must be a number of steps, 1 or more')
        self.together = together or max(1, settings.rotors_together // fun.rotors)
        self._steps = NystromSteps(fun, settings)
        self._trying = True
        self._since_change = 0
        self._even_from, self._even_steps = float(self.t), 0
        self._states = self.y[np.newaxis]
        self._longest = self._longest_from(self.y)
        self.length: float = min(first_step or self._longest, self._longest)

    @staticmethod
    def check(motion: EquationOfMotion) -> None:
        """Raise ValueError for a motion with terms that the steps do not have."""
        if motion.forces:
            raise ValueError(
                f"integrator 'symplectic' does not integrate forces = {motion.forces}; choose "
                "'DOP853'"
            )

    @classmethod
    def load(cls) -> None:
        """Compile the loops, or load what was compiled, so that no step has to wait for that.

        It takes two steps of a chain of two rotors.
        """
        motion = EquationOfMotion(Chain(number_of_rotors=2))
        few_rows = SolverSettings(rotors_together=1)
        solver = cls(motion, 0.0, np.zeros(4), math.inf, settings=few_rows)
        for _ in range(2):
            solver.step()
            solver.dense_output()(solver.t)

    def _step_impl(self) -> tuple[bool, str | None]:
        for _ in range(self._settings.trials):
            self._change_to(min(self.length, self._longest))
            if not self.length >= self._settings.shortest * self._longest:
                break
            if self._advance():
                return True, None
        return False, 'no step is short enough for the tolerances'

    def _fastest(self, state: Array) -> float:
        """Largest angular velocity of a rotor [rad/s]."""
        number = self._motion.rotors
        return float(np.abs(state[number : 2 * number]).max())

    def _check_state(self) -> None:
        expected = 2 * self._motion.rotors + self._motion.damped
        if self.n != expected:
            raise ValueError(
                f'a state of {self.n} numbers does not fit the motion of {self._motion.rotors} '
                f'rotors, which has {expected}; take EquationOfMotion.state'
            )

    def _advance(self) -> bool:
        """Take steps of the method together; return whether any was good."""
        remaining = abs(self.t_bound - self.t)
        count, last = self.together, False
        if self._trying:
            count = min(count, self._tried)
        if remaining <= count * self.length * (1 + 1e-9):
            count, last = max(1, math.ceil(remaining / self.length * (1 - 1e-9))), True
            self._start_evenly()
        step = self.direction * (remaining / count if last else self.length)
        states, error = self._checked(step, count)
        done = len(states) - 1
        if done:
            self._states, self.y = states, states[-1].copy()
            self._longest = self._longest_from(self.y)
            self._even_steps += done
            self._since_change += done
            evenly = self._even_from + self._even_steps * step
            self.t = self.t_bound if last and done == count else evenly
        if error != 0:
            self._adapt(error)
        self._trying = self._trying and self._since_change < self._tried
        return done > 0

    def _dense_output_impl(self) -> DenseOutput:
        return NystromOutput(self.t_old, self.t, self._states, self._steps)

    def _checked(self, step: float, count: int) -> tuple[Array, float]:
        """States and largest error of steps, up to the last good one that was measured."""
        every = self._settings.measured_every
        measured = steps_to_measure(self._since_change, count, every)
        checks = Checks(self._absolute, self._relative, measured)
        states, error = self._steps.advance(self.y, step, count, checks)
        good = error <= 1
        taken = min(count, len(states) - good)
        measured = measured[measured <= taken]
        self.nfev += len(KICKS) * (taken + 2 * len(measured))
        return states if good else states[: 1 + sum(measured[-2:-1])], error

    def _adapt(self, error: float) -> None:
        """Change the length of steps where an error that was measured asks for it."""
        better = self._better(error)
        worth = better < self._settings.worth_shrinking * self.length and self._trying
        if not error <= 1 or worth or better > self._settings.worth_growing * self.length:
            self._change_to(better)

    def _better(self, error: float) -> float:
        """Length of step that an error asks for [s]."""
        if not math.isfinite(error):
            return self.length / 4
        factor = min(4.0, (self._settings.aim / error) ** (1 / (ORDER + 1))) if error else 4.0
        if error > 1:
            factor = max(0.2, min(factor, 0.9))
        return min(self.length * factor, self._longest)

    def _change_to(self, step: float) -> None:
        if step != self.length:
            self.length = step
            self._since_change = 0
            self._start_evenly()

    def _start_evenly(self) -> None:
        self._even_from, self._even_steps = float(self.t), 0

    def _longest_from(self, state: Array) -> float:
        """Longest step that is stable and turns no rotor too far in a drift [s]."""
        turning = LONGEST_DRIFT * self._fastest(state) / (self._settings.safety * LARGEST_TURN)
        limit = max(turning, self._motion.fastest_rate / STABLE_STEP)
        return min(self._max_step, 1 / limit)


class NystromOutput(DenseOutput):
    """Interpolation between the states of steps of one length."""

    def __init__(self, t_old: float, t: float, states: Array, steps: NystromSteps) -> None:
        super().__init__(t_old, t)
        self._states, self._steps = states, steps
        self.length = (t - t_old) / (len(states) - 1)

    def _call_impl(self, t: Any) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        places = (times - self.t_old) / self.length
        values = self._steps.interpolated(self._states, self.length, places).T
        return values if np.ndim(t) else values[:, 0]


def _checked_tolerances(rtol: float, atol: ArrayLike, size: int) -> tuple[float, Array]:
    absolute = np.asarray(atol, dtype=np.float64)
    if absolute.ndim and absolute.shape != (size,):
        raise ValueError(f'atol of shape {absolute.shape} must be a number or of shape ({size},)')
    if not (rtol >= 0 and (absolute >= 0).all()):
        raise ValueError(f'rtol = {rtol} and atol = {absolute} must be 0 or more')
    if rtol == 0 and not (absolute > 0).all():
        raise ValueError(f'rtol = {rtol} and atol = {absolute} must not both be 0')
    # Loops would be compiled anew for a whole number.
    return float(rtol), np.full(size, absolute) if absolute.ndim == 0 else absolute


def _checked_positive(name: str, value: float) -> float:
    if not value > 0:
        raise ValueError(f'{name} = {value} s must be above 0')
    return value
