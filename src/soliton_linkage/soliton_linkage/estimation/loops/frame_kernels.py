# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the analysis of a frame; `frame_arrays` says what they compute."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    COUNT,
    FLAGS,
    NUMBER,
    READ,
    READ_FLAGS,
    READ_TABLE,
    ROW,
    TABLE,
    YES,
    compiled,
)
from soliton_linkage.linkage.chain import Array

Flags = NDArray[np.bool_]

_WHOLE = 2 * math.pi
_SHARE_OF_A_TURN = 0.5 / math.pi
_TINY = float(np.finfo(np.float64).tiny)
_LARGE = 1e150
_MANY_TURNS = 1e5
# pi / 2 in parts of which the first two have few enough digits for products to be exact; the
# polynomials of fdlibm (Sun Microsystems, 1993) for angles up to pi / 4.
_QUARTER = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_LEAST_LEVER = 1e-9


@compiled(READ, ROW, ROW, ROW)
def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    """Angles as read, without jumps."""
    for n in range(angles.size):
        angle = angles[n]
        if abs(angle) < 1e9:
            jump = np.rint((angle - last[n]) / _WHOLE)
            if math.isfinite(jump):
                turns[n] -= jump
            last[n] = angle
            seen[n] = angle + _WHOLE * turns[n]
        else:
            seen[n] = math.nan


@compiled(READ, NUMBER)
def all_within(values: Array, limit: float) -> bool:
    """Whether a row is known, finite and within a limit."""
    within = True
    for n in range(values.size):
        size = abs(values[n])
        within &= size <= limit and size < math.inf
    return within


@compiled(READ, READ, YES, READ, READ, READ, COUNT, ROW)
def compare(
    angles: Array,
    corrections: Array,
    upside_down: bool,
    before: Array,
    about: Array,
    beyond: Array,
    first: int,
    differences: Array,
) -> None:
    """Differences of angles from those of a wall."""
    end = first + about.size
    for n in range(angles.size):
        angle = angles[n] - corrections[n]
        if upside_down:
            angle = math.pi - angle
        expected = before[n] if n < first else about[n - first] if n < end else beyond[n]
        apart = angle - expected
        differences[n] = apart - _WHOLE * np.rint(apart * _SHARE_OF_A_TURN)


@compiled(ROW, COUNT, READ, NUMBER, NUMBER, NUMBER, READ_FLAGS, FLAGS, FLAGS, ROW)
def look(
    differences: Array,
    first: int,
    tangent: Array,
    limit: float,
    spread: float,
    least: float,
    doubtful: Flags,
    outlying: Flags,
    used: Flags,
    left: Array,
) -> tuple[tuple[int, int, int], bool, tuple[float, float, float], float]:
    """Find the arc that a frame shows, and what it leaves."""
    count, end = tangent.size, first + tangent.size
    strange = False
    for n in range(differences.size):
        square = differences[n] * differences[n]
        if first <= n < end:
            square -= spread * tangent[n - first] ** 2
        outlying[n] = square > limit or (doubtful.size > 0 and doubtful[n])
        strange |= outlying[n]
    known, excluded, whole, kept = 0, 0, 0.0, 0.0
    for n in range(count):
        used[n] = math.isfinite(differences[first + n])
        known += used[n]
        excluded += outlying[first + n]
        if used[n]:
            whole += tangent[n] ** 2
            kept += 0.0 if outlying[first + n] else tangent[n] ** 2
    if excluded and kept > least * whole:
        for n in range(count):
            used[n] &= not outlying[first + n]
    counted, information, ahead = 0, 0.0, 0.0
    for n in range(count):
        if used[n]:
            counted += 1
            information += tangent[n] * tangent[n]
            ahead += tangent[n] * differences[first + n]
    ahead = ahead / information if information else 0.0
    squares = 0.0
    for n in range(count):
        differences[first + n] -= ahead * tangent[n]
        left[n] = differences[first + n] if used[n] else 0.0
        squares += left[n] * left[n]
    largest, unknown = 0.0, False
    for n in range(differences.size):
        largest = max(largest, abs(differences[n]))
        unknown |= not abs(differences[n]) < math.inf
    largest = math.inf if unknown else largest
    return (known, excluded, counted), strange, (information, ahead, squares), largest


