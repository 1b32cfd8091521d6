# SPDX-License-Identifier: Apache-2.0
"""What the tails of a wall tell, in numpy; `tail_kernels` compiles it.

The functions of both modules are the same but for rounding. Frames are actual angles [rad],
shape (N,), NaN where unknown, with their sines and cosines. Deviations e are those of the angle
by which a rotor leans from that of the uniform state [rad].
"""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Array, staggered, wrapped

LEAST_LEVER = 1e-9
FEWEST = 4
LEANING = 3.0
FINEST = 1e-6
STRONGEST_FRAME = 10.0
STRONGEST = 30.0
FLAT = 0.02
FLAT_IN_NOISE = 2.0
NOISIEST = 0.15
FREEDOM_OF_BEND = 0.1
SPREAD = 1.2
NEGLECTED = 0.01
ABOVE_NOISE = 4.0
LARGEST = 0.5
BEND = 0.3
NO_EVIDENCE = (math.nan, 0.0, math.nan)
NOT_TOLD = (math.nan, math.nan, math.nan)

_Overshoot = tuple[float, float, float]


@cache
def tail_loops() -> Any:
    """Return the module `tail_kernels` or, where numba is absent, this one."""
    try:
        from soliton_linkage.estimation.loops import tail_kernels
    except ImportError:
        from soliton_linkage.estimation.loops import tail_arrays

        return tail_arrays
    return tail_kernels


def bond_of_wall(sines: Array) -> tuple[int, float, float]:
    """Number of rotors before the wall, and the sines of its two rotors, 0 where unknown.

    There the means of sin(theta) before and beyond differ the most.
    """
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
    """Outer half of the rotors from the nearest to a wall to that at an edge, which is left out.

    Returns how many of them are known, the sums of sin(theta) and cos(theta), their mean angle
    theta [rad] and the sum of squares of what they differ from it [rad^2].
    """
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
    angles: Array,
    nearest: int,
    edge: int,
    mean: float,
    handed: float,
    rest_angle: float,
    flat: float,
    sums: Array,
) -> None:
    """Add up products of (e, e^2, e' - F(e)) outwards from a wall, shape (3, 3).

    The deviation e of a rotor is handed (theta - mean) [rad]; they count from the middle of the
    wall on, as far as they are not flat, in the inner half of the rotors up to an edge.
    """
    way, half = (1 if edge > nearest else -1), abs(edge - nearest) // 2
    first, last = sorted((nearest, nearest + way * half))
    theta = staggered(angles)[first : last + 1][::way]
    near = handed * wrapped(theta - mean)
    core = (near <= -rest_angle).nonzero()[0]
    begin = int(core[-1]) + 1 if len(core) else 0
    calm = (~(np.abs(near[begin:-1]) > flat)).nonzero()[0]
    end = begin + int(calm[0]) if len(calm) else max(half, begin)
    inner, outer = near[begin:end], near[begin + 1 : end + 1]
    known = np.isfinite(outer)
    inner, outer = inner[known], outer[known]
    following, _ = next_deviation(inner, rest_angle, 2 * math.sin(rest_angle))
    rows = np.array((inner, inner * inner, outer - following))
    sums += rows @ rows.T


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
    """Leans beside a wall less that of the uniform state [rad], outwards, first those before it.

    They are of the rotors from low to high, before and beyond the middle, where the wall at
    rest, with the angles of its rotors from the first on, has them and as they are measured.
    """
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
    """Deviation F of the outer neighbour on relaxed bars [rad], k = a / r, and its slope [1].

    See `motion_class.next_deviation`.
    """
    lean, up = np.sin(rest_angle + inner), np.cos(rest_angle + inner)
    across = k + lean
    cosine = (math.cos(2 * rest_angle) - k * lean) / np.hypot(up, across)
    outer = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0)) - np.arctan2(across, up)
    sine = np.sin(rest_angle + inner + outer)
    lever = k * np.cos(outer) + sine
    # A bar in line with the outer rotor makes the slope infinite.
    slopes = (k * up - sine) / np.where(lever == 0, LEAST_LEVER, lever)
    return outer - rest_angle, slopes


def tail_of_side(expected: Array, large: float, small: float) -> tuple[int, int]:
    """First rotor beyond all whose deviation is large [rad], and the next one that is small."""
    sizes = np.abs(expected)
    inside = (sizes > large).nonzero()[0]
    begin = int(inside[-1]) + 1 if len(inside) else 0
    low = (sizes[begin:] <= small).nonzero()[0]
    return begin, begin + int(low[0]) if len(low) else len(sizes)


