# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `symplectic_nystrom`; the docstring of that module contains the equations.

Polynomials approximate cosine and sine of the rotation in a drift, so that the compiler can
vectorise all loops. The module `terms` defines the first rows of the array `work`, and this module
defines the other rows. P is the number of rotors N rounded up to a multiple of VECTOR. The
elements from N on are padding.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compile_loop, inlined, never_inlined, prefer_wide_vectors
from soliton_linkage.dynamics.terms import (
    ANGLES,
    COSINES,
    RATES,
    SINES,
    TORQUES,
    TORQUES_ON_RIGHT,
    VECTOR,
    active_power,
    sum_terms,
)
from soliton_linkage.linkage.chain import Array

Numbers = NDArray[np.int64]

TURNS, RATES_BEFORE, MEAN_OF_TURN, MEAN, SAVED = range(7, 12)
"""Rows of `work`. TURNS is the rotation of each rotor in a drift [rad]. In a drift with nonlinear
damping, RATES_BEFORE contains the rates before the drift [rad/s], and MEAN and MEAN_OF_TURN
contain weighted means of the acceleration [rad/s^2]. MEAN determines the change of the rates, and
MEAN_OF_TURN determines the rotation. SAVED is the first of four rows with a copy of the rows
ANGLES to SINES."""

WORK_ROWS = SAVED + 4
"""Number of rows of `work`."""

LARGEST_TURN = 0.5
"""Largest rotation in a drift [rad]. For smaller rotations, the series in `turned` have only
rounding errors."""


class Forces(NamedTuple):
    """Terms of the equation of motion, and moments of inertia of the rotors."""

    kinds: Numbers
    """Kinds of the terms that depend on the angles; see `TermTable`."""
    parameters: Array
    damping_kinds: Numbers
    """Kinds of the terms that depend on the rates."""
    damping_parameters: Array
    inverse_inertias: Array
    """1 / (M r^2) of each rotor [1/(kg m^2)], 0 for fixed rotors and padding, shape (P,)."""
    half_inertias: Array
    """M r^2 / 2 of each rotor [kg m^2], shape (P,). The shape is (0,) if no term is dissipative or
    active (see `Term`)."""
    active: bool
    """Whether the last term in `kinds` is active (see `Term.active`)."""


class Step(NamedTuple):
    """Durations and damping coefficients of a step of a given length."""

    drifts: Array
    """Durations of the drifts [s], shape (15,)."""
    kicks: Array
    """Durations for which the torques of the kicks act [s], shape (14,)."""
    decays: Array
    """Coefficients of linear damping, shape (2, 2, 15, P), or (2, 2, 15, 0) without linear
    damping. The first index is 0 for half a step and 1 for a whole step. The elements with the
    second index 0 are the rate after a drift divided by the rate before it [1]. The elements with
    the second index 1 are the rotation in the drift divided by the rate before it [s]."""


class Checks(NamedTuple):
    """Tolerances, and indices of the steps whose error is measured.

    The error of a step is the root mean square, over all variables y, of the error of y divided by
    absolute + relative abs(y).
    """

    absolute: Array
    """Absolute tolerance of each variable, shape (len(state),)."""
    relative: float
    """Relative tolerance [1]."""
    measured: Numbers
    """Indices of the steps whose error is measured; the first step has the index 1."""


Fields = tuple[Any, ...]
"""Plain tuple with the fields of a named tuple. As an argument of a compiled loop, numba converts
a plain tuple three times as fast as a named tuple."""


