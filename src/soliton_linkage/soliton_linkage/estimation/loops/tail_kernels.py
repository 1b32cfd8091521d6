# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the tails of a wall; `tail_arrays` says what they compute."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import (
    BOX,
    COUNT,
    NUMBER,
    READ,
    READ_BOX,
    ROW,
    TABLE,
    YES,
    compiled,
)
from soliton_linkage.estimation.loops.tail_arrays import (
    ABOVE_NOISE,
    BEND,
    FEWEST,
    FINEST,
    FLAT,
    FLAT_IN_NOISE,
    FREEDOM_OF_BEND,
    LARGEST,
    LEANING,
    LEAST_LEVER,
    NEGLECTED,
    NO_EVIDENCE,
    NOISIEST,
    NOT_TOLD,
    SPREAD,
    STRONGEST,
    STRONGEST_FRAME,
)
from soliton_linkage.linkage.chain import Array

_WHOLE = 2 * math.pi
_SHARE_OF_A_TURN = 0.5 / math.pi

_Overshoot = tuple[float, float, float]


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
    return outer - rest_angle, (k * up - sine) / (lever if lever else LEAST_LEVER)


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


@compiled(NUMBER, NUMBER)
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled(NUMBER)
def _wrapped(angle: float) -> float:
    return float(angle - _WHOLE * np.rint(angle * _SHARE_OF_A_TURN))


@compiled(NUMBER, NUMBER)
def _handed(sine: float, cosine: float) -> float:
    return 1.0 if (sine > 0) == (cosine > 0) else -1.0


@compiled(NUMBER)
def _steepness(mean: float) -> float:
    return abs(math.asin(math.cos(mean)))


@compiled(READ, COUNT, COUNT, COUNT, NUMBER, NUMBER, NUMBER, TABLE)
def _add_tail(
    angles: Array,
    nearest: int,
    edge: int,
    count: int,
    mean: float,
    handed: float,
    noise: float,
    sums: Array,
) -> None:
    rest_angle = math.pi / 2 - _steepness(mean)
    if noise > NOISIEST * rest_angle:
        return
    flat = max(FLAT_IN_NOISE * noise, FLAT * rest_angle)
    tail_products(angles, nearest, edge, mean, handed, rest_angle, flat, sums)
    sums /= noise * noise * (SPREAD + 1 / count)


@compiled(NUMBER, NUMBER, NUMBER)
def _flipping(left: float, right: float, variance: float) -> float:
    flipped, spun = _wrapped(right + left), _wrapped(right - left - math.pi)
    flipped, spun = flipped * flipped, spun * spun
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return float(_limited(likelihood, STRONGEST_FRAME))


@compiled(READ, READ, READ, NUMBER, BOX)
def evidence(
    angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    """Evidence of one frame of the motion."""
    rotors = angles.size
    bond, before, beyond = bond_of_wall(sines)
    if not FEWEST < bond < rotors - FEWEST:
        return NO_EVIDENCE
    left = uniform_part(angles, sines, cosines, bond - 1, 0)
    right = uniform_part(angles, sines, cosines, bond, rotors - 1)
    if min(left[0], right[0]) < 2:
        return NO_EVIDENCE
    spread = math.sqrt((left[4] + right[4]) / (left[0] + right[0] - 2))
    noise = max(noise, spread, FINEST)
    lefts = math.sin(left[3]) * math.sqrt(left[0]) / noise
    rights = math.sin(right[3]) * math.sqrt(right[0]) / noise
    if not (lefts * rights < 0 and min(abs(lefts), abs(rights)) > LEANING):
        return NO_EVIDENCE
    handed = _handed(left[1], left[2]), _handed(right[1], right[2])
    _add_tail(angles, bond - 1, 0, left[0], left[3], handed[0], noise, tails[0])
    _add_tail(angles, bond, rotors - 1, right[0], right[3], handed[1], noise, tails[1])
    lean = math.pi / 2 - (_steepness(left[3]) + _steepness(right[3])) / 2
    crossing = bond - 1 + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left[0] + 1 / right[0])
    return crossing, _flipping(left[3], right[3], variance), lean


@compiled(NUMBER, NUMBER, READ_BOX, NUMBER, NUMBER, READ_BOX, BOX)
def add_evidence(
    flipping: float,
    rest_angle: float,
    tails: Array,
    other_flipping: float,
    other_rest_angle: float,
    other_tails: Array,
    sums: Array,
) -> tuple[float, float]:
    """Evidence of both of two."""
    first, second = tails[0, 0, 0] + tails[1, 0, 0], other_tails[0, 0, 0] + other_tails[1, 0, 0]
    first, second = first + 1e-300, second + 1e-300
    for side in range(2):
        for i in range(3):
            for j in range(3):
                sums[side, i, j] = tails[side, i, j] + other_tails[side, i, j]
    if math.isfinite(rest_angle) and math.isfinite(other_rest_angle):
        mean = (first * rest_angle + second * other_rest_angle) / (first + second)
    else:
        mean = rest_angle if math.isfinite(rest_angle) else other_rest_angle
    return _limited(flipping + other_flipping, STRONGEST), mean


