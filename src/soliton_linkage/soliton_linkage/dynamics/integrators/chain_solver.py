# SPDX-License-Identifier: Apache-2.0
"""What solvers made for chains of springs have in common."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Array

_ROTORS_TOGETHER = 16_000
_SHORTEST = 1e-6
_TRIALS = 60


class ChainSolver(OdeSolver):
    """Solver of scipy that takes many steps of constant length in one.

    `length` is that of a step of the method [s], and `together` how many of them make one step of
    the solver at most. `compiled` chooses between loops compiled by numba and numpy; None takes
    numpy, with a RuntimeWarning, where numba is absent.

    Raises TypeError for a right-hand side that is no `EquationOfMotion` and ValueError for a state
    or options that do not fit.
    """

    fewest_together = 8
    most_together = 1000

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
        compiled: bool | None = None,
    ) -> None:
        if not isinstance(fun, EquationOfMotion):
            raise TypeError(
                f'{type(self).__name__} integrates a EquationOfMotion, not {fun!r}; '
                'take DOP853 for others'
            )
        super().__init__(fun, t0, y0, t_bound, vectorized)
        self._motion = fun
        self._check_state()
        self._relative, self._absolute = _checked_tolerances(rtol, atol, self.n)
        self._max_step = float(_checked_positive('max_step', max_step))
        if first_step is not None:
            _checked_positive('first_step', first_step)
        if together is not None and together < 1:
            raise ValueError(f'together = {together} must be a number of steps, 1 or more')
        self.together = together or self._together_by_default()
        self._prepare(compiled)
        self._longest = self._longest_from(self.y)
        self.length: float = min(first_step or self._longest, self._longest)

    def _prepare(self, compiled: bool | None) -> None:
        """Make ready to take steps."""
        raise NotImplementedError

    def _longest_from(self, state: Array) -> float:
        """Longest step of the method that is allowed from a state [s]."""
        raise NotImplementedError

    def _change_to(self, length: float) -> None:
        """Take steps of a length [s] from now on."""
        raise NotImplementedError

    def _advance(self) -> bool:
        """Take steps of the method together; return whether any was good."""
        raise NotImplementedError

    def _together_by_default(self) -> int:
        """How many steps together make them worth a call."""
        worth = _ROTORS_TOGETHER // self._motion.rotors
        return max(self.fewest_together, min(worth, self.most_together))

    def _step_impl(self) -> tuple[bool, str | None]:
        for _ in range(_TRIALS):
            self._change_to(min(self.length, self._longest))
            if self.length < _SHORTEST * self._longest:
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
    return rtol, np.full(size, absolute) if absolute.ndim == 0 else absolute


def _checked_positive(name: str, value: float) -> float:
    if not value > 0:
        raise ValueError(f'{name} = {value} s must be above 0')
    return value