@compiled(READ, ROW, ROW)
def sines_and_cosines(angles: Array, sines: Array, cosines: Array) -> None:
    """Sines and cosines, from the polynomials of the nearest quarter of a turn."""
    large = False
    for n in range(angles.size):
        angle = angles[n]
        large |= abs(angle) > _MANY_TURNS
        quarters = np.rint(angle * (2 / math.pi))
        x = angle - quarters * _QUARTER[0] - quarters * _QUARTER[1] - quarters * _QUARTER[2]
        square = x * x
        sine, cosine = _SINE[5], _COSINE[5]
        for order in range(4, -1, -1):
            sine = _SINE[order] + square * sine
            cosine = _COSINE[order] + square * cosine
        sine = x + x * square * sine
        cosine = 1 - 0.5 * square + square * square * cosine
        turned = quarters - 4 * np.floor(0.25 * quarters)
        odd = turned == 1 or turned == 3
        sines[n] = (cosine if odd else sine) * (1.0 if turned < 2 else -1.0)
        cosines[n] = (sine if odd else cosine) * (1.0 if turned == 0 or turned == 3 else -1.0)
    if large:
        for n in range(angles.size):
            if abs(angles[n]) > _MANY_TURNS:
                sines[n], cosines[n] = math.sin(angles[n]), math.cos(angles[n])


@compiled(READ, READ_TABLE, COUNT, NUMBER, ROW)
def spline(knots: Array, coefficients: Array, degree: int, at: float, values: Array) -> None:
    """Values of B-splines, by Cox's and de Boor's recursion."""
    low, high = degree, coefficients.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= at:
            low = middle
        else:
            high = middle
    basis = np.zeros(degree + 1)
    basis[0] = 1.0
    for order in range(1, degree + 1):
        saved = 0.0
        for n in range(order):
            right, left = knots[low + n + 1], knots[low + 1 + n - order]
            share = basis[n] / (right - left)
            basis[n] = saved + (right - at) * share
            saved = (at - left) * share
        basis[order] = saved
    for column in range(values.size):
        value = 0.0
        for n in range(degree + 1):
            value += basis[n] * coefficients[low - degree + n, column]
        values[column] = value


@compiled(READ, READ, READ_TABLE, COUNT, COUNT, TABLE)
def _spring(
    sines: Array, cosines: Array, parameters: Array, n: int, following: int, rows: Array
) -> None:
    spacing, offset, rest_length = parameters[1, n], parameters[2, n], parameters[3, n]
    h, v = parameters[0, n] * sines[n], parameters[0, n] * cosines[n]
    h_next = parameters[0, following] * sines[following]
    v_next = parameters[0, following] * cosines[following]
    across, up = h_next - h, v_next - v
    excess = offset + 2 * spacing * across - 2 * (h * h_next + v * v_next)
    across += spacing
    length = math.sqrt(across * across + up * up)
    divisor = max(length, _TINY)
    rows[0, n] = excess / (length + rest_length)
    rows[1, n] = (h * up - v * across) / divisor
    rows[2, n] = (v_next * across - h_next * up) / divisor


@compiled(READ, READ, READ_TABLE, YES, TABLE)
def springs(
    sines: Array, cosines: Array, parameters: Array, periodic: bool, rows: Array
) -> tuple[float, float]:
    """Extensions and levers of springs, and how the rotors twist and stand."""
    rotors = sines.size
    for n in range(rotors - 1):
        _spring(sines, cosines, parameters, n, n + 1, rows)
    if periodic:
        _spring(sines, cosines, parameters, rotors - 1, 0, rows)
    twists, upright, sign = 0.0, 0.0, 1.0
    for n in range(rotors - 1):
        twists += sign * (sines[n + 1] * cosines[n] - cosines[n + 1] * sines[n])
        upright += sign * cosines[n] if n else 0.0
        sign = -sign
    return twists, upright


@compiled(READ, NUMBER, READ, NUMBER)
def _wake(energies: Array, place: float, walls: Array, reach: float) -> float:
    wake, count = 0.0, energies.size
    for n in range(walls.size - 1):
        low, high = walls[n] + reach - place, walls[n + 1] - reach - place
        begin = math.floor(low) + 1 if low >= 0 else 0
        end = math.ceil(high) if high < count else count
        for m in range(begin, end):
            wake += energies[m]
    return wake


