# SPDX-License-Identifier: Apache-2.0
"""Fast solver for chains of springs, with the interface of scipy's solvers.

    solve_ivp(motion, (0, 100), motion.state(angles, rates), method=SymplecticNystrom)

integrates `motion`, which is an `EquationOfMotion`. A step of length h is a symmetric sequence of
drifts and kicks,

    drift(a_15 h) kick(b_14 h) drift(a_14 h) ... kick(b_1 h) drift(a_1 h).

A kick changes the rates by the torques that depend on the angles. A drift changes the angles, and
applies the torques that depend on the rates. With linear damping c and gamma = c / (M r^2), a
drift of duration t is the exact motion without other torques,

    phi_dot(t) = phi_dot e^(-gamma t),    phi(t) = phi + phi_dot (1 - e^(-gamma t)) / gamma.

With damping of another kind, a drift is a Runge-Kutta step of order 4. Without damping a step is
symplectic and reversible. With linear damping, a step reduces volumes in phase space exactly as
the motion does. In both cases, the sum of energy and dissipated energy has no trend.

The coefficients belong to the method SRKN_14^a of order 6 for systems with a quadratic kinetic
energy. Source: Blanes and Moan, Journal of Computational and Applied Mathematics 142 (2002) 313.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import DenseOutput, OdeSolver

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import (
    LARGEST_TURN,
    WORK_ROWS,
    Checks,
    Fields,
    Numbers,
    advance,
    interpolate,
)
from soliton_linkage.dynamics.terms import (
    ANGLES,
    COSINES,
    RATES,
    SINES,
    VECTOR,
    LinearDamping,
    padded_size,
)
from soliton_linkage.linkage.chain import Array, Chain

ORDER = 6
"""Order of the method: the error of a step of length h is proportional to h^7."""
STABLE_STEP = 3.14
"""Longest step of the solver, multiplied by the angular frequency of the fastest vibration [1]. If
this product is below 3.141, the step is stable: vibrations do not grow. Between 3.141 and 3.1425,
they grow by less than 0.1 % per step. From 3.1425 to 6.15, steps are stable again, but the solver
does not use them. At 6.2, vibrations grow by 11 % per step."""

_HALF_OF_DRIFTS = (
    0.0378593198406116,
    0.102635633102435,
    -0.0258678882665587,
    0.314241403071447,
    -0.130144459517415,
    0.106417700369543,
    -0.00879424312851058,
)
"""Coefficients a_1 to a_7 from the paper."""
_HALF_OF_KICKS = (
    0.09171915262446165,
    0.183983170005006,
    -0.05653436583288827,
    0.004914688774712854,
    0.143761127168358,
    0.328567693746804,
)
"""Coefficients b_1 to b_6 from the paper."""
_LAST_KICK = 0.5 - sum(_HALF_OF_KICKS)
"""Coefficient b_7. The coefficients b_1 to b_7 of half a step add up to 1/2."""

DRIFTS = np.array([*_HALF_OF_DRIFTS, 1 - 2 * sum(_HALF_OF_DRIFTS), *_HALF_OF_DRIFTS[::-1]])
"""Coefficients a_1 to a_15."""
KICKS = np.array([*_HALF_OF_KICKS, _LAST_KICK, _LAST_KICK, *_HALF_OF_KICKS[::-1]])
"""Coefficients b_1 to b_14."""
_LONGEST_DRIFT = float(np.abs(DRIFTS).max())
"""Duration of the longest drift, as a fraction of the step [1]."""


@dataclass(frozen=True)
class SolverSettings:
    """Tuning of `SymplecticNystrom`."""

    rotors_per_call: int = 16_000
    """Largest number of steps in one call of the compiled loops, multiplied by the number of
    rotors [1]. Sensitivity: at 0.5x or 2x, the solver is 10 % slower."""
    safety: float = 0.8
    """Largest allowed rotation of the fastest rotor in the longest drift, as a fraction of
    LARGEST_TURN [1]. Sensitivity: at 0.5x, the solver needs 60 % more force evaluations if a rotor
    spins fast; at 1, the compiled loops stop after a step in which the fastest rotor
    accelerates."""
    aim: float = 0.3
    """A new step length is chosen so that the expected error is this fraction of the tolerance
    [1]. Sensitivity: at 0.5x, the solver needs 10 % more force evaluations and has half the error;
    at 2x, it needs 10 % fewer and has twice the error."""
    min_growth: float = 1.25
    """The step length increases only if the measured error allows a length that is larger by this
    factor [1]. Sensitivity: with 1.13 or 1.5, the number of force evaluations changes by 6 %."""
    max_shrinkage: float = 0.95
    """The first step length is shortened if the measured error suggests a length that is less than
    this fraction of the first length [1]. Sensitivity: no effect from 0.9 to 0.975."""
    measured_every: int = 32
    """Number of steps from one error measurement to the next [1]. Sensitivity: at 0.5x, the solver
    needs 6 % more force evaluations; at 2x, it needs 3 % fewer."""
    violent: float = 0.2
    """The error of each step is measured if the kinetic energy of a rotor exceeds this fraction of
    the energy that compresses a spring to length 0 [1]. The reason is that the torques of a very
    short spring change much within one step. Sensitivity: from 0.01 to 1, the errors of such
    motions do not change; at 0.5x, the solver needs 5 % more force evaluations for a wall that was
    kicked with 30 rad/s."""
    steps_until_exact: int = 1000
    """Number of steps after which cosines and sines are computed from the angles again [1],
    because their rounding errors increase with each step."""
    shortest: float = 1e-6
    """The solver fails if the step is below this fraction of the longest stable step [1]."""
    trials: int = 60
    """Largest number of step lengths that one call of `SymplecticNystrom.step` tries before the
    solver fails [1]; one to three trials are usual."""


DEFAULTS = SolverSettings()


def steps_to_measure(taken: int, count: int, every: int) -> Numbers:
    """Return the indices of the steps, among the next `count`, whose error is measured.

    The step length last changed `taken` steps ago. Counted from this change, the error is measured
    in the steps 1, 4 and 16, and in all multiples of `every`. The returned indices count from now
    on, so that the next step has the index 1.
    """
    regular = np.arange(every - taken % every, count + 1, every)
    early = [step for step in (1, 4, 16) if taken < step <= taken + count]
    return np.union1d(np.array(early, dtype=np.int64) - taken, regular)


class NystromSteps:
    """Runge-Kutta-Nystrom steps of an `EquationOfMotion` whose terms are all compiled."""

    def __init__(self, motion: EquationOfMotion, settings: SolverSettings = DEFAULTS) -> None:
        self._motion = motion
        self._until_exact = settings.steps_until_exact
        damping = [term for term in motion.loads if term.dissipative]
        self._linear = all(isinstance(term, LinearDamping) for term in damping)
        half_inertias = self._padded(motion.chain.moments_of_inertia / 2)
        self._forces = (
            *motion.table([term for term in motion.terms if not term.dissipative]),
            *motion.table(damping),
            self._padded(1 / motion.inertias),
            half_inertias if motion.damped else np.empty(0),
            motion.terms[-1].active,
        )
        if self._linear and motion.damped:
            self._decay_rates = motion.table(damping).parameters.sum(axis=0)[: motion.rotors]
            self._decay_rates /= motion.inertias
        self._prepared = math.nan
        self._work = zeros_in_line(WORK_ROWS, padded_size(motion.rotors) + VECTOR)
        self._between = np.zeros_like(self._work)
        self._since_load = self._until_exact

    def advance(
        self, state: Array, length: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """Take up to `count` steps of `length` [s]; return all states and the largest error.

        The error of a step is the difference between the step and two half steps, scaled as in
        `Checks`. The states have the shape (steps taken + 1, len(state)). They end before a step
        whose error exceeds 1, or in which a drift rotates a rotor by more than LARGEST_TURN. If
        they end because of an error, this error is returned. If no error is measured, the returned
        error is 0.
        """
        rotors = self._motion.rotors
        states = np.empty((count + 1, len(state)))
        states[0] = state
        self._since_load += count
        if (
            self._since_load > self._until_exact
            or (self._work[ANGLES, :rotors] != states[0, :rotors]).any()
        ):
            self._since_load = 0
            rows = self._work[:, :rotors]
            rows[ANGLES] = states[0, :rotors]
            np.cos(rows[ANGLES], out=rows[COSINES])
            np.sin(rows[ANGLES], out=rows[SINES])
        self._work[RATES, :rotors] = state[rotors : 2 * rotors]
        checks = checks or Checks(states[0], 0.0, np.empty(0, dtype=np.int64))
        step, plain = self._prepare(length), tuple(checks)
        done, error = advance(self._work, self._forces, step, plain, states)
        return states[: done + 1], error

    def interpolated(self, states: Array, length: float, times: Array) -> Array:
        """Return the states at given `times`, which are counted in steps since the first state.

        The result has shape (times, len(state)). In each step, polynomials of degree 8 are fitted
        to the angle, rate and acceleration at the start, the middle and the end of the step.
        """
        angles = states[:, : self._motion.rotors]
        output = np.empty((len(times), states.shape[1]))
        circular = np.array([np.cos(angles), np.sin(angles)])
        step = self._prepare(length)
        interpolate(self._between, self._forces, step, states, circular, times, output)
        return output

    def _prepare(self, length: float) -> Fields:
        if length != self._prepared:
            self._prepared = length
            decays = np.empty((2, 2, len(DRIFTS), 0))
            if self._motion.damped and self._linear:
                times = np.multiply.outer([length / 2, length], DRIFTS)[..., np.newaxis]
                exponents = -self._decay_rates * times
                divisors = np.where(exponents == 0, 1.0, exponents)
                growth = np.where(exponents == 0, 1.0, np.expm1(exponents) / divisors)
                decays = np.array([np.exp(exponents), times * growth]).swapaxes(0, 1)
                decays = self._padded(decays)
            self._step = length * DRIFTS, length * KICKS, decays
        return self._step

    def _padded(self, values: Array) -> Array:
        padding = padded_size(self._motion.rotors) - values.shape[-1]
        return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, padding)])


def zeros_in_line(rows: int, columns: int) -> Array:
    """Return zeros, shape (rows, columns), in memory that begins at the start of a cache line."""
    size, line = rows * columns, 64
    room = np.full(size + VECTOR, 0.0)
    first = -room.ctypes.data % line // room.itemsize
    return room[first : first + size].reshape(rows, columns)


class SymplecticNystrom(OdeSolver):
    """Symplectic Runge-Kutta-Nystrom method of order 6 for `EquationOfMotion`.

    The error of a step is the difference between the step and two half steps. The solver chooses a
    step length for which this error, in the norm of scipy's solvers, is below atol + rtol abs(y).
    The solver keeps this length as long as possible, because the energy error is bounded only
    while the length is constant. Steps whose error is too large are repeated with a shorter
    length. If the error is far below the tolerance, the length increases.

    `length` is the length of a step of the method [s]. One call of `step` takes up to `together`
    steps of the method. Raises TypeError if `fun` is not an `EquationOfMotion`, and ValueError if
    its `forces` contain Python functions, if `y0` has the wrong size, or if an option is out of
    range.
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
        expected = 2 * fun.rotors + fun.damped
        if self.n != expected:
            raise ValueError(
                f'a state of {self.n} numbers does not fit the motion of {fun.rotors} rotors, '
                f'which needs {expected}; call EquationOfMotion.state'
            )
        self._motion = fun
        self._settings = settings
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
        """Compile or load all loops by taking two steps, so that later simulations start fast."""
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
        factor = 0.25
        if math.isfinite(error):
            factor = (self._settings.aim / error) ** (1 / (ORDER + 1)) if error else 4.0
            factor = max(0.2, min(factor, 0.9)) if error > 1 else min(factor, 4.0)
        better = min(self.length * factor, self._longest)
        shorter = better < self._settings.max_shrinkage * self.length and self._trying
        if not error <= 1 or shorter or better > self._settings.min_growth * self.length:
            self._change_to(better)

    def _change_to(self, step: float) -> None:
        if step != self.length:
            self.length = step
            self._since_change = 0
            self._start_evenly()

    def _start_evenly(self) -> None:
        self._even_from, self._even_steps = float(self.t), 0

    def _update_limits(self) -> None:
        """Set the rate of the fastest rotor [rad/s], and the longest stable step [s].

        With this longest step, no rotor turns by more than LARGEST_TURN in a drift.
        """
        rotors = self._motion.rotors
        self._fastest = float(np.abs(self.y[rotors : 2 * rotors]).max())
        turning = _LONGEST_DRIFT * self._fastest / (self._settings.safety * LARGEST_TURN)
        limit = max(turning, self._motion.fastest_rate / STABLE_STEP)
        self._longest = min(self._max_step, 1 / limit)


class NystromOutput(DenseOutput):
    """Interpolation between the states of consecutive steps of equal length."""

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
