# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the analysis of a frame; `frame_arrays` says what they compute."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.chain import Array
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

Flags = NDArray[np.bool_]

_WHOLE = 2 * math.pi
_SHARE_OF_A_TURN = 0.5 / math.pi
_TINY = float(np.finfo(np.float64).tiny)
_LARGE = 1e150
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
) -> tuple[tuple[int, int, int], bool, tuple[float, float, float]]:
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
    return (known, excluded, counted), strange, (information, ahead, squares)


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


@compiled(READ)
def bond_of_wall(sines: Array) -> tuple[int, float, float]:
    """Number of rotors before the wall, and the sines of its two rotors."""
    whole, running, most, bond = 0.0, 0.0, -1.0, 0
    for n in range(sines.size):
        whole += sines[n] if math.isfinite(sines[n]) else 0.0
    for n in range(sines.size):
        running += sines[n] if math.isfinite(sines[n]) else 0.0
        apart = abs(running - whole / 2)
        if apart > most:
            most, bond = apart, n + 1
    if not 0 < bond < sines.size:
        return bond, 0.0, 0.0
    left, right = sines[bond - 1], sines[bond]
    return (
        bond,
        left if math.isfinite(left) else 0.0,
        right if math.isfinite(right) else 0.0,
    )


@compiled(READ, COUNT)
def _staggered(angles: Array, n: int) -> float:
    return float(math.pi - angles[n] if n % 2 else angles[n])