@compiled(READ_TABLE, READ, READ, READ, YES, NUMBER, READ, NUMBER)
def elastic(
    rows: Array,
    half: Array,
    lefts: Array,
    rights: Array,
    periodic: bool,
    variance: float,
    walls: Array,
    reach: float,
) -> tuple[float, float, float, float]:
    """Energy of springs less that of the noise, its wake, and sums."""
    whole, squares, pulling = 0.0, 0.0, 0.0
    count = half.size
    energies = np.empty(count)
    for n in range(count):
        extension, first, second = rows[0, n], rows[1, n], rows[2, n]
        levers = lefts[n] * first * first + rights[n] * second * second
        stretched = half[n] * extension * extension
        energies[n] = stretched - variance * levers
        whole += energies[n]
        squares += levers * levers
        pulling += stretched * levers
        if n + 1 < count or periodic:
            after = n + 1 if n + 1 < count else 0
            by_next = lefts[after] * rows[1, after]
            squares += 2 * rights[n] * second * second * by_next * rows[1, after]
            pulling += 2 * half[n] * extension * second * by_next * rows[0, after]
    return whole, _wake(energies, 0.5, walls, reach), squares, pulling


@compiled(READ, READ, READ, NUMBER, READ, NUMBER)
def kinetic(
    half: Array, noisy: Array, rates: Array, variance: float, walls: Array, reach: float
) -> tuple[float, float, float, float]:
    """Energy of rotors less that of the noise, its wake, and sums."""
    whole, known, squares = 0.0, 0.0, 0.0
    energies = np.empty(half.size)
    for n in range(half.size):
        energy = half[n] * (rates[n] * rates[n]) - variance * noisy[n]
        energies[n] = energy
        whole += energy
        known += energy * noisy[n]
        squares += noisy[n] * noisy[n]
    return whole, _wake(energies, 0.0, walls, reach), known, squares


@compiled(READ_TABLE, COUNT, COUNT, NUMBER)
def topology(
    rows: Array, before: int, beyond: int, domain: float
) -> tuple[float, float, int, int, float]:
    """Polarisations of both sides and the centre of the zero mode."""
    left, right, first, last = 0.0, 0.0, 0, 0
    squares, moments, square, level = 1.0, 0.0, 1.0, 0
    for n in range(rows.shape[1]):
        a, b = rows[1, n] * rows[1, n], rows[2, n] * rows[2, n]
        strength = (a - b) / max(a + b, _TINY)
        left += strength if n < before else 0.0
        right += strength if n >= beyond else 0.0
        if abs(strength) > domain:
            last = 1 if strength > 0 else -1
            first = first if first else last
        # t_n^2, in units of 1e150 to the power of the level below or above the largest so far.
        square *= min(max(max(a, _TINY) / max(b, _TINY), 1 / _LARGE), _LARGE)
        if square > _LARGE:
            square, level = square / _LARGE, level + 1
        elif square < 1 / _LARGE:
            square, level = square * _LARGE, level - 1
        if level > 0:
            squares, moments, level = squares / _LARGE, moments / _LARGE, 0
        if level >= -1:
            share = square if level == 0 else square / _LARGE
            squares += share
            moments += (n + 1) * share
    return left, right, first, last, moments / squares


@compiled(READ, READ_TABLE, READ, COUNT, COUNT, NUMBER, NUMBER, NUMBER, NUMBER)
def contraction_sums(
    angles: Array,
    table: Array,
    offsets: Array,
    begin: int,
    end: int,
    centre: float,
    gamma: float,
    step: float,
    half: float,
) -> tuple[float, float, float, float, float]:
    """Sums of the least squares of the contraction."""
    places, both, logs, of_place, of_log = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(begin, end):
        if not math.isfinite(angles[n]):
            continue
        distance = min(max(gamma * (centre - n), -half * step), half * step)
        steps = distance * (1 / step)
        nearest = np.rint(steps)
        beyond = (steps - nearest) * step
        at = int(nearest + offsets[n])
        bent = beyond * table[2, at]
        left = angles[n] - (table[0, at] + beyond * (table[1, at] + 0.5 * bent))
        left -= _WHOLE * np.rint(left * _SHARE_OF_A_TURN)
        slope = table[1, at] + bent
        by_log = distance * slope
        places += slope * slope
        both += slope * by_log
        logs += by_log * by_log
        of_place += slope * left
        of_log += by_log * left
    return places, both, logs, of_place, of_log
