# SPDX-License-Identifier: Apache-2.0
"""Compiled loops over frames that follow each other; `filter_arrays` says what they compute."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import (
    COUNT,
    FLAGS,
    NUMBER,
    READ,
    READ_FLAGS,
    READ_TABLE,
    ROW,
    TABLE,
    compiled,
)
from soliton_linkage.estimation.loops.filter_arrays import BEYOND_CHANCE, LEAST_TIMES, SIGNIFICANT
from soliton_linkage.estimation.loops.frame_arrays import Flags
from soliton_linkage.linkage.chain import Array


@compiled(READ_TABLE, READ_TABLE, READ)
def expected_measurement(states: Array, spreads: Array, weights: Array) -> tuple[float, float]:
    """Measurement that weighted filters expect, and its variance."""
    arc, variance = 0.0, 0.0
    for n in range(weights.size):
        arc += weights[n] * (states[0, n] + states[2, n])
    for n in range(weights.size):
        apart = states[0, n] + states[2, n] - arc
        of_filter = spreads[0, n] + 2 * spreads[2, n] + spreads[5, n]
        variance += weights[n] * (of_filter + apart * apart)
    return arc, variance


@compiled(TABLE, TABLE, READ, READ, READ, NUMBER, NUMBER, NUMBER)
def predict(
    states: Array,
    spreads: Array,
    weights: Array,
    wander: Array,
    errors: Array,
    elapsed: float,
    kept: float,
    cubed: float,
) -> tuple[float, float]:
    """Let filters go on by a time."""
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
    return expected_measurement(states, spreads, weights)


@compiled(TABLE, TABLE, NUMBER, NUMBER, NUMBER)
def _corrected(
    states: Array, spreads: Array, arc: float, variance: float, freedoms: float
) -> Array:
    """Correct filters; return how likely [logarithm] each makes the measurement, shape (F,)."""
    likely = np.empty(states.shape[1])
    for n in range(likely.size):
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
    return likely


@compiled(READ, READ)
def _together(shares: Array, likelihoods: Array) -> float:
    """Logarithm of the mean of likelihoods [logarithm] by their shares."""
    top = -math.inf
    for n in range(shares.size):
        if shares[n] > 0:
            top = max(top, likelihoods[n])
    mean, whole = 0.0, 0.0
    for n in range(shares.size):
        if shares[n] > 0:
            mean += shares[n] * math.exp(likelihoods[n] - top)
            whole += shares[n]
    return float(top + math.log(mean / whole))


@compiled(TABLE, TABLE, READ, ROW, ROW, ROW, NUMBER, NUMBER, NUMBER)
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
    """Correct all filters by a measurement."""
    base = shares.size + 1
    likely = _corrected(states, spreads, arc, variance, freedoms)
    against = _together(shares, likely[1:base]) - likely[0]
    together = _together(weights[:base], likely[:base])
    for n in range(odds.size):
        odds[n] += likely[base + n] - together
    for n in range(shares.size):
        likelihoods[n] += likely[n + 1]
    top, whole = likelihoods.max(), 0.0
    for n in range(shares.size):
        likelihoods[n] -= top
        shares[n] = math.exp(likelihoods[n])
        whole += shares[n]
    for n in range(shares.size):
        shares[n] /= whole
    return against, odds.max()


@compiled(ROW, READ, READ, NUMBER, NUMBER, NUMBER)
def weigh(
    weights: Array, shares: Array, odds: Array, against: float, rare: float, none: float
) -> None:
    """Set the weights of all filters."""
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


@compiled(READ, READ_TABLE, READ_TABLE, COUNT, NUMBER)
def mixture(
    weights: Array, states: Array, spreads: Array, base: int, least: float
) -> tuple[float, float, float, float, float]:
    """Means and covariance of weighted filters."""
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


@compiled(TABLE, TABLE, ROW, ROW, READ, COUNT, NUMBER, NUMBER)
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
    """Let the filter begin that holds that the wall is kicked now."""
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


@compiled(TABLE, TABLE, ROW, ROW, READ, ROW, NUMBER, NUMBER, NUMBER, COUNT, *(3 * [NUMBER]))
def settle(
    states: Array,
    spreads: Array,
    errors: Array,
    weights: Array,
    shares: Array,
    odds: Array,
    against: float,
    rare: float,
    none: float,
    older: int,
    elapsed: float,
    least_kick: float,
    unlikely: float,
) -> tuple[float, float, float, float, float]:
    """Weigh filters, let one of a kick begin, and mix them all."""
    weigh(weights, shares, odds, against, rare, none)
    suppose_kick(states, spreads, errors, odds, weights, older, elapsed, least_kick)
    return mixture(weights, states, spreads, shares.size + 1, unlikely)


@compiled(TABLE, TABLE, ROW, READ, READ, NUMBER)
def gather(
    weights: Array, sums: Array, times: Array, residuals: Array, sides: Array, variance: float
) -> None:
    """Add residuals to the sums of the sides on which their rotors are."""
    for n in range(residuals.size):
        if sides[n] != 0 and math.isfinite(residuals[n]):
            row = 0 if sides[n] > 0 else 1
            times[n] += 1
            weights[row, n] += 1 / variance
            sums[row, n] += residuals[n] / variance


@compiled(READ_TABLE, READ_TABLE, NUMBER, NUMBER, TABLE)
def solve(weights: Array, sums: Array, widest: float, trust: float, solution: Array) -> None:
    """Solve the normal equations of offsets and rest angles."""
    for n in range(weights.shape[1]):
        before, beyond = weights[0, n], weights[1, n]
        of_offset, of_rest = before + beyond + widest, before + beyond + trust
        mixed = before - beyond
        whole, apart = sums[0, n] + sums[1, n], sums[0, n] - sums[1, n]
        determinant = of_offset * of_rest - mixed * mixed
        solution[0, n] = (of_rest * whole - mixed * apart) / determinant
        solution[1, n] = (of_offset * apart - mixed * whole) / determinant
        solution[2, n] = of_rest / determinant
        solution[3, n] = -mixed / determinant
        solution[4, n] = of_offset / determinant


@compiled(TABLE, TABLE, ROW, READ, READ, *(4 * [NUMBER]), TABLE, ROW, ROW)
def learn(
    weights: Array,
    sums: Array,
    times: Array,
    residuals: Array,
    sides: Array,
    variance: float,
    repeated: float,
    widest: float,
    trust: float,
    solution: Array,
    deviations: Array,
    corrections: Array,
) -> None:
    """Learn offsets from residuals."""
    gather(weights, sums, times, residuals, sides, variance)
    solve(weights, sums, widest, trust, solution)
    for n in range(times.size):
        deviations[n] = math.sqrt(solution[2, n] + repeated)
        sure = times[n] >= LEAST_TIMES and abs(solution[0, n]) > SIGNIFICANT * deviations[n]
        corrections[n] = solution[0, n] if sure else 0.0


@compiled(READ_TABLE, READ_TABLE, READ, READ, NUMBER, NUMBER, NUMBER, ROW, TABLE)
def surprise(
    weights: Array,
    solution: Array,
    sums: Array,
    corrections: Array,
    share: float,
    before: float,
    beyond: float,
    sides: Array,
    found: Array,
) -> tuple[int, int]:
    """Means of residuals and how they surprise."""
    known, passed = 0, 0
    for n in range(sums.size):
        side = 1.0 if n < before else -1.0 if n > beyond else 0.0
        expected = solution[0, n] + side * solution[1, n]
        spread = solution[2, n] + side * (2 * solution[3, n] + side * solution[4, n])
        sides[n] = side
        found[0, n] = share * sums[n] + corrections[n]
        found[1, n] = found[0, n] - expected if side else math.nan
        found[2, n] = math.sqrt(spread)
        if math.isfinite(found[1, n]):
            found[3, known] = found[1, n] * found[1, n]
            found[4, known] = max(abs(found[1, n]) - found[2, n], 0.0)
            known += 1
        if weights[0, n] > 0 and weights[1, n] > 0:
            found[5, passed] = abs(solution[0, n])
            passed += 1
    return known, passed


@compiled(READ_TABLE, READ, NUMBER, ROW)
def stand_apart(solution: Array, sides: Array, repeated: float, apart: Array) -> None:
    """How far rotors are from the orbit beyond chance."""
    for n in range(sides.size):
        side = sides[n]
        if side:
            expected = solution[0, n] + side * solution[1, n]
            spread = solution[2, n] + side * (2 * solution[3, n] + side * solution[4, n])
            apart[n] = max(abs(expected) - BEYOND_CHANCE * math.sqrt(spread + repeated), 0.0)


@compiled(READ, ROW, READ_FLAGS, FLAGS, NUMBER)
def find_stuck(read: Array, earlier: Array, outlying: Flags, stuck: Flags, few: float) -> None:
    """Find rotors that read what they did."""
    same, known = 0, 0
    for n in range(read.size):
        same += read[n] == earlier[n]
        known += math.isfinite(read[n])
    for n in range(read.size):
        trusted = same > few * known and not (outlying[n] or stuck[n])
        stuck[n] = read[n] == earlier[n] and not trusted
        earlier[n] = read[n]


@compiled(READ_TABLE, READ_TABLE, ROW, ROW)
def lasting_residuals(weights: Array, sums: Array, means: Array, chances: Array) -> int:
    """Sizes of residuals that last, and of those that chance makes."""
    known = 0
    for side in range(2):
        for n in range(weights.shape[1]):
            if weights[side, n] > 0:
                means[known] = abs(sums[side, n] / weights[side, n])
                chances[known] = 1 / math.sqrt(weights[side, n])
                known += 1
    return known


@compiled(READ, READ, READ, ROW)
def known_changes(first: Array, second: Array, third: Array, changes: Array) -> int:
    """Absolute second differences of three rows, the known ones in front."""
    known = 0
    for n in range(changes.size):
        change = abs(first[n] - 2 * second[n] + third[n])
        if change < math.inf:
            changes[known] = change
            known += 1
    return known


@compiled(READ, READ, READ, READ, COUNT, COUNT, COUNT, COUNT)
def products_in_time(
    oldest: Array,
    older: Array,
    left: Array,
    tangent: Array,
    in_oldest: int,
    in_older: int,
    begin: int,
    count: int,
) -> tuple[float, float, float, float]:
    """Sums of products of what three frames running left."""
    whole, wall, free, chance = 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        before = older[in_older + n] * (4 / 3) - oldest[in_oldest + n] / 3
        product = left[begin + n] * before
        share = tangent[begin + n] * tangent[begin + n]
        alone = share - share * share
        whole += product
        wall += share * product
        free += alone
        chance += alone * alone
    return whole, wall, free, chance
