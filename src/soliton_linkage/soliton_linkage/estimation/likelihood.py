# SPDX-License-Identifier: Apache-2.0
"""Compiled loops that compute the likelihood of a frame at a point of the orbit.

The difference d between the measured angle of a rotor and its angle on the orbit has the variance
V. With the scaled difference r = d / sqrt(V), the probability density of d is

    p(d) = (1 - e) C / sqrt(V) exp(-rho(r)) + e / (2 pi),
    rho(r) = r^2 / 2 for |r| <= k,    rho(r) = k^2 (1/2 + log(|r| / k)) for |r| > k,

where e is the fraction of readings that contain no information because their angles are random, k
is the bound of the normal core, and C normalises exp(-rho). The derivative of log p with respect
to d is -w d / V. Here w = min(1, k^2 / r^2) P is the weight of the reading, and P the probability
that the reading contains information.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    b1,
    compiled,
    const_b1_1d,
    const_f8_1d,
    const_f8_2d,
    f8,
    f8_1d,
    f8_2d,
    i8,
    i8_1d,
    named_tuple,
    records,
)
from soliton_linkage.estimation.frames import Flags, wrapped
from soliton_linkage.linkage.chain import Array

Counts = NDArray[np.int64]
Records = NDArray[np.void]


@compiled(const_f8_1d, const_f8_1d, b1, const_f8_1d, const_f8_1d, const_f8_1d, i8, f8_1d)
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
    """Set `differences` to the corrected angles minus the angles of a wall on the orbit.

    The differences [rad], from -pi to pi, have shape (N,). The corrected angles are a = `angles` -
    `corrections` [rad], or pi - a if `upside_down`. On the orbit, the rotors near the wall, from
    rotor `first` on, have the angles `about`; rotors with lower numbers have the angles `before`,
    and rotors with higher numbers the angles `beyond`.
    """
    end = first + about.size
    for n in range(angles.size):
        angle = angles[n] - corrections[n]
        if upside_down:
            angle = math.pi - angle
        expected = before[n] if n < first else about[n - first] if n < end else beyond[n]
        differences[n] = wrapped(angle - expected)


@compiled(f8, f8)
def _core(square: float, inner: float) -> float:
    return -0.5 * (square if square <= inner else inner * (1 + math.log(square / inner)))


@compiled(f8, f8, f8)
def _log_likelihood(square: float, bound: float, floor: float) -> float:
    """Return log p(d), minus the logarithm of the peak of its first term; `square` is r^2."""
    core = _core(square, bound * bound)
    if square <= bound * bound:
        return core
    return max(core, floor) + math.log1p(math.exp(-abs(core - floor)))


@compiled(f8, f8, f8, f8)
def _of_rotor(apart: float, variance: float, bound: float, floor: float) -> float:
    if not math.isfinite(apart):
        return 0.0
    return _log_likelihood(apart * apart / variance, bound, floor)


@compiled(f8, f8, f8)
def _weight(square: float, bound: float, floor: float) -> float:
    inner = bound * bound
    if square <= inner:
        return 1.0
    return inner / square / (1 + math.exp(min(floor - _core(square, inner), 700.0)))


DENSITY = np.dtype(
    [(name, np.float64) for name in ('variance', 'spread', 'bound', 'floor', 'gross')]
)
"""Record with the parameters of the density p(d); d is the angle of a rotor minus its angle on the
orbit.

variance: variance V of the difference [rad^2].
spread: variance of the predicted arc length along the orbit [rad^2]. It does not affect p(d), but
    the weights are computed with the variance V + t^2 `spread` instead of V, where t is the
    component of the rotor in the tangent of the orbit.
