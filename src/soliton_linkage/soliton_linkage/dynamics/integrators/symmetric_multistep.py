# SPDX-License-Identifier: Apache-2.0
"""The fastest solver for chains of springs without damping, beside those of scipy.

    motion = EquationOfMotion(chain)
    solve_ivp(motion, (0, 100), motion.state(angles, rates), method=SymmetricMultistep)

It takes the steps of `multistep_steps`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.integrate import DenseOutput

from soliton_linkage.dynamics.integrators.chain_solver import ChainSolver
from soliton_linkage.dynamics.integrators.multistep_coefficients import (
    AHEAD,
    ORDER,
    REMEMBERED,
    STABLE_STEP,
    STARTING_STEPS,
)
from soliton_linkage.dynamics.integrators.multistep_steps import MultistepSteps, Recorded
from soliton_linkage.dynamics.integrators.nystrom_coefficients import KICKS
from soliton_linkage.dynamics.integrators.nystrom_coefficients import (
    ORDER as ORDER_OF_STARTING_STEPS,
)
from soliton_linkage.dynamics.integrators.rotor_loops import LARGEST_TURN
from soliton_linkage.dynamics.integrators.symplectic_nystrom import NystromOutput
from soliton_linkage.linkage.chain import Array


class SymmetricMultistep(ChainSolver):
    """Symmetric multistep method of order 10, one force a step, for undamped `EquationOfMotion`.

    The step is chosen so that its error, in the norm of scipy's solvers, is below atol + rtol
    abs(y), and then kept, because every change costs nine steps of another method. The error is
    measured in the first, fourth, sixteenth and every 32nd step of a length, from differences of
    the accelerations, which also show where the method begins to vibrate by itself. Where it has
    become too large the steps since it was last measured are taken back, and the solver begins
    anew with shorter ones; where it is several times too small, with longer ones.

    Dense output has as accelerations the polynomials of degree 9 through those of ten steps.
    Options and errors are those of `ChainSolver`; a motion with damping is refused by ValueError.
    """

    fewest_together = 64 - REMEMBERED - 2 * AHEAD
    """With what is around them they fill rings of 64 instants."""
    takes_damping = False

    def _prepare(self) -> None:
        self._capacity = max(self.together, self._together_by_default())
        self._steps = MultistepSteps(self._motion, self._capacity, self._settings)
        self._begun = False
        self._since_begin = 0
        self._left = math.inf
        self._even_from = self.t
        self._output: tuple[Array, int] = self.y[np.newaxis], 0

    def _longest_from(self, state: Array) -> float:
        """Longest step that is stable and turns no rotor too far [s]."""
        turning = self._fastest(state) / (self._settings.safety * LARGEST_TURN)
        limit = max(turning, self._motion.fastest_rate / STABLE_STEP)
        return min(self._max_step, 1 / limit)

    def _change_to(self, length: float) -> None:
        if length != self.length:
            self.length = length
            self._begun = False

    def _advance(self) -> bool:
        """Take steps together, or those before the first one; return whether any was good."""
        return self._continue() if self._begun else self._begin()

    def _begin(self) -> bool:
        """Take the steps before the first one, of a length of which a number fits what is left."""
        remaining = abs(self.t_bound - self.t)
        self._longest = self._longest_from(self.y)
        length, count = min(self.length, self._longest), math.inf
        if remaining < math.inf:
            count = max(STARTING_STEPS, math.ceil(remaining / length * (1 - 1e-9)))
            length = remaining / count
        self.length = length
        step, tolerances = self.direction * length, (self._absolute, self._relative)
        states, error = self._steps.begin(self.y, step, *tolerances)
        if not error <= 1 or len(states) <= STARTING_STEPS:
            aim = (
                (self._settings.aim / error) ** (1 / (ORDER_OF_STARTING_STEPS + 1))
                if error > 1
                else 0.5
            )
            self.length *= max(0.2, min(aim, 0.9))
            return False
        self.nfev += (STARTING_STEPS + 2) * len(KICKS) + STARTING_STEPS + 1
        self._begun, self._since_begin, self._even_from = True, -STARTING_STEPS, self.t
        self._left = count
        self._output = states, 0
        self._arrive(states[-1].copy(), STARTING_STEPS)
        return True

    def _continue(self) -> bool:
        """Take steps of the method, and find out whether to begin anew, with what length."""
        count = min(self.together, self._capacity, self._left)
        before = self.y
        state, done, error = self._steps.advance(int(count), self._absolute, self._relative)
        self.nfev += done
        if done:
            self._output = before, done
            self._arrive(state, done)
        self._begun = done == count and not self._may_grow(error)
        if not error <= 1 or not self._begun:
            self.length = self._better(error)
        return done > 0

    def _may_grow(self, error: float) -> bool:
        """Whether much longer steps would do, for long enough to be worth beginning anew."""
        worth = (
            self._left > self._settings.worth_beginning
            and self.length < self._longest / self._settings.worth_growing
        )
        return (
            worth
            and error > 0
            and self._better(error) > self._settings.worth_growing * self.length
        )

    def _arrive(self, state: Array, done: int) -> None:
        self._since_begin += done
        self._left -= done
        taken = (STARTING_STEPS + self._since_begin) * self.direction * self.length
        self.y, self.t = state, self._even_from + taken if self._left else self.t_bound

    def _better(self, error: float) -> float:
        """Length of step that an error asks for [s]."""
        if not math.isfinite(error):
            return self.length / 4
        if error == 0:
            return self.length
        aim = self._settings.aim if error <= 1 else self._settings.aim_anew
        factor = max(0.2, min(float((aim / error) ** (1 / (ORDER + 1))), 4.0))
        return min(self.length * factor, self._longest)

    def _dense_output_impl(self) -> DenseOutput:
        values, steps = self._output
        if not steps:
            return NystromOutput(self.t_old, self.t, values, self._steps.starting)
        return _MultistepOutput(self.t_old, self.t, self._steps.recorded(values, steps), steps)


class _MultistepOutput(DenseOutput):
    def __init__(self, t_old: float, t: float, recorded: Recorded, steps: int) -> None:
        super().__init__(t_old, t)
        self._recorded, self._length = recorded, (t - t_old) / steps

    def _call_impl(self, t: Any) -> Array:
        places = (np.atleast_1d(np.asarray(t, dtype=np.float64)) - self.t_old) / self._length
        values = self._recorded.interpolated(places).T
        return values if np.ndim(t) else values[:, 0]
