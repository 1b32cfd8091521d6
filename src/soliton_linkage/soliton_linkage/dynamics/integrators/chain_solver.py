# SPDX-License-Identifier: Apache-2.0
"""What solvers made for chains of springs have in common."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Array, Chain


@dataclass(frozen=True)
class SolverSettings:
    """Tuning of `SymplecticNystrom` and `SymmetricMultistep`."""

    rotors_together: int = 16_000
    """Rotors times steps in one call of the loops; half or twice as many: time within 10 %."""
    safety: float = 0.8
    """Of the turn at which loops stop the fastest rotor makes this share in the longest step.

    Half of it: 60 % more forces where a rotor spins fast, else no difference. Where it is 1
    a rotor that is sped up stops them for good.
    """
    aim: float = 0.3
    """Error, over that tolerated, that a new length of step is chosen for.

    Half or twice of it: forces -10 to +10 %, errors from half to twice as large.
    """
    aim_anew: float = 0.02
    """The same where a multistep method begins anew because its error was too large.

    Half of it: forces up to +6 %, errors half as large; twice: forces -5 %, errors twice as large.
    """
    worth_growing: float = 1.25
    """How much longer a step must be for a change; 1.13 and 1.5: forces within 6 %."""
    worth_shrinking: float = 0.95
    """How much shorter one must be while the first is on trial; 0.9 and 0.975: no difference."""
    worth_beginning: int = 400
    """Steps left from which a multistep method begins anew with longer ones.

    Half or twice as many: no difference in long runs; to begin costs as much as 150 steps.
    """
    measured_every: int = 32
    """Of how many steps one has its error measured; 16: forces +6 %, 64: forces -3 %."""
    steps_until_exact: int = 1000
    """Steps after which cosines and sines, off by a rounding more each time, are taken anew.

    Half or twice as many: no difference but of rounding.
    """
    shortest: float = 1e-6
    """Step, over the longest that is stable, at which a solver gives up, later or earlier."""
    trials: int = 60
    """Of lengths for one step, after which it gives up; it takes one to three but to give up."""


DEFAULTS = SolverSettings()


class ChainSolver(OdeSolver):
    """Solver of scipy that takes many steps of constant length in one.

    `length` is that of a step of the method [s], and `together` how many of them make one step of
    the solver at most.

    Raises TypeError for a right-hand side that is no `EquationOfMotion` and ValueError for a state
    or options that do not fit.
    """

    fewest_together = 1
    """Steps of the method below which one call of the loops is not worth while."""
    takes_damping = True
    """Whether it integrates chains with damping."""

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
        self.together = together or self._together_by_default()
        self._prepare()
        self._longest = self._longest_from(self.y)
        self.length: float = min(first_step or self._longest, self._longest)

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

    @abstractmethod
    def _prepare(self) -> None:
        """Make ready to take steps."""

    @abstractmethod
    def _longest_from(self, state: Array) -> float:
        """Longest step of the method that is allowed from a state [s]."""

    @abstractmethod
    def _change_to(self, length: float) -> None:
        """Take steps of a length [s] from now on."""

    @abstractmethod
    def _advance(self) -> bool:
        """Take steps of the method together; return whether any was good."""

    def _together_by_default(self) -> int:
        """How many steps together make them worth a call."""
        return max(self.fewest_together, self._settings.rotors_together // self._motion.rotors)

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