@compiled(READ_BOX, NUMBER)
def tail_ratio(tails: Array, rest_angle: float) -> tuple[float, float]:
    """Ratio of the tails and its standard deviation."""
    known, whole, mean = 0, 0.0, 0.0
    ratios, variances = np.zeros(2), np.zeros(2)
    for sums in tails:
        if sums[0, 0] > 0:
            first, both = sums[0, 0] + 1, sums[0, 1]
            second = sums[1, 1] + (rest_angle / FREEDOM_OF_BEND) ** 2
            determinant = first * second - both * both
            ratios[known] = (second * sums[0, 2] - both * sums[1, 2]) / determinant
            variances[known] = second / determinant
            whole += 1 / variances[known]
            mean += ratios[known] / variances[known]
            known += 1
    if not known:
        return math.nan, math.inf
    ratio, apart = mean / whole, 0.0
    for n in range(known):
        apart += (ratios[n] - ratio) ** 2 / variances[n]
    return ratio, math.sqrt(max(1.0, apart) / whole + NEGLECTED**2)


@compiled(READ, COUNT, COUNT, NUMBER, NUMBER)
def half_wavelength(
    measured: Array, begin: int, end: int, rest_angle: float, error: float
) -> tuple[float, float]:
    """Distance of the zeros of a tail and its variance."""
    start = max(end - 1, begin)
    while start > begin and measured[start - 1] * measured[start] < 0:
        start -= 1
    count = end - start - 1
    if count < 2:
        return math.nan, math.nan
    whole, centre = 0.0, 0.0
    zeros = np.empty((5, count))
    for n in range(count):
        inner, outer = measured[start + n], measured[start + n + 1]
        step = inner - outer
        by_inner, by_outer = -outer / (step * step), inner / (step * step)
        bend = (BEND * inner / rest_angle) ** 2
        weight = 1 / (error * error * (by_inner * by_inner + by_outer * by_outer) + bend)
        zeros[0, n], zeros[1, n], zeros[2, n] = n + inner / step, by_inner, by_outer
        zeros[3, n], zeros[4, n] = bend, weight
        whole += weight
        centre += n * weight
    centre /= whole
    distance, scale, variance, of_rotor = 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        share = (n - centre) * zeros[4, n]
        distance += share * zeros[0, n]
        scale += share * (n - centre)
        variance += (error * (of_rotor + share * zeros[1, n])) ** 2 + share * share * zeros[3, n]
        of_rotor = share * zeros[2, n]
    variance += (error * of_rotor) ** 2
    return distance / scale, variance / (scale * scale)


@compiled(READ, READ, NUMBER, NUMBER, NUMBER, NUMBER)
def _overshoot(
    expected: Array, measured: Array, rest_angle: float, length: float, calm: float, error: float
) -> tuple[float, float, float]:
    if not expected.size:
        return math.nan, math.nan, math.nan
    at = overshooting(expected, rest_angle, calm)
    lean = length * math.sin(rest_angle)
    return (
        length * math.sin(rest_angle + measured[at]) - lean,
        length * abs(math.cos(rest_angle + expected[at])) * error,
        length * math.sin(rest_angle + expected[at]) - lean,
    )


@compiled(READ, READ, COUNT, COUNT, COUNT, COUNT, YES, *(6 * [NUMBER]))
def wobble(
    angles: Array,
    at_rest: Array,
    first: int,
    low: int,
    middle: int,
    high: int,
    spins: bool,
    rest_angle: float,
    length: float,
    k: float,
    calm: float,
    noise: float,
    error: float,
) -> tuple[_Overshoot, _Overshoot, tuple[float, float], tuple[float, float]]:
    """Overshoots, ratio of the tails and distance of their zeros."""
    expected, measured = np.empty(high - low), np.empty(high - low)
    beside_wall(angles, at_rest, first, low, middle, high, spins, rest_angle, expected, measured)
    before, beyond = NOT_TOLD, NOT_TOLD
    square, product, variance, weight, distance = 0.0, 0.0, 0.0, 0.0, 0.0
    for side in range(2):
        split = middle - low
        there = expected[:split] if side == 0 else expected[split:]
        seen = measured[:split] if side == 0 else measured[split:]
        if not spins:
            overshoot = _overshoot(there, seen, rest_angle, length, calm, error)
            before, beyond = (overshoot, beyond) if side == 0 else (before, overshoot)
        begin, end = tail_of_side(there, LARGEST * rest_angle, ABOVE_NOISE * noise)
        sums = tail_sums(seen, begin, min(end, seen.size - 1), rest_angle, k)
        square += sums[0]
        product += sums[1] + sums[2] * noise * noise
        variance += sums[0] + sums[3] - 2 * sums[4]
        half, of_half = half_wavelength(seen, begin, end, rest_angle, error)
        if math.isfinite(half):
            weight += 1 / of_half
            distance += half / of_half
    tails, zeros = (math.nan, math.nan), (math.nan, math.nan)
    if square > 0:
        tails = product / square, error * math.sqrt(max(variance, 0.0)) / square
    if weight > 0:
        zeros = distance / weight, 1 / math.sqrt(weight)
    return before, beyond, tails, zeros
