# SPDX-License-Identifier: Apache-2.0
"""Fast solver for chains of springs, with the interface of scipy's solvers.

    solve_ivp(motion, (0, 100), motion.state(angles, rates), method=SymplecticNystrom)

integrates `motion`, which is an `EquationOfMotion`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DenseOutput, OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import LARGEST_TURN, Checks
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
from soliton_linkage.linkage.chain import Array, Chain

_LONGEST_DRIFT = float(np.abs(DRIFTS).max())
"""Duration of the longest drift, as a fraction of the step [1]."""


class SymplecticNystrom(OdeSolver):
    """Symplectic Runge-Kutta-Nystrom method of order 6 for `EquationOfMotion`.

    The solver chooses a step length for which the error of a step, in the norm of scipy's solvers,
    is below atol + rtol abs(y). The solver keeps this length as long as possible, because the
    energy error is bounded only while the length is constant. The error is the difference between
    a step and two half steps. Steps whose error is too large are repeated with a shorter length.
    If the error is far below the tolerance, the length increases.

    `length` is the length of a method step [s], and `together` the largest number of method steps
    in one solver step (a call of `step`). Raises TypeError if `fun` is not an `EquationOfMotion`,
    and ValueError if its `forces` contain Python functions, if `y0` has another size, or if an
    option is out of range.
    """

    _tried = 4
    """Number of steps after which the first step length is accepted [1]. The error of the last of
    these steps is measured."""

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
        if not isinstance(fun, EquationOfMotion):
            raise TypeError(
                f'{type(self).__name__} integrates an EquationOfMotion, not {fun!r}; '
                'choose DOP853 for other functions'
            )
        self.check(fun)
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self._motion = fun
        self._settings = settings
        self._check_state()
        self._relative, self._absolute = _checked_tolerances(rtol, atol, self.n)
        for name, step in (('max_step', max_step), ('first_step', first_step)):
            if step is not None and not step > 0:
                raise ValueError(f'{name} = {step} s must be above 0')
        self._max_step = float(max_step)
        if together is not None and together < 1:
            raise ValueError(f'together = {together} must be a number of steps, 1 or more')
        self.together = together or max(1, settings.rotors_per_call // fun.rotors)
        self._steps = NystromSteps(fun, settings)
        self._trying = True
        self._since_change = 0
        self._even_from, self._even_steps = float(self.t), 0
        self._states = self.y[np.newaxis]
        energy = settings.violent * fun.chain.stiffness * fun.chain.rest_length**2 / 2
        self._violent = math.sqrt(2 * energy / fun.inertias.min())
        self._update_limits()
        self.length: float = min(first_step or self._longest, self._longest)

    @staticmethod
    def check(motion: EquationOfMotion) -> None:
        """Raise ValueError for a motion with terms that are not compiled."""
        if motion.plain_terms:
            raise ValueError(
                f"integrator 'symplectic' does not integrate Python functions in forces = "
                f"{motion.forces}; choose 'DOP853', or write a CompiledTerm"
            )

    @classmethod
    def load(cls) -> None:
        """Compile or load all loops by taking two steps; later simulations start at once."""
        motion = EquationOfMotion(Chain(number_of_rotors=2))
        few_rows = SolverSettings(rotors_per_call=1)
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
        return False, 'no step length satisfies the tolerances'

    def _check_state(self) -> None:
        expected = 2 * self._motion.rotors + self._motion.damped
        if self.n != expected:
            raise ValueError(
                f'a state of {self.n} numbers does not fit the motion of {self._motion.rotors} '
                f'rotors, which needs {expected}; call EquationOfMotion.state'
            )

    def _advance(self) -> bool:
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
            self._update_limits()
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
        """Take up to `count` method steps; return the accepted states and the largest error.

        If a measured error exceeds 1, only the steps up to the previous measurement are accepted.
        """
        every = 1 if self._fastest > self._violent else self._settings.measured_every
        measured = steps_to_measure(self._since_change, count, every)
        checks = Checks(self._absolute, self._relative, measured)
        states, error = self._steps.advance(self.y, step, count, checks)
        good = error <= 1
        taken = min(count, len(states) - good)
        measured = measured[measured <= taken]
        self.nfev += len(KICKS) * (taken + 2 * len(measured))
        return states if good else states[: 1 + sum(measured[-2:-1])], error

    def _adapt(self, error: float) -> None:
        better = self._better(error)
        shorter = better < self._settings.max_shrinkage * self.length and self._trying
        if not error <= 1 or shorter or better > self._settings.min_growth * self.length:
            self._change_to(better)

    def _better(self, error: float) -> float:
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

    def _update_limits(self) -> None:
        """Set the rate of the fastest rotor [rad/s] and the longest allowed step [s].

        The longest step is stable, and in it no drift exceeds LARGEST_TURN.
        """
        rotors = self._motion.rotors
        self._fastest = float(np.abs(self.y[rotors : 2 * rotors]).max())
        turning = _LONGEST_DRIFT * self._fastest / (self._settings.safety * LARGEST_TURN)
        limit = max(turning, self._motion.fastest_rate / STABLE_STEP)
        self._longest = min(self._max_step, 1 / limit)


class NystromOutput(DenseOutput):
    """Interpolation between the states of consecutive method steps of equal length."""

    def __init__(self, t_old: float, t: float, states: Array, steps: NystromSteps) -> None:
        super().__init__(t_old, t)
        self._states, self._steps = states, steps
        self.length = (t - t_old) / (len(states) - 1)

    def _call_impl(self, t: Any) -> Array:
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        steps = (times - self.t_old) / self.length
        values = self._steps.interpolated(self._states, self.length, steps).T
        return values if np.ndim(t) else values[:, 0]


def _checked_tolerances(rtol: float, atol: ArrayLike, size: int) -> tuple[float, Array]:
    absolute = np.asarray(atol, dtype=np.float64)
    if absolute.ndim and absolute.shape != (size,):
        raise ValueError(f'atol of shape {absolute.shape} must be a number or of shape ({size},)')
    if not (rtol >= 0 and (absolute >= 0).all()):
        raise ValueError(f'rtol = {rtol} and atol = {absolute} must be 0 or more')
    if rtol == 0 and not (absolute > 0).all():
        raise ValueError(f'rtol = {rtol} and atol = {absolute} must not both be 0')
    # Return a float, because numba would compile the loops again for an integer.
    return float(rtol), np.full(size, absolute) if absolute.ndim == 0 else absolute
