# SPDX-License-Identifier: Apache-2.0
"""Compiled loops of the analysis of a frame; `frame_arrays` says what they compute; imports numba.

All are compiled when the module is imported, or taken from what an earlier process has compiled,
so that no frame waits for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from soliton_linkage.chain import Array

Flags = NDArray[np.bool_]
Kernel = TypeVar('Kernel', bound=Callable[..., Any])

_NUMBER, _COUNT, _YES = types.float64, types.int64, types.boolean
_READ = types.Array(types.float64, 1, 'C', readonly=True)
_ROW = types.float64[::1]
_READ_TABLE = types.Array(types.float64, 2, 'C', readonly=True)
_TABLE = types.float64[:, ::1]
_READ_FLAGS = types.Array(types.boolean, 1, 'C', readonly=True)
_FLAGS = types.boolean[::1]

_WHOLE = 2 * math.pi
_SHARE_OF_A_TURN = 0.5 / math.pi
_TINY = float(np.finfo(np.float64).tiny)
_LARGE = 1e150
_LEAST_LEVER = 1e-9


def compiled(*arguments: Any) -> Callable[[Kernel], Kernel]:
    """Compile for arguments of these types; products and sums may contract."""

    def compile_or_load(function: Kernel) -> Kernel:
        try:
            return _compiled(function, arguments, cache=True)
        except RuntimeError:  # no folder to cache in can be written
            return _compiled(function, arguments, cache=False)

    return compile_or_load


def _compiled(function: Kernel, arguments: tuple[Any, ...], cache: bool) -> Kernel:
    compiler = numba.njit(
        arguments,
        cache=cache,
        fastmath={'contract', 'nsz'},
        error_model='numpy',
        nogil=True,
    )
    return cast(Kernel, compiler(function))


@compiled(_TABLE, _TABLE, _READ, _READ, _NUMBER, _NUMBER, _NUMBER)
def predict(
    states: Array,
    spreads: Array,
    wander: Array,
    errors: Array,
    elapsed: float,
    kept: float,
    cubed: float,
) -> None:
    for n in range(states.shape[1]):
        states[0, n] += elapsed * states[1, n]
        states[2, n] *= kept
        added = cubed * elapsed * wander[n]
        both, of_rate = spreads[1, n], spreads[3, n]
        spreads[0, n] += elapsed * (2 * both + elapsed * of_rate) + elapsed**2 / 3 * added
        spreads[1, n] = both + elapsed * of_rate + elapsed / 2 * added
        spreads[2, n] = kept * (spreads[2, n] + elapsed * spreads[4, n])
        spreads[3, n] = of_rate + added
        spreads[4, n] *= kept
        spreads[5, n] = kept**2 * spreads[5, n] + errors[n] * (1 - kept**2)


@compiled(_READ_TABLE, _READ_TABLE, _READ)
def expected_measurement(states: Array, spreads: Array, weights: Array) -> tuple[float, float]:
    arc, variance = 0.0, 0.0
    for n in range(weights.size):
        arc += weights[n] * (states[0, n] + states[2, n])
    for n in range(weights.size):
        apart = states[0, n] + states[2, n] - arc
        of_filter = spreads[0, n] + 2 * spreads[2, n] + spreads[5, n]
        variance += weights[n] * (of_filter + apart * apart)
    return arc, variance


@compiled(_TABLE, _TABLE, _READ, _ROW, _ROW, _ROW, _NUMBER, _NUMBER, _NUMBER)
def take_in(
    states: Array,
    spreads: Array,
    weights: Array,
    shares: Array,
    likelihoods: Array,
    odds: Array,
    arc: float,
    variance: float,
    freedoms: float,
) -> tuple[float, float]:
    base = shares.size + 1
    likely = np.empty(weights.size)
    for n in range(weights.size):
        of_arc = spreads[0, n] + spreads[2, n]
        of_rate = spreads[1, n] + spreads[4, n]
        of_error = spreads[2, n] + spreads[5, n]
        whole = of_arc + of_error + variance
        surprise = arc - (states[0, n] + states[2, n])
        square = surprise * surprise / whole
        if freedoms < math.inf:
            square = (freedoms + 1) * math.log1p(square / freedoms)
        likely[n] = -0.5 * (square + math.log(whole))
        by_arc, by_rate, by_error = of_arc / whole, of_rate / whole, of_error / whole
        states[0, n] += by_arc * surprise
        states[1, n] += by_rate * surprise
        states[2, n] += by_error * surprise
        spreads[0, n] -= of_arc * by_arc
        spreads[1, n] -= of_arc * by_rate
        spreads[2, n] -= of_arc * by_error
        spreads[3, n] -= of_rate * by_rate
        spreads[4, n] -= of_rate * by_error
        spreads[5, n] -= of_error * by_error
    top = likely[1]
    for n in range(2, base):
        top = max(top, likely[n])
    together = 0.0
    for n in range(1, base):
        together += shares[n - 1] * math.exp(likely[n] - top)
    against = top + math.log(together) - likely[0]
    above = max(top, likely[0])
    together, whole = 0.0, 0.0
    for n in range(base):
        together += weights[n] * math.exp(likely[n] - above)
        whole += weights[n]
    together = above + math.log(together / whole)
    most = -math.inf
    for n in range(odds.size):
        odds[n] += likely[base + n] - together
        most = max(most, odds[n])
    top = -math.inf
    for n in range(shares.size):
        likelihoods[n] += likely[n + 1]
        top = max(top, likelihoods[n])
    whole = 0.0
    for n in range(shares.size):
        likelihoods[n] -= top
        shares[n] = math.exp(likelihoods[n])
        whole += shares[n]
    for n in range(shares.size):
        shares[n] /= whole
    return against, most


@compiled(_ROW, _READ, _READ, _NUMBER, _NUMBER, _NUMBER)
def weigh(
    weights: Array, shares: Array, odds: Array, against: float, rare: float, none: float
) -> None:
    doubted = 1 / (1 + math.exp(-against))
    base = shares.size + 1
    weights[0] = 1 - doubted
    for n in range(shares.size):
        weights[n + 1] = doubted * shares[n]
    for n in range(odds.size):
        weights[base + n] = math.exp(-rare) * max(math.exp(odds[n]) - math.exp(none), 0.0)
    whole = 0.0
    for n in range(weights.size):
        whole += weights[n]
    for n in range(weights.size):
        weights[n] /= whole


@compiled(_READ, _READ_TABLE, _READ_TABLE, _COUNT, _NUMBER)
def mixture(
    weights: Array, states: Array, spreads: Array, base: int, least: float
) -> tuple[float, float, float, float, float]:
    whole, arc, rate = 0.0, 0.0, 0.0
    of_arc, both, of_rate = 0.0, 0.0, 0.0
    for n in range(weights.size):
        weight = weights[n]
        if n < base or weight >= least:
            whole += weight
            arc += weight * states[0, n]
            rate += weight * states[1, n]
            of_arc += weight * spreads[0, n]
            both += weight * spreads[1, n]
            of_rate += weight * spreads[3, n]
    arc, rate = arc / whole, rate / whole
    for n in range(weights.size):
        weight = weights[n]
        if n < base or weight >= least:
            arcs, rates = states[0, n] - arc, states[1, n] - rate
            of_arc += weight * arcs * arcs
            both += weight * arcs * rates
            of_rate += weight * rates * rates
    return arc, rate, of_arc / whole, both / whole, of_rate / whole


@compiled(_TABLE, _TABLE, _ROW, _ROW, _READ, _COUNT, _NUMBER, _NUMBER)
def suppose_kick(
    states: Array,
    spreads: Array,
    errors: Array,
    odds: Array,
    weights: Array,
    older: int,
    elapsed: float,
    least: float,
) -> None:
    base = weights.size - odds.size
    likeliest = int(np.argmax(weights[:base]))
    for age in range(older, -1, -1):
        source = base + age - 1 if age else likeliest
        for row in range(3):
            states[row, base + age] = states[row, source]
        for row in range(6):
            spreads[row, base + age] = spreads[row, source]
        errors[base + age] = errors[source]
        odds[age] = odds[age - 1] if age else 0.0
    kick = states[1, base] ** 2 + least
    spreads[0, base] += kick * elapsed**2 / 4
    spreads[3, base] += kick


@compiled(_READ, _ROW, _ROW, _ROW)
def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
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


@compiled(_READ, _NUMBER)
def all_within(values: Array, limit: float) -> bool:
    within = True
    for n in range(values.size):
        size = abs(values[n])
        within &= size <= limit and size < math.inf
    return within


@compiled(_READ, _READ, _YES, _READ, _READ, _READ, _COUNT, _ROW)
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
    end = first + about.size
    for n in range(angles.size):
        angle = angles[n] - corrections[n]
        if upside_down:
            angle = math.pi - angle
        expected = before[n] if n < first else about[n - first] if n < end else beyond[n]
        apart = angle - expected
        differences[n] = apart - _WHOLE * np.rint(apart * _SHARE_OF_A_TURN)


@compiled(_ROW, _COUNT, _READ, _NUMBER, _NUMBER, _NUMBER, _READ_FLAGS, _FLAGS, _FLAGS, _ROW)
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
) -> tuple[int, int, int, bool, float, float]:
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
    for n in range(count):
        differences[first + n] -= ahead * tangent[n]
        left[n] = differences[first + n] if used[n] else 0.0
    return known, excluded, counted, strange, information, ahead


@compiled(_READ, _READ, _READ, _READ)
def products_in_time(
    oldest: Array, older: Array, left: Array, tangent: Array
) -> tuple[float, float, float, float]:
    whole, wall, free, chance = 0.0, 0.0, 0.0, 0.0
    for n in range(left.size):
        product = left[n] * (older[n] * (4 / 3) - oldest[n] / 3)
        share = tangent[n] * tangent[n]
        alone = share - share * share
        whole += product
        wall += share * product
        free += alone
        chance += alone * alone
    return whole, wall, free, chance


@compiled(_READ, _READ_TABLE, _COUNT, _NUMBER, _ROW)
def spline(knots: Array, coefficients: Array, degree: int, at: float, values: Array) -> None:
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


@compiled(_READ)
def bond_of_wall(sines: Array) -> tuple[int, float, float]:
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


@compiled(_READ, _COUNT)
def _staggered(angles: Array, n: int) -> float:
    return math.pi - angles[n] if n % 2 else angles[n]


@compiled(_READ, _READ, _READ, _COUNT, _COUNT)
def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> tuple[int, float, float, float, float]:
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


@compiled(_READ, _COUNT, _COUNT, _NUMBER, _NUMBER, _COUNT)
def _deviation(
    angles: Array, nearest: int, way: int, mean: float, handed: float, beyond: int
) -> float:
    apart = _staggered(angles, nearest + way * beyond) - mean
    return handed * (apart - _WHOLE * np.rint(apart * _SHARE_OF_A_TURN))


@compiled(_NUMBER, _NUMBER, _NUMBER)
def _following(inner: float, rest_angle: float, k: float) -> tuple[float, float]:
    lean, up = math.sin(rest_angle + inner), math.cos(rest_angle + inner)
    across = k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / math.hypot(up, across)
    outer = math.acos(min(max(cosine, -1.0), 1.0)) - math.atan2(across, up)
    sine = math.sin(rest_angle + inner + outer)
    lever = k * math.cos(outer) + sine
    return outer - rest_angle, (k * up - sine) / (lever if lever else _LEAST_LEVER)


@compiled(_READ, _COUNT, _COUNT, _NUMBER, _NUMBER, _NUMBER, _NUMBER, _TABLE)
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
            beyond = outer - _following(e, rest_angle, k)[0]
            row = (e, e * e, beyond)
            for i in range(3):
                for j in range(3):
                    sums[i, j] += row[i] * row[j]


@compiled(_READ, _READ, _READ_TABLE, _COUNT, _COUNT, _TABLE)
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


@compiled(_READ, _READ, _READ_TABLE, _YES, _TABLE)
def springs(
    sines: Array, cosines: Array, parameters: Array, periodic: bool, rows: Array
) -> None:
    rotors = sines.size
    for n in range(rotors - 1):
        _spring(sines, cosines, parameters, n, n + 1, rows)
    if periodic:
        _spring(sines, cosines, parameters, rotors - 1, 0, rows)


@compiled(_READ_TABLE, _READ, _READ, _READ, _YES, _NUMBER, _ROW)
def elastic(
    rows: Array,
    half: Array,
    lefts: Array,
    rights: Array,
    periodic: bool,
    variance: float,
    energies: Array,
) -> tuple[float, float, float]:
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


@compiled(_READ, _READ, _READ, _NUMBER, _ROW)
def kinetic(
    half: Array, noisy: Array, rates: Array, variance: float, energies: Array
) -> tuple[float, float, float]:
    whole, known, squares = 0.0, 0.0, 0.0
    for n in range(half.size):
        energy = half[n] * (rates[n] * rates[n]) - variance * noisy[n]
        energies[n] = energy
        whole += energy
        known += energy * noisy[n]
        squares += noisy[n] * noisy[n]
    return whole, known, squares


@compiled(_READ, _COUNT, _COUNT)
def total(values: Array, begin: int, end: int) -> float:
    whole = 0.0
    for n in range(begin, end):
        whole += values[n]
    return whole


@compiled(_READ_TABLE, _COUNT, _COUNT, _NUMBER)
def topology(
    rows: Array, before: int, beyond: int, domain: float
) -> tuple[float, float, int, int, float]:
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


@compiled(_READ, _READ_TABLE, _READ, _COUNT, _COUNT, _NUMBER, _NUMBER, _NUMBER, _NUMBER)
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


@compiled(_READ, _READ, _COUNT, _COUNT, _COUNT, _COUNT, _YES, _NUMBER, _ROW, _ROW)
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


@compiled(_READ, _NUMBER, _NUMBER)
def tail_of_side(expected: Array, large: float, small: float) -> tuple[int, int]:
    begin = 0
    for n in range(expected.size):
        if abs(expected[n]) > large:
            begin = n + 1
    end = begin
    while end < expected.size and abs(expected[end]) > small:
        end += 1
    return begin, end


@compiled(_READ, _COUNT, _COUNT, _NUMBER, _NUMBER)
def tail_sums(
    measured: Array, begin: int, end: int, rest_angle: float, k: float
) -> tuple[float, float, float, float, float]:
    square, product, slopes, squares, both = 0.0, 0.0, 0.0, 0.0, 0.0
    share = 0.0
    for n in range(begin, end):
        following, slope = _following(measured[n], rest_angle, k)
        e = measured[n]
        square += e * e
        product += e * (measured[n + 1] - following)
        slopes += slope
        if n > begin:
            both += slope * e * measured[n - 1]
        share = slope * e
        squares += share * share
    return square, product, slopes, squares, both
