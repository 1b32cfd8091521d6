# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of `nystrom_steps`, which says what they compute; imports numba.

Every rotor is carried as its angle, cosine and sine, and turned by the small angle of a drift
with polynomials, so that no loop calls a function and all are vectorised. Arrays are padded from
N to P places, whole vectors, with rotors that do not move.

The loops are short, and kept apart, because the compiler vectorises those alone in which few
arrays could overlap. They take arrays, not tuples or parts of them, because every array made in
a stage counts its references, which takes longer than twenty rotors do.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from soliton_linkage.chain import Array
from soliton_linkage.nystrom_steps import LARGEST_TURN

Kernel = TypeVar('Kernel', bound=Callable[..., Any])
Coefficients = tuple[float, float, float, float, float]


def compiled(function: Kernel) -> Kernel:
    """Compile when first called, or take what an earlier process has compiled.

    Products and sums may contract, but no sum is reordered.
    """
    try:
        return _compiled(function, cache=True)
    except RuntimeError:  # no folder to cache in can be written
        return _compiled(function, cache=False)


def _compiled(function: Kernel, cache: bool) -> Kernel:
    compiler = numba.njit(
        cache=cache,
        fastmath={'contract', 'nsz'},
        error_model='numpy',
        nogil=True,
        forceinline=True,
    )
    return cast(Kernel, compiler(function))


@compiled
def largest(values: Array) -> float:
    """Largest absolute value; NaN where one is NaN."""
    found = 0.0
    for n in range(values.size):
        value = abs(values[n])
        if not value <= found:
            found = value
    return found


@compiled
def turn(angles: Array, cosines: Array, sines: Array, rates: Array, time: float) -> None:
    """Turn rotors by x = rate time: (c, s) <- (c cos x - s sin x, s cos x + c sin x).

    The series of sin x and cos x - 1 go on until LARGEST_TURN allows nothing more.
    """
    for n in range(rates.size):
        x = time * rates[n]
        angles[n] += x
        z = x * x
        y = z * z
        odd = (-1 / 5040 + z * (1 / 362880)) + y * (-1 / 39916800 + z * (1 / 6227020800))
        odd = (-1 / 6 + z * (1 / 120)) + y * odd
        even = (-1 / 720 + z * (1 / 40320)) + y * (-1 / 3628800 + z * (1 / 479001600))
        even = z * ((-1 / 2 + z * (1 / 24)) + y * even)
        sine = x + x * z * odd
        c, s = cosines[n], sines[n]
        cosines[n] = c + (c * even - s * sine)
        sines[n] = s + (s * even + c * sine)


@compiled
def decay(rates: Array, turns: Array, decays: Array, stage: int, half_inertias: Array) -> float:
    """Damp the rates in a drift; return the energy taken out and put the angles into turns.

    Decays, shape (2, 15, P), are the factors of the rates and the angles per rate of each drift.
    """
    dissipated = 0.0
    for n in range(half_inertias.size):
        rate, factor = rates[n], decays[0, stage, n]
        turns[n] = decays[1, stage, n] * rate
        rates[n] = factor * rate
        dissipated += half_inertias[n] * (1 - factor * factor) * rate * rate
    return dissipated


@compiled
def pull_uniform(
    cosines: Array,
    sines: Array,
    next_cosines: Array,
    next_sines: Array,
    on_left: Array,
    on_right: Array,
    coefficients: Coefficients,
) -> None:
    """Pull of springs between rotors (c, s) and (c', s') whose parameters are all the same.

    With x = l^2 / lbar^2 - 1 the tension over the length is k (1 - lbar/l) = k e,
    e = x / (1 + x + sqrt(1 + x)), and

    x = offset + slope (s' - s) - product (s s' + c c'),
    pull on the left  = e [lever c - cross (s c' - c s')],
    pull on the right = e [cross (s c' - c s') - lever c'],

    slope = 2 a r / lbar^2, product = 2 r^2 / lbar^2, lever = k a r / I, cross = k r^2 / I.
    """
    offset, slope, product, lever, cross = coefficients
    for n in range(on_left.size):
        c, s, c_next, s_next = cosines[n], sines[n], next_cosines[n], next_sines[n]
        x = offset + slope * (s_next - s) - product * (s * s_next + c * c_next)
        e = x / (1 + x + np.sqrt(1 + x))
        torque = cross * (s * c_next - c * s_next)
        on_left[n] = e * (lever * c - torque)
        on_right[n] = e * (torque - lever * c_next)


