# SPDX-License-Identifier: Apache-2.0
"""Steps of a symplectic Runge-Kutta-Nystrom method along the motion of a chain of springs.

A step of length h is a symmetric sequence of drifts and kicks,

    drift(a_15 h) kick(b_14 h) drift(a_14 h) ... kick(b_1 h) drift(a_1 h).

A kick applies the torques that depend on the angles, and a drift those that depend on the rates.
With linear damping c and gamma = c / (M r^2), a drift is the exact solution without other torques,

    phi_dot(t) = phi_dot e^(-gamma t),    phi(t) = phi + phi_dot (1 - e^(-gamma t)) / gamma.

With damping of another kind, a drift is a Runge-Kutta step of order 4. Without damping a step is
symplectic and reversible. With linear damping, a step reduces volumes in phase space exactly as
the motion does. Therefore the sum of energy and dissipated energy has no trend.

The coefficients belong to the method SRKN_14^a of order 6 for systems with a quadratic kinetic
energy. Source: Blanes and Moan, Journal of Computational and Applied Mathematics 142 (2002) 313.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators.nystrom_loops import (
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
from soliton_linkage.linkage.chain import Array

ORDER = 6
"""Order of the method: the error of a step of length h is proportional to h^7."""
STABLE_STEP = 3.14
"""Longest stable step, multiplied by the angular frequency of the fastest vibration [1]. If this
product is slightly above pi, vibrations grow by less than 0.1 % per step; above 6.15, they grow
without limit."""

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


@dataclass(frozen=True)
class SolverSettings:
    """Tuning of `SymplecticNystrom`."""

    rotors_per_call: int = 16_000
    """Largest number of steps in one call of the compiled loops, multiplied by the number of
    rotors [1]. Sensitivity: at 0.5x or 2x, the solver is 10 % slower."""
    safety: float = 0.8
    """Largest allowed rotation of the fastest rotor in the longest drift, as a fraction of
    LARGEST_TURN [1]. Sensitivity: at 0.5x, 60 % more force evaluations if a rotor spins fast; with
    1, a rotor that accelerates within the step stops the integration."""
    aim: float = 0.3
    """A new step length is chosen so that the expected error is this fraction of the
    tolerance [1]. Sensitivity: at 0.5x, 10 % more force evaluations and half the error; at 2x, 10
    % fewer and twice the error."""
    min_growth: float = 1.25
    """The step length increases only if the measured error allows a length that is larger by this
    factor [1]. Sensitivity: with 1.13 or 1.5, the number of force evaluations changes by 6 %."""
    max_shrinkage: float = 0.95
    """The first step length is shortened if the measured error suggests a length below this
    fraction of it [1]. Sensitivity: no effect from 0.9 to 0.975."""
    measured_every: int = 32
    """Number of steps from one error measurement to the next [1]. Sensitivity: at 0.5x, 6 % more
    force evaluations; at 2x, 3 % fewer."""
    violent: float = 0.2
    """The error of each step is measured if the kinetic energy of a rotor exceeds this fraction of
    the energy that compresses a spring to length 0 [1]. A spring that becomes short changes its
    torques within one step. Sensitivity: from 0.01 to 1, the same errors in such motions; at 0.5x,
    5 % more force evaluations for a wall that was kicked with 30 rad/s."""
    steps_until_exact: int = 1000
    """Number of steps after which the cosines and sines are computed exactly again [1], because
    rounding errors accumulate."""
    shortest: float = 1e-6
    """The solver fails if the step is below this fraction of the longest stable step [1]."""
    trials: int = 60
    """If this number of step lengths has been tried without success [1], the solver fails. One to
    three trials are usual."""


DEFAULTS = SolverSettings()

_NONE: Numbers = np.empty(0, dtype=np.int64)
"""Empty list of step indices: no error is measured."""


def steps_to_measure(taken: int, count: int, every: int) -> Numbers:
    """Return the indices of the steps, among the next `count`, whose error is measured.

    Counted from the last change of the step length, they are the steps 1, 4 and 16 and all
    multiples of `every`, in increasing order. Since this change, `taken` steps have been taken;
    the next one has the index 1.
    """
    regular = np.arange(every - taken % every, count + 1, every)
    early = [step for step in (1, 4, 16) if taken < step <= taken + count]
    return np.union1d(np.array(early, dtype=np.int64) - taken, regular)


class NystromSteps:
    """Runge-Kutta-Nystrom steps of an `EquationOfMotion` with only terms of `CompiledTerm`."""

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

        `Checks` defines the error of a step, the scaled difference between the step and two half
        steps. The states have the shape (steps taken + 1, len(state)). They end before a step
        whose error exceeds 1, or in which a drift rotates a rotor by more than LARGEST_TURN.
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
        step, plain = self._prepare(length), tuple(checks or (states[0], 0.0, _NONE))
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
            self._step = length * DRIFTS, length * KICKS, self._decays(length)
        return self._step

    def _decays(self, length: float) -> Array:
        if not (self._motion.damped and self._linear):
            return np.empty((2, 2, len(DRIFTS), 0))
        times = np.multiply.outer([length / 2, length], DRIFTS)[..., np.newaxis]
        exponents = -self._decay_rates * times
        divisors = np.where(exponents == 0, 1.0, exponents)
        growth = np.where(exponents == 0, 1.0, np.expm1(exponents) / divisors)
        return self._padded(np.array([np.exp(exponents), times * growth]).swapaxes(0, 1))

    def _padded(self, values: Array) -> Array:
        padding = padded_size(self._motion.rotors) - values.shape[-1]
        return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, padding)])


def zeros_in_line(rows: int, columns: int) -> Array:
    """Return zeros, shape (rows, columns), in memory that begins at the start of a cache line."""
    size, line = rows * columns, 64
    room = np.full(size + VECTOR, 0.0)
    first = -room.ctypes.data % line // room.itemsize
    return room[first : first + size].reshape(rows, columns)
