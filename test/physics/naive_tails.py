# SPDX-License-Identifier: Apache-2.0
"""Naive twins, in numpy, of the loops over the tails of a wall: same arguments."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from soliton_linkage.estimation.loops.tail_loops import Records
from soliton_linkage.estimation.loops.wobble_loops import Lengths, Overshoot
from soliton_linkage.linkage.chain import Array, staggered, wrapped

LEAST_LEVER = 1e-9
NO_EVIDENCE = (math.nan, 0.0, math.nan)
NOT_TOLD = (math.nan, math.nan, math.nan)


def bond_of_wall(sines: Array) -> tuple[int, float, float]:
    known = np.where(np.isfinite(sines), sines, 0.0)
    if not len(known):
        return 0, 0.0, 0.0
    before = known.cumsum()
    bond = int(np.abs(before - before[-1] / 2).argmax()) + 1
    if bond == len(known):
        return bond, 0.0, 0.0
    return bond, float(known[bond - 1]), float(known[bond])


def uniform_part(
    angles: Array, sines: Array, cosines: Array, nearest: int, edge: int
) -> tuple[int, float, float, float, float]:
    way = 1 if edge > nearest else -1
    inner, outer = sorted((nearest + way * (abs(edge - nearest) // 2), edge - way))
    half = slice(inner, outer + 1)
    known = np.isfinite(sines[half])
    signs = 1.0 - 2.0 * (np.arange(inner, outer + 1) % 2)
    sine = float(sines[half][known].sum())
    cosine = float((signs * cosines[half])[known].sum())
    mean = math.atan2(sine, cosine)
    apart = wrapped(staggered(angles)[half] - mean)[known]
    return int(np.count_nonzero(known)), sine, cosine, mean, float(apart @ apart)


def tail_products(
    settings: Records,
    angles: Array,
    nearest: int,
    edge: int,
    count: int,
    mean: float,
    handed: float,
    noise: float,
    sums: Array,
) -> None:
    given, rest_angle = settings[0], math.pi / 2 - abs(math.asin(math.cos(mean)))
    if noise > given['noisiest'] * rest_angle:
        return
    flat = max(given['flat_in_noise'] * noise, given['flat'] * rest_angle)
    way, half = (1 if edge > nearest else -1), abs(edge - nearest) // 2
    first, last = sorted((nearest, nearest + way * half))
    theta = staggered(angles)[first : last + 1][::way]
    near = handed * wrapped(theta - mean)
    begin, end = tail_of_side(near, rest_angle, flat)
    end = max(min(end, half), begin)
    inner, outer = near[begin:end], near[begin + 1 : end + 1]
    known = np.isfinite(outer)
    inner, outer = inner[known], outer[known]
    following, _ = next_deviation(inner, rest_angle, 2 * math.sin(rest_angle))
    rows = np.array((inner, inner * inner, outer - following))
    sums += rows @ rows.T / (noise**2 * (given['spread'] + 1 / count))


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
    rotors = np.arange(low, high)
    odd, beyond = rotors % 2, rotors >= middle
    handed = (1.0 - 2.0 * odd) * np.where(beyond & (not spins), -1.0, 1.0)
    phases = math.pi * odd - rest_angle + math.pi * (beyond & spins)
    there, seen = at_rest[low - first : high - first], angles[low:high]
    apart = wrapped((math.pi - seen if np.cos(seen) @ np.cos(there) < 0 else seen) - there)
    expected[:] = wrapped(handed * there + phases)
    measured[:] = expected + handed * apart
    for each in (expected, measured):
        each[: middle - low] = each[: middle - low][::-1].copy()


def next_deviation(inner: Array, rest_angle: float, k: float) -> tuple[Array, Array]:
    lean, up = np.sin(rest_angle + inner), np.cos(rest_angle + inner)
    across = k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / np.hypot(up, across)
    outer = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)) - np.arctan2(across, up)
    sine = np.sin(rest_angle + inner + outer)
    lever = k * np.cos(outer) + sine
    # A bar in line with the outer rotor makes the slope infinite.
    slopes = (k * up - sine) / np.where(lever == 0, LEAST_LEVER, lever)
    return outer - rest_angle, slopes


def tail_of_side(deviations: Array, large: float, small: float) -> tuple[int, int]:
    sizes = np.abs(deviations)
    inside = (sizes > large).nonzero()[0]
    begin = int(inside[-1]) + 1 if len(inside) else 0
    low = (~(sizes[begin:] > small)).nonzero()[0]
    return begin, begin + int(low[0]) if len(low) else len(sizes)


def overshooting(expected: Array, rest_angle: float, calm: float) -> int:
    if calm == 0:
        return int(np.sin(rest_angle + expected).argmax())
    at_rest = np.abs(expected) < calm
    return int(at_rest.argmax()) if at_rest.any() else len(expected) - 1


def tail_sums(
    measured: Array, begin: int, end: int, rest_angle: float, k: float
) -> tuple[float, float, float, float, float]:
    e, outer = measured[begin:end], measured[begin + 1 : end + 1]
    following, slopes = next_deviation(e, rest_angle, k)
    shares = slopes * e
    return (
        float(e @ e),
        float(e @ (outer - following)),
        float(slopes.sum()),
        float(shares @ shares),
        float(shares[1:] @ e[:-1]),
    )


def evidence(
    settings: Records, angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    given = settings[0]
    rotors, fewest = len(angles), given['fewest_rotors']
    bond, before, beyond = bond_of_wall(sines)
    if not fewest < bond < rotors - fewest:
        return NO_EVIDENCE
    left = uniform_part(angles, sines, cosines, bond - 1, 0)
    right = uniform_part(angles, sines, cosines, bond, rotors - 1)
    if min(left[0], right[0]) < 2:
        return NO_EVIDENCE
    spread = math.sqrt((left[4] + right[4]) / (left[0] + right[0] - 2))
    noise = max(noise, spread, given['least_noise'])
    leans = [math.sin(each[3]) * math.sqrt(each[0]) / noise for each in (left, right)]
    if not (leans[0] * leans[1] < 0 and min(map(abs, leans)) > given['leaning']):
        return NO_EVIDENCE
    handed = handed_of(left[1], left[2]), handed_of(right[1], right[2])
    tail_products(settings, angles, bond - 1, 0, left[0], left[3], handed[0], noise, tails)
    tail_products(settings, angles, bond, rotors - 1, right[0], right[3], handed[1], noise, tails)
    lean = math.pi / 2 - (steepness_of(left[3]) + steepness_of(right[3])) / 2
    crossing = bond - 1 + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left[0] + 1 / right[0])
    return crossing, flipping_of(left[3], right[3], variance, given['strongest_frame']), lean


def tail_ratio(settings: Records, tails: Array, rest_angle: float) -> tuple[float, float]:
    if tails[0, 0] <= 0:
        return math.nan, math.inf
    bend = np.diag([1, (rest_angle / settings[0]['bend']) ** 2])
    covariance = np.linalg.inv(tails[:2, :2] + bend)
    neglected = settings[0]['neglected']
    ratio = covariance[0] @ tails[:2, 2]
    return float(ratio), math.hypot(math.sqrt(covariance[0, 0]), neglected)


def half_wavelength(
    measured: Array, begin: int, end: int, rest_angle: float, error: float, bend: float
) -> tuple[float, float]:
    e: list[float] = measured[begin:end].tolist()
    start = max(len(e) - 1, 0)
    while start > 0 and e[start - 1] * e[start] < 0:
        start -= 1
    if len(e) - start < 3:
        return math.nan, math.nan
    zeros = []
    for n, (inner, outer) in enumerate(pairwise(e[start:])):
        step = inner - outer
        by_inner, by_outer = -outer / step**2, inner / step**2
        bent = (bend * inner / rest_angle) ** 2
        weight = 1 / (error**2 * (by_inner**2 + by_outer**2) + bent)
        zeros.append((n, n + inner / step, by_inner, by_outer, bent, weight))
    whole = sum(weight for *_, weight in zeros)
    centre = sum(n * weight for n, *_, weight in zeros) / whole
    distance = scale = variance = of_rotor = 0.0
    for n, zero, by_inner, by_outer, bent, weight in zeros:
        share = (n - centre) * weight
        distance += share * zero
        scale += share * (n - centre)
        variance += (error * (of_rotor + share * by_inner)) ** 2 + share**2 * bent
        of_rotor = share * by_outer
    variance += (error * of_rotor) ** 2
    return distance / scale, variance / scale**2


def wobble(
    settings: Records,
    bars: Records,
    angles: Array,
    at_rest: Array,
    first: int,
    place: float,
    noise: float,
    lasting: float,
) -> tuple[Overshoot, Lengths]:
    given = settings[0]
    length, spacing, rest_angle, lean_ratio, turns = bars[0]
    spins = turns > 0
    k, exact = spacing / length, (1 - lean_ratio) / (1 + lean_ratio)
    error = math.hypot(noise, lasting)
    calm = 0.0 if lean_ratio > 1 else max(noise, given['calm'] * rest_angle)
    low, high = max(first, 1), min(first + len(at_rest), len(angles) - 1)
    middle = min(max(math.floor(place) + 1, low), high)
    expected, measured = np.empty((2, high - low))
    beside_wall(angles, at_rest, first, low, middle, high, spins, rest_angle, expected, measured)
    overshoots = []
    square = product = variance = weight = distance = 0.0
    for of_side in (slice(0, middle - low), slice(middle - low, high - low)):
        there, seen = expected[of_side], measured[of_side]
        told = not spins and len(there) > 0
        found = overshoot_of(there, seen, rest_angle, length, calm, error) if told else NOT_TOLD
        overshoots.append(found)
        begin, end = tail_of_side(
            there, given['largest'] * rest_angle, given['above_noise'] * noise
        )
        sums = tail_sums(seen, begin, min(end, len(seen) - 1), rest_angle, k)
        square += sums[0]
        product += sums[1] + sums[2] * noise**2
        variance += sums[0] + sums[3] - 2 * sums[4]
        half, of_half = half_wavelength(seen, begin, end, rest_angle, error, given['bend'])
        if math.isfinite(half):
            weight += 1 / of_half
            distance += half / of_half
    overshoot = max(overshoots, key=lambda each: np.nan_to_num(each[2], nan=-np.inf))
    tails = decay = zeros = (math.nan, math.nan)
    if square > 0:
        tails = exact + product / square, error * math.sqrt(max(variance, 0.0)) / square
        certain = abs(exact) > given['certain'] * tails[1] and 0 < abs(tails[0]) < 1
        coarse = tails[1] > given['coarsest'] * abs(exact) * abs(math.log(abs(exact)))
        if certain and not coarse:
            falls = -1 / math.log(abs(tails[0]))
            decay = spacing * falls, spacing * falls**2 * tails[1] / abs(tails[0])
    if weight > 0:
        zeros = 2 * spacing * distance / weight, 2 * spacing / math.sqrt(weight)
    return overshoot, (*tails, *decay, *zeros)


def overshoot_of(
    expected: Array, measured: Array, rest_angle: float, length: float, calm: float, error: float
) -> Overshoot:
    at = overshooting(expected, rest_angle, calm)
    seen, there = rest_angle + float(measured[at]), rest_angle + float(expected[at])
    lean = length * math.sin(rest_angle)
    return (
        length * math.sin(seen) - lean,
        length * abs(math.cos(there)) * error,
        length * math.sin(there) - lean,
    )


def handed_of(sine: float, cosine: float) -> float:
    return 1.0 if (sine > 0) == (cosine > 0) else -1.0


def steepness_of(mean: float) -> float:
    return abs(math.asin(math.cos(mean)))


def flipping_of(left: float, right: float, variance: float, strongest: float) -> float:
    flipped = math.remainder(right + left, 2 * math.pi) ** 2
    spun = math.remainder(right - left - math.pi, 2 * math.pi) ** 2
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return float(min(max(likelihood, -strongest), strongest))


def observe(
    settings: Records,
    angles: Array,
    noise: float,
    flipping: float,
    rest_angle: float,
    tails: Array,
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    of_frame = np.zeros((3, 3))
    sines, cosines = np.sin(angles), np.cos(angles)
    place, more, lean = evidence(settings, angles, sines, cosines, noise, of_frame)
    weights = np.array([tails[0, 0], of_frame[0, 0] + 1e-300])
    known = np.isfinite([rest_angle, lean])
    if known.any():
        rest_angle = float(np.average(np.array([rest_angle, lean])[known], weights=weights[known]))
    tails += of_frame
    strongest = settings[0]['strongest']
    both = min(max(flipping + more, -strongest), strongest), rest_angle
    return (place, *both), tail_ratio(settings, tails, both[1])
