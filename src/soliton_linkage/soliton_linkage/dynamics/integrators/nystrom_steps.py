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

The coefficients make use of a kinetic energy that is quadratic: SRKN_14^a, order 6, of S. Blanes
and P. C. Moan, J. Comput. Appl. Math. 142 (2002) 313.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import NO_DEVIATIONS

ORDER = 6
STABLE_STEP = 3.14
"""Longest step in units of 1 / omega at which vibrations of frequency omega stay bounded.

Those of pi grow, though by less than a thousandth a step, and those of 6.15 and more.
"""

_HALF_OF_DRIFTS = (
    0.0378593198406116,
    0.102635633102435,
    -0.0258678882665587,
    0.314241403071447,
    -0.130144459517415,
    0.106417700369543,
    -0.00879424312851058,
)
_HALF_OF_KICKS = (
    0.09171915262446165,
    0.183983170005006,
    -0.05653436583288827,
    0.004914688774712854,
    0.143761127168358,
    0.328567693746804,
)
_LAST_KICK = 0.5 - sum(_HALF_OF_KICKS)

DRIFTS = np.array([*_HALF_OF_DRIFTS, 1 - 2 * sum(_HALF_OF_DRIFTS), *_HALF_OF_DRIFTS[::-1]])
"""a_1 to a_15."""
KICKS = np.array([*_HALF_OF_KICKS, _LAST_KICK, _LAST_KICK, *_HALF_OF_KICKS[::-1]])
"""b_1 to b_14."""

LARGEST_TURN = 0.5
"""Of a rotor in one drift [rad], up to which the compiled loops are exact to rounding."""

MEASURED_EVERY = 32
"""Of how many steps one has its error measured."""

STEPS_UNTIL_EXACT = 1000
"""Cosines and sines drift away from the angles by a rounding a turn, at random."""

VECTOR = 8
"""Numbers that a processor takes at once, at most; rows of arrays are made of so many."""

Numbers = NDArray[np.int64]

NONE: Numbers = np.empty(0, dtype=np.int64)

Springs = tuple[tuple[float, float, float, float, float], Array, bool]


@dataclass(frozen=True)
class Checks:
    """Which steps have their error measured, against two of half the length, and by what.

    Errors are in the norm of scipy's solvers: the root mean square over the state, in units of
    absolute + relative abs(state).
    """

    absolute: Array
    """Shape (len(state),)."""
    relative: float
    taken: int = 0
    """Steps of the same length that were taken before."""

    def measured(self, count: int) -> Numbers:
        """Which of the next steps have their error measured; the next one is 1.

        Of the first step of a length, which says little of a motion that begins, of two soon
        after it, and then of every 32nd.
        """
        first = MEASURED_EVERY - self.taken % MEASURED_EVERY
        regular = np.arange(first, count + 1, MEASURED_EVERY)
        early = [step for step in (1, 4, 16) if self.taken < step <= self.taken + count]
        return np.append(np.array(early) - self.taken, regular) if early else regular