def overshooting(expected: Array, rest_angle: float, calm: float) -> int:
    """Number of the rotor that leans the most or, where any is calm [rad], of the first of them.

    Without wobble, for calm > 0, it is the last rotor where none is calm.
    """
    if calm == 0:
        return int(np.sin(rest_angle + expected).argmax())
    at_rest = np.abs(expected) < calm
    return int(at_rest.argmax()) if at_rest.any() else len(expected) - 1


def tail_sums(
    measured: Array, begin: int, end: int, rest_angle: float, k: float
) -> tuple[float, float, float, float, float]:
    """Sums over a tail of e^2, e (e' - F(e)), F'(e), (F'(e) e)^2 and F'(e) e times e before."""
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
    angles: Array, sines: Array, cosines: Array, noise: float, tails: Array
) -> tuple[float, float, float]:
    """Place, flipping and angle at rest of `MotionEvidence` of one frame; see there.

    The noise is a lower bound [rad]. Tails, shape (2, 3, 3), are 0, and are set.
    """
    rotors = len(angles)
    bond, before, beyond = bond_of_wall(sines)
    if not FEWEST < bond < rotors - FEWEST:
        return NO_EVIDENCE
    left = uniform_part(angles, sines, cosines, bond - 1, 0)
    right = uniform_part(angles, sines, cosines, bond, rotors - 1)
    if min(left[0], right[0]) < 2:
        return NO_EVIDENCE
    spread = math.sqrt((left[4] + right[4]) / (left[0] + right[0] - 2))
    noise = max(noise, spread, FINEST)
    leans = [math.sin(each[3]) * math.sqrt(each[0]) / noise for each in (left, right)]
    if not (leans[0] * leans[1] < 0 and min(map(abs, leans)) > LEANING):
        return NO_EVIDENCE
    handed = _handed(left[1], left[2]), _handed(right[1], right[2])
    _add_tail(angles, bond - 1, 0, left[0], left[3], handed[0], noise, tails[0])
    _add_tail(angles, bond, rotors - 1, right[0], right[3], handed[1], noise, tails[1])
    lean = math.pi / 2 - (_steepness(left[3]) + _steepness(right[3])) / 2
    crossing = bond - 1 + (before / (before - beyond) if before * beyond < 0 else 0.5)
    variance = noise * noise * (1 / left[0] + 1 / right[0])
    return crossing, _flipping(left[3], right[3], variance), lean


def add_evidence(
    flipping: float,
    rest_angle: float,
    tails: Array,
    other_flipping: float,
    other_rest_angle: float,
    other_tails: Array,
    sums: Array,
) -> tuple[float, float]:
    """Flipping and angle at rest of two evidences together, and the sums of their tails.

    Angles, NaN where unknown, weigh as much as the tails tell; never quite nothing.
    """
    sums[:] = tails + other_tails
    each = ((tails, rest_angle), (other_tails, other_rest_angle))
    known = [(1e-300 + float(t[0, 0, 0] + t[1, 0, 0]), a) for t, a in each if math.isfinite(a)]
    whole = sum(weight for weight, _ in known)
    mean = sum(weight * angle for weight, angle in known) / whole if known else math.nan
    return min(max(flipping + other_flipping, -STRONGEST), STRONGEST), mean


def tail_ratio(tails: Array, rest_angle: float) -> tuple[float, float]:
    """Ratio lambda of the tails and its standard deviation [1]; NaN and infinity if unknown.

    Mean of both sides. Where they differ by more than they should, the deviation is as much
    larger. What springs in motion may do to it counts as 0.01.
    """
    sums: list[list[list[float]]] = tails.tolist()
    sides = [_solved(each, rest_angle) for each in sums if each[0][0] > 0]
    if not sides:
        return math.nan, math.inf
    variance = 1 / sum(1 / of_side for _, of_side in sides)
    ratio = variance * sum(each / of_side for each, of_side in sides)
    apart = sum((each - ratio) ** 2 / of_side for each, of_side in sides)
    return ratio, math.sqrt(variance * max(1.0, apart) + NEGLECTED**2)