@inlined
def turned(c: float, s: float, x: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle after a rotation by x [rad], |x| <= LARGEST_TURN."""
    z = x * x
    y = z * z
    odd = (-1 / 5040 + z * (1 / 362880)) + y * (-1 / 39916800 + z * (1 / 6227020800))
    odd = (-1 / 6 + z * (1 / 120)) + y * odd
    even = (-1 / 720 + z * (1 / 40320)) + y * (-1 / 3628800 + z * (1 / 479001600))
    even = z * ((-1 / 2 + z * (1 / 24)) + y * even)
    sine = x + x * z * odd
    return c + (c * even - s * sine), s + (s * even + c * sine)


@inlined
def turn(work: Array, rates: int, time: float) -> None:
    """Rotate each rotor n by the angle `time` * work[rates, n]."""
    prefer_wide_vectors()
    for n in range(work.shape[1] - VECTOR):
        x = time * work[rates, n]
        work[ANGLES, n] += x
        work[COSINES, n], work[SINES, n] = turned(work[COSINES, n], work[SINES, n], x)


@inlined
def kick(work: Array, forces: Forces, time: float) -> None:
    """Change the rates by the impulses of the torques in `work` during `time` [s]."""
    for n in range(forces.inverse_inertias.size):
        torque = work[TORQUES, n] + work[TORQUES_ON_RIGHT, n]
        work[RATES, n] += time * forces.inverse_inertias[n] * torque


@inlined
def decay(work: Array, forces: Forces, decays: Array, stage: int) -> float:
    """Apply linear damping in a drift: set RATES and TURNS, return the dissipated energy [J]."""
    dissipated = 0.0
    for n in range(forces.half_inertias.size):
        rate, factor = work[RATES, n], decays[0, stage, n]
        work[TURNS, n] = decays[1, stage, n] * rate
        work[RATES, n] = factor * rate
        dissipated += forces.half_inertias[n] * (1 - factor * factor) * rate * rate
    return dissipated


@inlined
def damp(work: Array, rotors: int, forces: Forces, time: float) -> float:
    """Apply damping of any kind in a drift of `time` [s] by a Runge-Kutta step.

    Set RATES and TURNS, and return the dissipated energy [J].
    """
    size = forces.half_inertias.size
    for n in range(size):
        work[RATES_BEFORE, n] = work[RATES, n]
        work[MEAN, n] = work[MEAN_OF_TURN, n] = 0.0
    for stage in range(4):
        sum_terms(work, rotors, forces.damping_kinds, forces.damping_parameters)
        weight = 1.0 if stage in (0, 3) else 2.0
        for n in range(size):
            change = forces.inverse_inertias[n] * work[TORQUES, n]
            work[MEAN, n] += weight * change / 6
            work[MEAN_OF_TURN, n] += change / 6 if stage < 3 else 0.0
            share = 1.0 if stage == 2 else 0.5
            work[RATES, n] = work[RATES_BEFORE, n] + share * time * change
    dissipated = 0.0
    for n in range(size):
        before = work[RATES_BEFORE, n]
        after = before + time * work[MEAN, n]
        work[TURNS, n] = time * (before + time * work[MEAN_OF_TURN, n])
        work[RATES, n] = after
        dissipated += forces.half_inertias[n] * (before - after) * (before + after)
    return dissipated


@compile_loop
def take_step(work: Array, rotors: int, forces: Forces, step: Step, share: float) -> float:
    """Take half a step (`share` 0.5) or a whole step (1); return the dissipated energy [J]."""
    never_inlined()
    dissipated = 0.0
    for stage in range(step.drifts.size):
        time = share * step.drifts[stage]
        if not forces.half_inertias.size:
            turn(work, RATES, time)
        else:
            if step.decays.size:
                dissipated += decay(work, forces, step.decays[int(share)], stage)
            else:
                dissipated += damp(work, rotors, forces, time)
            turn(work, TURNS, 1.0)
        if stage < step.kicks.size:
            power = sum_terms(work, rotors, forces.kinds, forces.parameters)
            time = share * step.kicks[stage]
            kick(work, forces, time)
            if forces.active:
                # The work of an impulse is the product of the impulse and the mean of the rates
                # before and after the impulse.
                dissipated += time * (power + active_power(work, rotors)) / 2
    return dissipated


@inlined
def too_fast(work: Array, rotors: int, limit: float) -> bool:
    """Return whether the rate of a rotor exceeds a limit [rad/s] or is NaN."""
    found = 0
    for n in range(rotors):
        found += not abs(work[RATES, n]) <= limit
    return found > 0


@inlined
def copy(work: Array, start: int, end: int) -> None:
    """Copy the rows `start` to `start` + 3 of `work` into the rows `end` to `end` + 3."""
    for row in range(4):
        for n in range(work.shape[1]):
            work[end + row, n] = work[start + row, n]


@inlined
def copy_state(source: Array, target: Array) -> None:
    """Copy a state by a loop, because the assignment of a slice takes seconds to compile."""
    for n in range(source.size):
        target[n] = source[n]


@inlined
def scaled_difference(before: Array, whole: Array, halves: Array, checks: Checks) -> float:
    """Return the error of a step [1] from the states before it, after it and after two halves."""
    squares = 0.0
    for n in range(whole.size):
        size = max(abs(before[n]), abs(halves[n]))
        squares += ((whole[n] - halves[n]) / (checks.absolute[n] + checks.relative * size)) ** 2
    return math.sqrt(squares / whole.size)


@inlined
def store(states: Array, row: int, work: Array, rotors: int, dissipated: float) -> None:
    """Store a state in a row of `states`; the last step has dissipated `dissipated` [J]."""
    for n in range(rotors):
        states[row, n] = work[ANGLES, n]
        states[row, rotors + n] = work[RATES, n]
    if states.shape[1] > 2 * rotors:
        states[row, -1] = states[row - 1, -1] + dissipated


@compile_loop
def advance(
    work: Array, plain_forces: Fields, plain_step: Fields, plain_checks: Fields, states: Array
) -> tuple[int, float]:
    """Fill states[1:] with the state after each step; return number of steps and largest error.

    Reject a step with an error above 1, or with a rotation above LARGEST_TURN in a drift, and stop
    before it. The number of steps does not include the rejected step. The largest error includes
    its error, if this was measured.
    """
    forces, step, checks = Forces(*plain_forces), Step(*plain_step), Checks(*plain_checks)
    rotors = states.shape[1] // 2
    halves = np.empty((3, states.shape[1]))
    fastest, largest_error, next_measured = LARGEST_TURN / np.max(np.abs(step.drifts)), 0.0, 0
    for row in range(1, len(states)):
        if too_fast(work, rotors, fastest):
            return row - 1, largest_error
        checked = next_measured < checks.measured.size and row == checks.measured[next_measured]
        if checked:
            next_measured += 1
            copy(work, ANGLES, SAVED)
            copy_state(states[row - 1], halves[0])
            for half in (1, 2):
                dissipated = take_step(work, rotors, forces, step, 0.5)
                store(halves, half, work, rotors, dissipated)
            copy(work, SAVED, ANGLES)
        dissipated = take_step(work, rotors, forces, step, 1.0)
        store(states, row, work, rotors, dissipated)
        if checked:
            error = scaled_difference(states[row - 1], states[row], halves[2], checks)
            largest_error = max(largest_error, error)
            if not error <= 1:
                return row - 1, error
    return len(states) - 1, largest_error


@compile_loop
def interpolate(
    work: Array,
    plain_forces: Fields,
    plain_step: Fields,
    states: Array,
    circular: Array,
    times: Array,
    output: Array,
) -> None:
    """Fill `output` with the states at the given times; see `NystromSteps.interpolated`.

    `circular` contains the cosines and sines of the angles in `states`, shape (2, states, N).
    """
    forces, step = Forces(*plain_forces), Step(*plain_step)
    rotors = states.shape[1] // 2
    half = np.sum(step.drifts) / 2
    knots = np.empty((9, states.shape[1] - rotors))
    middle = np.empty((2, states.shape[1]))
    fitted = -1
    for frame in range(times.size):
        row = min(int(times[frame]), len(states) - 2)
        if row != fitted:
            for knot in range(3):
                load(work, states[row + knot // 2], circular[:, row + knot // 2])
                state = states[row + knot // 2]
                if knot == 1:
                    copy_state(states[row], middle[0])
                    dissipated = take_step(work, rotors, forces, step, 0.5)
                    store(middle, 1, work, rotors, dissipated)
                    state = middle[1]
                put_knot(work, forces, state, half, knots, knot)
            fit(knots)
            fitted = row
        evaluate(knots, rotors, 2 * (times[frame] - row) - 1, half, output[frame])


@inlined
def load(work: Array, state: Array, circular: Array) -> None:
    """Copy angles, rates, cosines and sines of a state into `work`."""
    rotors = circular.shape[1]
    for n in range(rotors):
        work[ANGLES, n] = state[n]
        work[RATES, n] = state[rotors + n]
        work[COSINES, n] = circular[0, n]
        work[SINES, n] = circular[1, n]


@compile_loop
def put_knot(
    work: Array, forces: Forces, state: Array, unit: float, knots: Array, knot: int
) -> None:
    """Store angles, dissipated energy, and their first two derivatives, at a knot.

    The derivatives are with respect to the time divided by `unit` [s].
    """
    never_inlined()
    rotors, first = state.size // 2, 3 * knot
    active_before = sum_terms(work, rotors, forces.kinds, forces.parameters)
    for n in range(rotors):
        torque = work[TORQUES, n] + work[TORQUES_ON_RIGHT, n]
        knots[first, n] = state[n]
        knots[first + 1, n] = unit * state[rotors + n]
        knots[first + 2, n] = unit**2 * forces.inverse_inertias[n] * torque
    if forces.half_inertias.size:
        table = forces.damping_kinds, forces.damping_parameters
        knots[first, rotors] = state[2 * rotors]
        knots[first + 1, rotors] = unit * (active_before + sum_terms(work, rotors, *table))
        for n in range(rotors):
            knots[first + 2, n] += unit**2 * forces.inverse_inertias[n] * work[TORQUES, n]
        # The second derivative of the dissipated energy is a central difference. It is exact for
        # linear damping and active terms, because their power is quadratic in rates and angles.
        power = 0.0
        for sign in (-0.5, 0.5):
            for n in range(rotors):
                work[RATES, n] = state[rotors + n] + sign / unit * knots[first + 2, n]
                work[ANGLES, n] = state[n] + sign * knots[first + 1, n]
            power += 2 * sign * sum_terms(work, rotors, *table)
            if forces.active:
                power += 2 * sign * sum_terms(work, rotors, forces.kinds, forces.parameters)
        knots[first + 2, rotors] = unit * power


@inlined
def fit(knots: Array) -> None:
    """Fit a polynomial of degree 8 to values and two derivatives at x = -1, 0 and 1.

    The coefficients of x^0 to x^8 replace these values and derivatives.
    """
    for n in range(knots.shape[1]):
        value, slope, curvature = knots[3, n], knots[4, n], knots[5, n]
        before, after = knots[0, n] - value, knots[6, n] - value
        even = (after + before) / 2 - curvature / 2
        even_slope = (knots[7, n] - knots[1, n]) / 2 - curvature
        even_curvature = (knots[8, n] + knots[2, n]) / 2 - curvature
        odd = (after - before) / 2 - slope
        odd_slope = (knots[7, n] + knots[1, n]) / 2 - slope
        odd_curvature = (knots[8, n] - knots[2, n]) / 2
        eighth = (even_curvature - 9 * even_slope + 24 * even) / 8
        sixth = (even_slope - 4 * even) / 2 - 2 * eighth
        seventh = (odd_curvature - 7 * odd_slope + 15 * odd) / 8
        fifth = (odd_slope - 3 * odd) / 2 - 2 * seventh
        knots[0, n], knots[1, n], knots[2, n] = value, slope, curvature / 2
        knots[3, n], knots[4, n] = odd - fifth - seventh, even - sixth - eighth
        knots[5, n], knots[6, n], knots[7, n], knots[8, n] = fifth, sixth, seventh, eighth


@inlined
def evaluate(knots: Array, rotors: int, x: float, unit: float, output: Array) -> None:
    """Write the state at the time x * `unit` [s] after the middle of the step into `output`."""
    prefer_wide_vectors()
    for n in range(knots.shape[1]):
        value = slope = 0.0
        for power in range(8, -1, -1):
            slope = slope * x + value
            value = value * x + knots[power, n]
        output[n if n < rotors else 2 * rotors] = value
        if n < rotors:
            output[rotors + n] = slope / unit