bound: bound k of the normal core of the density [1].
floor: logarithm of the ratio of the second term of p(d) to the peak of the first term [1].
gross: smallest difference that counts as a gross error [rad].
"""
_DENSITY = records(DENSITY)


@compiled(const_f8_1d, i8, const_f8_1d, _DENSITY, const_b1_1d, f8_1d)
def _weigh(
    differences: Array,
    first: int,
    tangent: Array,
    density: Records,
    doubtful: Flags,
    weights: Array,
) -> tuple[float, float, float]:
    """Set the weights w of all rotors.

    Return the sum of w t^2, the step to the likeliest arc length [rad], and the sum of t^2. Here t
    is `tangent` for the rotors near the wall, from rotor `first` on, and 0 for other rotors.
    Unknown and doubtful rotors have the weight 0, and both sums omit them.
    """
    end = first + tangent.size
    information, ahead, whole = 0.0, 0.0, 0.0
    for n in range(differences.size):
        apart = differences[n]
        weights[n] = 0.0
        if not math.isfinite(apart) or (doubtful.size > 0 and doubtful[n]):
            continue
        moves = tangent[n - first] if first <= n < end else 0.0
        whole += moves * moves
        square = apart * apart / (density[0]['variance'] + density[0]['spread'] * moves * moves)
        weights[n] = _weight(square, density[0]['bound'], density[0]['floor'])
        information += weights[n] * moves * moves
        ahead += weights[n] * moves * apart
    ahead = ahead / information if information > 0 else 0.0
    return information, ahead, whole


@compiled(f8_1d, i8, const_f8_1d, _DENSITY, const_b1_1d, f8_2d)
def weigh_frame(
    differences: Array, first: int, tangent: Array, density: Records, doubtful: Flags, rows: Array
) -> tuple[tuple[float, float, float], tuple[int, int, int, int, int], tuple[float, float, float]]:
    """Compute weights and residuals from the differences of the angles from the orbit [rad], (N,).

    `differences` become the residuals at the likeliest arc length. Row 0 of `rows` becomes the
    weights. Row 1 becomes the residuals of inliers (weight of at least 0.5) near the wall, and 0
    for other rotors.

    Returns three tuples. The first is the result of `_weigh`. The second has five numbers: inliers
    near the wall, known rotors, gross errors, gross errors in the longest run of adjacent rotors,
    and outliers. The third has the sum of the squares of row 1 [rad^2], the log likelihood of the
    frame [1] and the largest absolute residual [rad], infinite if a rotor is unknown.
    """
    weights, left = rows[0], rows[1]
    information, ahead, whole = _weigh(differences, first, tangent, density, doubtful, weights)
    variance, bound, floor = density[0]['variance'], density[0]['bound'], density[0]['floor']
    end = first + tangent.size
    used, read, off, running, run, outliers = 0, 0, 0, 0, 0, 0
    squares, likelihood, largest = 0.0, 0.0, 0.0
    for n in range(differences.size):
        inside = first <= n < end
        left[n] = 0.0
        if inside:
            differences[n] -= ahead * tangent[n - first]
        apart = differences[n]
        if not math.isfinite(apart):
            largest = math.inf
            continue
        read += 1
        largest = max(largest, abs(apart))
        likelihood += _log_likelihood(apart * apart / variance, bound, floor)
        inlier = weights[n] >= 0.5
        outliers += not inlier
        if inlier or abs(apart) < density[0]['gross']:
            running = 0
        else:
            off += 1
            running += 1
            run = max(run, running)
        if inside and inlier:
            used += 1
            left[n] = apart
            squares += apart * apart
    counts = used, read, off, run, outliers
    return (information, ahead, whole), counts, (squares, likelihood, largest)


@compiled(const_f8_1d, const_f8_2d, f8, f8, f8, f8_2d)
def sum_likelihoods(
    angles: Array, states: Array, variance: float, bound: float, floor: float, sums: Array
) -> None:
    """Set `sums[s, n]` to the log likelihood that the first n rotors are in the uniform state s.

    `states`, the angles of S uniform states [rad], has shape (S, N), and `sums` shape (S, N + 1).
    """
    for row in range(states.shape[0]):
        sums[row, 0] = 0.0
        for n in range(angles.size):
            apart = wrapped(angles[n] - states[row, n])
            gained = _of_rotor(apart, variance, bound, floor)
            sums[row, n + 1] = sums[row, n] + gained


@compiled(f8, f8, f8, f8_1d)
def tabulate(variance: float, bound: float, floor: float, table: Array) -> None:
    """Tabulate log likelihoods of a rotor for differences from 0 to pi [rad], in equal steps."""
    for n in range(table.size):
        apart = math.pi * n / (table.size - 1)
        table[n] = _of_rotor(apart, variance, bound, floor)


@compiled(f8, const_f8_1d)
def _looked_up(apart: float, table: Array) -> float:
    if not math.isfinite(apart):
        return 0.0
    at = abs(apart) * ((table.size - 1) / math.pi)
    low = min(int(at), table.size - 2)
    return float(table[low] + (at - low) * (table[low + 1] - table[low]))


class SampledWalls(NamedTuple):
    """Walls at sampled points of an orbit; the angles of all walls are in one array."""

    arcs: Array
    """Arc length of each sample along the orbit [rad], shape (S,)."""
    sites: Array
    """Site of the wall in each sample [rotor spacings], shape (S,)."""
    legs: Counts
    """Leg of the orbit to which each sample belongs, shape (S,)."""
    firsts: Counts
    """Index of the first rotor near the wall of each sample, shape (S,)."""
    begins: Counts
    """Index in `angles` at which each wall begins, followed by the length of `angles`, (S +
    1,)."""
    angles: Array
    """Angles of the rotors near the walls [rad], wall by wall."""


_WALLS = named_tuple(SampledWalls, f8_1d, f8_1d, i8_1d, i8_1d, i8_1d, f8_1d)


@compiled(const_f8_1d, const_f8_2d, const_f8_2d, _WALLS, const_f8_1d, f8_1d)
def scan(
    angles: Array,
    before: Array,
    beyond: Array,
    walls: SampledWalls,
    table: Array,
    likelihoods: Array,
) -> None:
    """Set the log likelihood of a frame for each of the sampled walls, shape (S,).

    For rotors near a wall, log likelihoods are interpolated in `table` (see `tabulate`). For other
    rotors, they are taken from `before` and `beyond`, the results of `sum_likelihoods` for the
    uniform states before and beyond the wall, with one row per leg of the orbit.
    """
    for sample in range(likelihoods.size):
        leg, first, begin = walls.legs[sample], walls.firsts[sample], walls.begins[sample]
        count = walls.begins[sample + 1] - begin
        end = first + count
        whole = before[leg, first] + beyond[leg, angles.size] - beyond[leg, end]
        for n in range(count):
            apart = wrapped(angles[first + n] - walls.angles[begin + n])
            whole += _looked_up(apart, table)
        likelihoods[sample] = whole


@compiled(const_f8_1d, f8, f8, f8)
def frame_likelihood(differences: Array, variance: float, bound: float, floor: float) -> float:
    """Return the log likelihood of a frame, given its differences from the orbit [rad], (N,)."""
    likelihood = 0.0
    for n in range(differences.size):
        likelihood += _of_rotor(differences[n], variance, bound, floor)
    return likelihood