def half_wavelength(
    measured: Array, begin: int, end: int, rest_angle: float, error: float
) -> tuple[float, float]:
    """Distance of the zeros of a tail [rotor spacings] and its variance; NaN for none.

    The tail is drawn straight from rotor to rotor, where it changes its sign at each. Weights
    are those of the noise and of how far a large deviation moves a zero, 0.3 e / theta_bar.
    """
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
        bend = (BEND * inner / rest_angle) ** 2
        weight = 1 / (error**2 * (by_inner**2 + by_outer**2) + bend)
        zeros.append((n, n + inner / step, by_inner, by_outer, bend, weight))
    whole = sum(weight for *_, weight in zeros)
    centre = sum(n * weight for n, *_, weight in zeros) / whole
    distance = scale = variance = of_rotor = 0.0
    for n, zero, by_inner, by_outer, bend, weight in zeros:
        share = (n - centre) * weight
        distance += share * zero
        scale += share * (n - centre)
        variance += (error * (of_rotor + share * by_inner)) ** 2 + share**2 * bend
        of_rotor = share * by_outer
    variance += (error * of_rotor) ** 2
    return distance / scale, variance / scale**2


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
    """Overshoots, ratio of the tails and distance of their zeros; see `WobbleReporter.wobble`.

    The wall is that of `beside_wall`; noise and error, with what lasts, are those of the angles
    [rad], rotors have a length [m] and the pitch k = a / r. Overshoots are, before and beyond,
    that measured, its deviation, and that at rest [m], NaN of spinners and of no rotor. Of the
    ratio it is what it differs from the exact one, with its deviation [1]; zeros [rotor
    spacings] are half a wavelength apart, also with a deviation. NaN where they are not told.
    """
    expected, measured = np.empty(high - low), np.empty(high - low)
    beside_wall(angles, at_rest, first, low, middle, high, spins, rest_angle, expected, measured)
    overshoots = []
    square = product = variance = weight = distance = 0.0
    for of_side in (slice(0, middle - low), slice(middle - low, high - low)):
        there, seen = expected[of_side], measured[of_side]
        told = not spins and len(there) > 0
        found = _overshoot(there, seen, rest_angle, length, calm, error) if told else NOT_TOLD
        overshoots.append(found)
        begin, end = tail_of_side(there, LARGEST * rest_angle, ABOVE_NOISE * noise)
        sums = tail_sums(seen, begin, min(end, len(seen) - 1), rest_angle, k)
        square += sums[0]
        product += sums[1] + sums[2] * noise**2
        variance += sums[0] + sums[3] - 2 * sums[4]
        half, of_half = half_wavelength(seen, begin, end, rest_angle, error)
        if math.isfinite(half):
            weight += 1 / of_half
            distance += half / of_half
    before, beyond = overshoots
    tails = zeros = (math.nan, math.nan)
    if square > 0:
        tails = product / square, error * math.sqrt(max(variance, 0.0)) / square
    if weight > 0:
        zeros = distance / weight, 1 / math.sqrt(weight)
    return before, beyond, tails, zeros


def _overshoot(
    expected: Array, measured: Array, rest_angle: float, length: float, calm: float, error: float
) -> _Overshoot:
    at = overshooting(expected, rest_angle, calm)
    seen, there = rest_angle + float(measured[at]), rest_angle + float(expected[at])
    lean = length * math.sin(rest_angle)
    return (
        length * math.sin(seen) - lean,
        length * abs(math.cos(there)) * error,
        length * math.sin(there) - lean,
    )


def _handed(sine: float, cosine: float) -> float:
    return 1.0 if (sine > 0) == (cosine > 0) else -1.0


def _steepness(mean: float) -> float:
    """Angle of a uniform part above or below the horizontal [rad]."""
    return abs(math.asin(math.cos(mean)))


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
    """Add products of (e, e^2, e' - F(e)) over the variance of e', shape (3, 3)."""
    rest_angle = math.pi / 2 - _steepness(mean)
    if noise > NOISIEST * rest_angle:
        return
    flat = max(FLAT_IN_NOISE * noise, FLAT * rest_angle)
    tail_products(angles, nearest, edge, mean, handed, rest_angle, flat, sums)
    sums /= noise**2 * (SPREAD + 1 / count)


def _flipping(left: float, right: float, variance: float) -> float:
    """Log likelihood of theta_right = -theta_left less that of theta_left + pi, for a frame.

    Where neither is met to within the noise, as in a wake or with deviations, the variance is
    what the better of the two needs.
    """
    flipped = math.remainder(right + left, 2 * math.pi) ** 2
    spun = math.remainder(right - left - math.pi, 2 * math.pi) ** 2
    likelihood = (spun - flipped) / (2 * max(variance, min(flipped, spun)))
    return float(min(max(likelihood, -STRONGEST_FRAME), STRONGEST_FRAME))


def _solved(sums: list[list[float]], rest_angle: float) -> tuple[float, float]:
    """Ratio lambda [1] and its variance, with the term in e^2 at most about 0.1 / theta_bar."""
    first, both = sums[0][0] + 1, sums[0][1]
    second = sums[1][1] + (rest_angle / FREEDOM_OF_BEND) ** 2
    determinant = first * second - both**2
    ratio = (second * sums[0][2] - both * sums[1][2]) / determinant
    return ratio, second / determinant