@compiled
def pull_deviating(
    c: Array,
    s: Array,
    c_next: Array,
    s_next: Array,
    on_left: Array,
    on_right: Array,
    rows: Array,
) -> None:
    """Pull of springs that each have their own parameters, the rows, shape (8, P).

    These are offset, slope', slope, product, lever, cross, cross', lever' of `pull_uniform`, in
    which each place of a length or inertia takes that of its own rotor:

    x = offset + slope' s' - slope s - product (s s' + c c').
    """
    for n in range(on_left.size):
        x = rows[0, n] + (rows[1, n] * s_next[n] - rows[2, n] * s[n])
        on_left[n] = x - rows[3, n] * (s[n] * s_next[n] + c[n] * c_next[n])
    for n in range(on_left.size):
        x = on_left[n]
        on_left[n] = x / (1 + x + np.sqrt(1 + x))
    for n in range(on_left.size):
        torque = rows[6, n] * (s[n] * c_next[n] - c[n] * s_next[n])
        on_right[n] = on_left[n] * (torque - rows[7, n] * c_next[n])
    for n in range(on_left.size):
        torque = rows[5, n] * (s[n] * c_next[n] - c[n] * s_next[n])
        on_left[n] *= rows[4, n] * c[n] - torque


@compiled
def add_field(pulls: Array, cosines: Array, sines: Array, field: Array) -> None:
    """Add accelerations load + by_sine sin(phi) + by_cosine cos(phi), the rows of the field."""
    for n in range(field.shape[1]):
        pulls[n] += field[0, n] + (field[1, n] * sines[n] + field[2, n] * cosines[n])


@compiled
def kick(rates: Array, from_right: Array, from_left: Array, time: float) -> None:
    """Change the rates by the pulls for a time."""
    for n in range(rates.size):
        rates[n] += time * (from_right[n] + from_left[n])


@compiled
def record(states: Array, step: int, angles: Array, rates: Array, dissipated: float) -> None:
    """Write down the state after a step."""
    number = rates.size
    for n in range(number):
        states[step, n] = angles[n]
        states[step, number + n] = rates[n]
    if states.shape[1] > 2 * number:
        states[step, -1] = states[step - 1, -1] + dissipated


@compiled
def copy(work: Array, start: int, end: int) -> None:
    """Copy angles, rates, cosines and sines from four rows to four others."""
    for row in range(4):
        for n in range(work.shape[1]):
            work[end + row, n] = work[start + row, n]


@compiled
def error(before: Array, whole: Array, halves: Array, absolute: Array, relative: float) -> float:
    """Root mean square of the difference of two states in units of what is tolerated."""
    squares = 0.0
    for n in range(whole.size):
        tolerated = absolute[n] + relative * max(abs(before[n]), abs(halves[n]))
        squares += ((whole[n] - halves[n]) / tolerated) ** 2
    return math.sqrt(squares / whole.size)


