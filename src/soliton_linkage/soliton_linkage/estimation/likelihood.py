# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over the rotors of a frame: its likelihood at an arc of the orbit.

The difference d between a rotor and the orbit, r = d / sqrt(V) standard deviations, has the
density

    p(d) = (1 - e) C / sqrt(V) exp(-rho(r)) + e / 2 pi,
    rho = r^2 / 2 up to k, k^2 (1/2 + log(r / k)) beyond,

where e is the share of readings without information. The slope of log p is -w d / V with the
weight w = min(1, k^2 / r^2) P; P is the probability that the reading contains information. Since
sqrt(w) r <= k, no single reading moves an arc by more than k of its standard deviations.
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
    """Set the differences of corrected angles from a wall, from -pi to pi [rad], shape (N,).

    `about` are the angles near the wall from rotor `first` on; `before` and `beyond` are the
    angles on either side of it, shape (N,) each.
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
    """Return the logarithm of p(d) sqrt(V) / ((1 - e) C), given r^2 [1]."""
    core = _core(square, bound * bound)
    if square <= bound * bound:
        return core
    return max(core, floor) + math.log1p(math.exp(-abs(core - floor)))


@compiled(f8, f8, f8, f8)
def _of_rotor(apart: float, variance: float, bound: float, floor: float) -> float:
    """Return the log likelihood of a difference [rad] with a variance [rad^2], 0 for NaN."""
    if not math.isfinite(apart):
        return 0.0
    return _log_likelihood(apart * apart / variance, bound, floor)


@compiled(f8, f8, f8)
def _weight(square: float, bound: float, floor: float) -> float:
    """Return the weight w of a rotor, given r^2 [1]."""
    inner = bound * bound
    if square <= inner:
        return 1.0
    return inner / square / (1 + math.exp(min(floor - _core(square, inner), 700.0)))


DENSITY = np.dtype(
    [(name, np.float64) for name in ('variance', 'spread', 'bound', 'floor', 'gross')]
)
"""Density of the difference between a rotor and the orbit, one record: variance V of a rotor and
variance of the arc [rad^2], bound k [1], log density of readings without information relative to
the core [1], and least gross difference [rad]."""
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
    """Set the weights w of all rotors [1], shape (N,), 0 for unknown and doubtful ones.

    Returns the information on the arc, sum w t^2 [1], the step to the most likely arc [rad], and
    the information if all weights were 1.
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
    differences: Array,
    first: int,
    tangent: Array,
    density: Records,
    doubtful: Flags,
    rows: Array,
) -> tuple[tuple[float, float, float], tuple[int, int, int, int, int], tuple[float, float, float]]:
    """Weigh rotors, and subtract the step to the most likely arc from the differences [rad].

    Differences, shape (N,), are NaN if unknown. The tangent starts at rotor `first`. Doubtful
    flags have shape (N,) or (0,). Sets rows, shape (2, N): weights [1], and the residuals of
    rotors near the wall with a weight of at least 0.5, else 0 [rad].

    Returns three tuples: the results of `_weigh`; numbers of rotors (near the wall with a weight
    of at least 0.5; known; below 0.5 with a gross difference; longest run of these; below 0.5);
    sum of squared residuals [rad^2], log likelihood of the frame [1], and largest difference
    [rad], infinite if a rotor is unknown.
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
    """Set the running sums of the log likelihoods of the rotors, shape (S, N + 1).

    Each row belongs to one state of the chain [rad], shape (S, N).
    """
    for row in range(states.shape[0]):
        sums[row, 0] = 0.0
        for n in range(angles.size):
            apart = wrapped(angles[n] - states[row, n])
            gained = _of_rotor(apart, variance, bound, floor)
            sums[row, n + 1] = sums[row, n] + gained


@compiled(f8, f8, f8, f8_1d)
def tabulate(variance: float, bound: float, floor: float, table: Array) -> None:
    """Set the log likelihoods of evenly spaced differences from 0 to pi, both included."""
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
    """Samples of the walls of an orbit, with concatenated angles."""

    legs: Counts
    """Leg of each sample, shape (S,)."""
    firsts: Counts
    """First rotor near each wall, shape (S,)."""
    begins: Counts
    """Index in `angles` at which each wall starts, and the end of the last one, shape (S + 1,)."""
    angles: Array
    """Angles of the rotors near the walls [rad]."""


_WALLS = named_tuple(SampledWalls, i8_1d, i8_1d, i8_1d, f8_1d)


@compiled(const_f8_1d, const_f8_2d, const_f8_2d, _WALLS, const_f8_1d, f8_1d)
def scan(
    angles: Array,
    before: Array,
    beyond: Array,
    walls: SampledWalls,
    table: Array,
    likelihoods: Array,
) -> None:
    """Set the log likelihood of a frame at samples of the orbit, shape (S,).

    `before` and `beyond` are cumulative sums over the rotors on either side of the wall, for each
    leg, shape (legs, N + 1). `tabulate` computes the table.
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
    """Return the log likelihood of a frame from its differences [rad], shape (N,)."""
    likelihood = 0.0
    for n in range(differences.size):
        likelihood += _of_rotor(differences[n], variance, bound, floor)
    return likelihood