class Steps(Protocol):
    """Takes steps along a motion."""

    def advance(
        self, state: Array, step: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """States at the start and after each of count steps [s], and the largest error.

        It stops before a step in which a rotor would turn by more than half a radian in a drift,
        or whose error exceeds 1, so that the states have the shape (done + 1, len(state)).
        """

    def interpolated(self, states: Array, step: float, places: Array) -> Array:
        """States at places, counted in steps from the first state, shape (places, len(state)).

        Polynomials in each step, degree 8 in the angles, have angles, rates and accelerations at
        its ends and its middle.
        """


def steps_of(motion: EquationOfMotion, compiled: bool | None) -> Steps:
    """Steps in compiled loops, or in numpy where that is asked for.

    Where nothing is asked for, and numba is absent, it is numpy with a RuntimeWarning.
    """
    if compiled is False:
        return NumpySteps(motion)
    try:
        return CompiledSteps(motion)
    except ImportError as error:
        if compiled:
            raise
        warnings.warn(
            f'the chain is integrated without compiled loops, many times slower ({error}): '
            'pip install numba',
            RuntimeWarning,
            stacklevel=2,
        )
        return NumpySteps(motion)


def zeros_in_line(rows: int, places: int) -> Array:
    """Zeros of shape (rows, places), at an address where a line of the cache begins.

    Vectors that lie across two lines take longer. They are filled now, so that the system does
    not have to find the room later, page by page.
    """
    size, line = rows * places, 64
    room = np.full(size + VECTOR, 0.0)
    first = -room.ctypes.data % line // room.itemsize
    return room[first : first + size].reshape(rows, places)


def load_angles(work: Array, angles: Array) -> None:
    """Put angles, cosines and sines into the first rows of work."""
    rows = work[:, : len(angles)]
    rows[0] = angles
    np.cos(angles, out=rows[2])
    np.sin(angles, out=rows[3])


def load_loops() -> None:
    """Compile the loops, or load what was compiled, so that no step has to wait for that.

    Raises ImportError where numba is absent.
    """
    steps, state = CompiledSteps(EquationOfMotion(Chain(number_of_rotors=2))), np.zeros(4)
    states, _ = steps.advance(state, 1e-3, 1)
    steps.interpolated(states, 1e-3, np.zeros(1))


class NumpySteps:
    """Steps as the equations have them."""

    def __init__(self, motion: EquationOfMotion) -> None:
        """Take steps along a motion."""
        self._motion = motion

    def advance(
        self, state: Array, step: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """States at the start and after each of count steps [s], and the largest error."""
        number = self._motion.rotors
        longest_drift = abs(step) * float(np.abs(DRIFTS).max())
        states, largest = [state.copy()], 0.0
        measured = checks.measured(count) if checks else NONE
        for index in range(1, count + 1):
            before = states[-1]
            if not longest_drift * np.abs(before[number : 2 * number]).max() <= LARGEST_TURN:
                break
            after = self._after(before, step)
            if checks and index in measured:
                halves = self._after(self._after(before, step / 2), step / 2)
                sizes = np.maximum(np.abs(before), np.abs(halves))
                differences = (after - halves) / (checks.absolute + checks.relative * sizes)
                error = math.sqrt(float(np.mean(differences**2)))
                largest = max(largest, error)
                if not error <= 1:
                    return np.array(states), error
            states.append(after)
        return np.array(states), largest

    def _after(self, before: Array, step: float) -> Array:
        motion, number = self._motion, self._motion.rotors
        after = before.copy()
        angles, rates, dissipated = after[:number], after[number : 2 * number], after[-1:]
        for stage, drift in enumerate(DRIFTS):
            if stage:
                rates += step * KICKS[stage - 1] * motion.accelerations(angles)
            factors, turns = _decay(motion, step * drift)
            angles += turns * rates
            if motion.damped:
                lost = motion.chain.moments_of_inertia * (1 - factors**2) * rates**2 / 2
                dissipated += lost.sum()
                rates *= factors
        return after

    def interpolated(self, states: Array, step: float, places: Array) -> Array:
        """States at places, counted in steps from the first state, shape (places, len(state))."""
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
        knots = start, self._after(start, half), end
        data = np.array([self._with_derivatives(knot, half) for knot in knots]).reshape(9, -1)
        origin = data[3].copy()
        data[[0, 3, 6]] -= origin
        coefficients = _POLYNOMIALS @ data
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
        heating = 2 * motion.chain.dampings * rates @ accelerations
        values = np.concatenate([state[:number], state[2 * number :]])
        first = np.concatenate([rates, slope[2 * number :]])
        second = np.concatenate([accelerations, [heating] * motion.damped])
        return np.array([values, unit * first, unit**2 * second])


class CompiledSteps:
    """Steps in the loops of `nystrom_kernels`; raises ImportError where numba is absent."""

    def __init__(self, motion: EquationOfMotion) -> None:
        """Take steps along a motion."""
        # What numba takes to import, half a second, is for those who use it.
        from soliton_linkage.dynamics.integrators import nystrom_loops as kernels

        self._kernels = kernels
        self._motion = motion
        self.places = -(-motion.rotors // VECTOR) * VECTOR
        self._springs = self._coefficients()
        self._field = self._accelerations_of_field()
        self._prepared = math.nan
        half_inertias = motion.chain.moments_of_inertia / 2
        self._half_inertias = self._padded(half_inertias) if motion.damped else np.empty(0)
        self._work = zeros_in_line(11, self.places + VECTOR)
        self._since_load = STEPS_UNTIL_EXACT

    @property
    def forces(self) -> tuple[Springs, Array]:
        """Springs and field as the loops take them."""
        return self._springs, self._field

    def advance(
        self, state: Array, step: float, count: int, checks: Checks | None = None
    ) -> tuple[Array, float]:
        """States at the start and after each of count steps [s], and the largest error."""
        number = self._motion.rotors
        states = np.empty((count + 1, len(state)))
        states[0] = state
        self._since_load += count
        if (
            self._since_load > STEPS_UNTIL_EXACT
            or (self._work[0, :number] != states[0, :number]).any()
        ):
            self._since_load = 0
            load_angles(self._work, states[0, :number])
        self._work[1, :number] = state[number : 2 * number]
        self._prepare(step)
        done, error = self._kernels.advance(
            self._work,
            self._springs,
            self._field,
            (self._decays, self._half_inertias),
            self._stages,
            (checks.absolute, checks.relative) if checks else (state, 0.0),
            checks.measured(count) if checks else NONE,
            states,
        )
        return states[: done + 1], error

    def interpolated(self, states: Array, step: float, places: Array) -> Array:
        """States at places, counted in steps from the first state, shape (places, len(state))."""
        angles = states[:, : self._motion.rotors]
        output = np.empty((len(places), states.shape[1]))
        self._prepare(step)
        self._kernels.interpolate(
            self._work,
            self._springs,
            self._field,
            (self._decays, self._half_inertias, self._motion.decay_rates),
            self._stages,
            states,
            np.array([np.cos(angles), np.sin(angles)]),
            places,
            output,
        )
        return output

    def _prepare(self, step: float) -> None:
        """What steps of a length need, unless the last ones had it."""
        if step != self._prepared:
            self._prepared = step
            self._decays = self._decays_of(step)
            self._stages = step * DRIFTS, step * KICKS

    def _coefficients(self) -> Springs:
        chain, inverse = self._motion.chain, self._motion.inverse_inertias
        left = np.arange(chain.number_of_springs)
        right = (left + 1) % chain.number_of_rotors
        squares, lengths = chain.rest_lengths**2, chain.rotor_lengths
        lever_left = chain.stiffnesses * chain.spacings * lengths[left] * inverse[left]
        lever_right = chain.stiffnesses * chain.spacings * lengths[right] * inverse[right]
        crosses = chain.stiffnesses * lengths[left] * lengths[right]
        rows = np.array(
            [
                1 + chain.offsets / squares,
                2 * chain.spacings * lengths[right] / squares,
                2 * chain.spacings * lengths[left] / squares,
                2 * lengths[left] * lengths[right] / squares,
                lever_left,
                crosses * inverse[left],
                crosses * inverse[right],
                lever_right,
            ]
        )
        offset, _, slope, product, lever, cross, *_ = (float(row[0]) for row in rows)
        rows = np.empty((8, 0)) if self._plain() else self._padded(rows)
        return (offset, slope, product, lever, cross), rows, chain.periodic

    def _plain(self) -> bool:
        """Whether springs that are all alike are all that acts."""
        motion = self._motion
        even = motion.chain.deviations == NO_DEVIATIONS and not motion.fixed
        return even and not (motion.chain.periodic or motion.damped or motion.in_field)

    def _accelerations_of_field(self) -> Array:
        motion, gravity = self._motion, self._motion.gravity
        if not motion.in_field:
            return np.empty((3, 0))
        torques = np.zeros(motion.rotors) if motion.torques is None else motion.torques
        weights = gravity.acceleration * motion.chain.masses * motion.chain.rotor_lengths
        tilted = [weights * np.cos(gravity.tilt), weights * np.sin(gravity.tilt)]
        return self._padded(np.array([torques, *tilted]) * motion.inverse_inertias)

    def _decays_of(self, step: float) -> Array:
        """Factors of rates and angles per rate in the drifts of a half and a whole step."""
        if not self._motion.damped:
            return np.empty((2, 2, len(DRIFTS), 0))
        decays = [
            [_decay(self._motion, length * drift) for drift in DRIFTS]
            for length in (step / 2, step)
        ]
        return self._padded(np.array(decays).swapaxes(1, 2))

    def _padded(self, values: Array) -> Array:
        padded = np.zeros((*values.shape[:-1], self.places))
        padded[..., : values.shape[-1]] = values
        return padded


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


def _decay(motion: EquationOfMotion, time: float) -> tuple[Array, Array]:
    """Factor of the rates after a free time [s], and the angle turned per rate [s], (N,) each."""
    exponents = -motion.decay_rates * time
    divisors = np.where(exponents == 0, 1.0, exponents)
    growth = np.where(exponents == 0, 1.0, np.expm1(exponents) / divisors)
    return np.exp(exponents), time * growth