@compiled(READ, READ, READ, COUNT, COUNT)
def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> tuple[int, float, float, float, float]:
    """Mean and scatter of the outer half of one side of a wall."""
    way = 1 if edge > nearest else -1
    inner = nearest + way * (abs(edge - nearest) // 2)
    low, high = (inner, edge) if way > 0 else (edge + 1, inner + 1)
    count, sine, cosine = 0, 0.0, 0.0
    for n in range(low, high):
        if math.isfinite(sines[n]):
            count += 1
            sine += sines[n]
            cosine += -cosines[n] if n % 2 else cosines[n]
    mean, scatter = math.atan2(sine, cosine), 0.0
    for n in range(low, high):
        apart = _staggered(angles, n) - mean
        apart -= _WHOLE * np.rint(apart * _SHARE_OF_A_TURN)
        if math.isfinite(apart):
            scatter += apart * apart
    return count, sine, cosine, mean, scatter


@compiled(READ, COUNT, COUNT, NUMBER, NUMBER, COUNT)
def _deviation(
    angles: Array, nearest: int, way: int, mean: float, handed: float, beyond: int
) -> float:
    apart = _staggered(angles, nearest + way * beyond) - mean
    return float(handed * (apart - _WHOLE * np.rint(apart * _SHARE_OF_A_TURN)))


@compiled(NUMBER, NUMBER, NUMBER)
def _next_deviation(inner: float, rest_angle: float, k: float) -> tuple[float, float]:
    lean, up = math.sin(rest_angle + inner), math.cos(rest_angle + inner)
    across = k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / math.hypot(up, across)
    outer = math.acos(min(max(cosine, -1.0), 1.0)) - math.atan2(across, up)
    sine = math.sin(rest_angle + inner + outer)
    lever = k * math.cos(outer) + sine
    return outer - rest_angle, (k * up - sine) / (lever if lever else _LEAST_LEVER)


@compiled(READ, COUNT, COUNT, NUMBER, NUMBER, NUMBER, NUMBER, TABLE)
def tail_products(
    angles: Array,
    nearest: int,
    edge: int,
    mean: float,
    handed: float,
    rest_angle: float,
    flat: float,
    sums: Array,
) -> None:
    """Add up products of deviations outwards from a wall."""
    way, half = 1 if edge > nearest else -1, abs(edge - nearest) // 2
    begin = 0
    for n in range(half + 1):
        if _deviation(angles, nearest, way, mean, handed, n) <= -rest_angle:
            begin = n + 1
    end = begin
    while end < half and abs(_deviation(angles, nearest, way, mean, handed, end)) > flat:
        end += 1
    k = 2 * math.sin(rest_angle)
    for n in range(begin, end):
        e = _deviation(angles, nearest, way, mean, handed, n)
        outer = _deviation(angles, nearest, way, mean, handed, n + 1)
        if math.isfinite(outer):
            beyond = outer - _next_deviation(e, rest_angle, k)[0]
            row = (e, e * e, beyond)
            for i in range(3):
                for j in range(3):
                    sums[i, j] += row[i] * row[j]


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
def springs(sines: Array, cosines: Array, parameters: Array, periodic: bool, rows: Array) -> None:
    """Extensions and levers of springs."""
    rotors = sines.size
    for n in range(rotors - 1):
        _spring(sines, cosines, parameters, n, n + 1, rows)
    if periodic:
        _spring(sines, cosines, parameters, rotors - 1, 0, rows)


@compiled(READ_TABLE, READ, READ, READ, YES, NUMBER, ROW)
def elastic(
    rows: Array,
    half: Array,
    lefts: Array,
    rights: Array,
    periodic: bool,
    variance: float,
    energies: Array,
) -> tuple[float, float, float]:
    """Energies of springs less that of the noise, and sums."""
    whole, squares, pulling = 0.0, 0.0, 0.0
    count = half.size
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
    return whole, squares, pulling


@compiled(READ, READ, READ, NUMBER, ROW)
def kinetic(
    half: Array, noisy: Array, rates: Array, variance: float, energies: Array
) -> tuple[float, float, float]:
    """Energies of rotors less that of the noise, and sums."""
    whole, known, squares = 0.0, 0.0, 0.0
    for n in range(half.size):
        energy = half[n] * (rates[n] * rates[n]) - variance * noisy[n]
        energies[n] = energy
        whole += energy
        known += energy * noisy[n]
        squares += noisy[n] * noisy[n]
    return whole, known, squares


@compiled(READ, COUNT, COUNT)
def total(values: Array, begin: int, end: int) -> float:
    """Sum of some of a row."""
    whole = 0.0
    for n in range(begin, end):
        whole += values[n]
    return whole


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


@compiled(READ, READ, COUNT, COUNT, COUNT, COUNT, YES, NUMBER, ROW, ROW)
def beside_wall(
    angles: Array,
    at_rest: Array,
    first: int,
    low: int,
    middle: int,
    high: int,
    spins: bool,
    rest_angle: float,
    expected: Array,
    measured: Array,
) -> None:
    """Leans beside a wall at rest, and as they are measured."""
    alike = 0.0
    for n in range(low, high):
        alike += math.cos(angles[n]) * math.cos(at_rest[n - first])
    for n in range(low, high):
        before, odd = n < middle, n % 2 == 1
        place = middle - 1 - n if before else n - low
        handed = -1.0 if odd else 1.0
        phase = (math.pi if odd else 0.0) - rest_angle
        if not before:
            handed = handed if spins else -handed
            phase += math.pi if spins else 0.0
        there = at_rest[n - first]
        apart = (math.pi - angles[n] if alike < 0 else angles[n]) - there
        apart -= _WHOLE * np.rint(apart * _SHARE_OF_A_TURN)
        lean = handed * there + phase
        lean -= _WHOLE * np.rint(lean * _SHARE_OF_A_TURN)
        expected[place] = lean
        measured[place] = lean + handed * apart


@compiled(READ, NUMBER, NUMBER)
def tail_of_side(expected: Array, large: float, small: float) -> tuple[int, int]:
    """First rotor in the tail, and the first beyond."""
    begin = 0
    for n in range(expected.size):
        if abs(expected[n]) > large:
            begin = n + 1
    end = begin
    while end < expected.size and abs(expected[end]) > small:
        end += 1
    return begin, end


@compiled(READ, NUMBER, NUMBER)
def overshooting(expected: Array, rest_angle: float, calm: float) -> int:
    """Rotor whose overshoot is told."""
    at, most = 0, -math.inf
    for n in range(expected.size):
        if calm > 0:
            at = n
            if abs(expected[n]) < calm:
                break
        elif math.sin(rest_angle + expected[n]) > most:
            at, most = n, math.sin(rest_angle + expected[n])
    return at


@compiled(READ, COUNT, COUNT, NUMBER, NUMBER)
def tail_sums(
    measured: Array, begin: int, end: int, rest_angle: float, k: float
) -> tuple[float, float, float, float, float]:
    """Sums over a tail for the ratio of its deviations."""
    square, product, slopes, squares, both = 0.0, 0.0, 0.0, 0.0, 0.0
    share = 0.0
    for n in range(begin, end):
        following, slope = _next_deviation(measured[n], rest_angle, k)
        e = measured[n]
        square += e * e
        product += e * (measured[n + 1] - following)
        slopes += slope
        if n > begin:
            both += slope * e * measured[n - 1]
        share = slope * e
        squares += share * share
    return square, product, slopes, squares, both