@compiled
def take_step(
    angles: Array,
    all_rates: Array,
    rates: Array,
    cosines: Array,
    sines: Array,
    c: Array,
    s: Array,
    c_next: Array,
    s_next: Array,
    from_right: Array,
    from_left: Array,
    on_right: Array,
    turns: Array,
    coefficients: Coefficients,
    rows: Array,
    periodic: bool,
    field: Array,
    decays: Array,
    half_inertias: Array,
    drifts: Array,
    kicks: Array,
) -> float:
    """Take one step and return the energy that damping has taken out; see `advance`."""
    number, dissipated = rates.size, 0.0
    for stage in range(drifts.size):
        if half_inertias.size:
            dissipated += decay(all_rates, turns, decays, stage, half_inertias)
            turn(angles, c, s, turns, 1.0)
        else:
            turn(angles, c, s, all_rates, drifts[stage])
        if stage == kicks.size:
            break
        if periodic:
            cosines[number], sines[number] = cosines[0], sines[0]
        if rows.size:
            pull_deviating(c, s, c_next, s_next, from_right, on_right, rows)
        else:
            pull_uniform(c, s, c_next, s_next, from_right, on_right, coefficients)
        if periodic:
            from_left[0] = from_left[number]
        else:
            from_right[number - 1] = 0.0
        add_field(from_right, cosines, sines, field)
        kick(rates, from_right, from_left, kicks[stage])
    return dissipated


@compiled
def advance(
    work: Array,
    springs: tuple[Coefficients, Array, bool],
    field: Array,
    damping: tuple[Array, Array],
    stages: tuple[Array, Array],
    tolerances: tuple[Array, float],
    checks: tuple[int, int],
    states: Array,
) -> tuple[int, float]:
    """Fill states[1:] with the state after each step; return how many, and the largest error.

    The rows of work, shape (11, P + 1), are angles, rates, cosines and sines, three to work in
    and four to come back to. Springs are the coefficients of `pull_uniform`, the rows of
    `pull_deviating`, of shape (8, 0) where all are the same, and whether the ends are periodic.
    Field and damping, the arguments of `add_field` and, for half a step and a whole one, `decay`,
    have 0 places where there is none. Stages are the times of drifts and kicks [s]. Checks are
    the first step whose error is measured, by two of half the length, and how many follow till
    the next. It stops before a step that turns a rotor too far or whose error exceeds 1.
    """
    number, places = states.shape[1] // 2, work.shape[1] - 1
    angles, all_rates, cosines, sines = work[0, :places], work[1, :places], work[2], work[3]
    from_right, from_left, turns = work[4, :places], work[5], work[6, :places]
    rates, c, s = all_rates[:number], cosines[:-1], sines[:-1]
    c_next, s_next, on_right = cosines[1:], sines[1:], from_left[1:]
    coefficients, rows, periodic = springs
    decays, half_decays, half_inertias = damping[0][1], damping[0][0], damping[1]
    drifts, kicks = stages
    half_drifts, half_kicks = drifts / 2, kicks / 2
    halves = np.empty((3, states.shape[1]))
    longest, largest_error = largest(drifts), 0.0
    for step in range(1, len(states)):
        if not longest * largest(rates) <= LARGEST_TURN:
            return step - 1, largest_error
        checked = step >= checks[0] and (step - checks[0]) % checks[1] == 0
        if checked:
            copy(work, 0, 7)
            halves[0] = states[step - 1]
            for half in (1, 2):
                dissipated = take_step(
                    angles,
                    all_rates,
                    rates,
                    cosines,
                    sines,
                    c,
                    s,
                    c_next,
                    s_next,
                    from_right,
                    from_left,
                    on_right,
                    turns,
                    coefficients,
                    rows,
                    periodic,
                    field,
                    half_decays,
                    half_inertias,
                    half_drifts,
                    half_kicks,
                )
                record(halves, half, angles, rates, dissipated)
            copy(work, 7, 0)
        dissipated = take_step(
            angles,
            all_rates,
            rates,
            cosines,
            sines,
            c,
            s,
            c_next,
            s_next,
            from_right,
            from_left,
            on_right,
            turns,
            coefficients,
            rows,
            periodic,
            field,
            decays,
            half_inertias,
            drifts,
            kicks,
        )
        record(states, step, angles, rates, dissipated)
        if checked:
            found = error(states[step - 1], states[step], halves[2], tolerances[0], tolerances[1])
            largest_error = max(largest_error, found)
            if not found <= 1:
                return step - 1, found
    return len(states) - 1, largest_error
