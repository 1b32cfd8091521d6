# SPDX-License-Identifier: Apache-2.0
"""What frames that follow each other tell, in numpy; `filter_kernels` compiles it.

The functions of both modules are the same but for rounding. For `CycleMotion` states are rows s,
w and b, shape (3, F), spreads ss, sw, sb, ww, wb and bb of their covariance, shape (6, F), of the
B filters without kicks and after them those with one. For `EncoderOffsets` weights [1/rad^2] and
sums [1/rad] of residuals are of shape (2, N), before the wall and beyond it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from soliton_linkage.estimation.loops.frame_arrays import Flags
from soliton_linkage.linkage.chain import Array

BEYOND_CHANCE = 5.0
SIGNIFICANT = 5.5
LEAST_TIMES = 5

# Of the covariance of (s, w, b) the rows are ss, sw, sb, ww, wb and bb.
_FIRST = np.array([0, 0, 0, 1, 1, 2])
_SECOND = np.array([0, 1, 2, 1, 2, 2])
# Covariances of s, w and b with s + b.
_MEASURED = np.array([[1.0, 0, 1, 0, 0, 0], [0, 1, 0, 0, 1, 0], [0, 0, 1, 0, 0, 1]])


@cache
def filter_loops() -> Any:
    """Return the module `filter_kernels` or, where numba is absent, this one."""
    try:
        from soliton_linkage.estimation.loops import filter_kernels
    except ImportError:
        from soliton_linkage.estimation.loops import filter_arrays

        return filter_arrays
    return filter_kernels


def expected_measurement(states: Array, spreads: Array, weights: Array) -> tuple[float, float]:
    """Measurement s + b that weighted filters expect [rad] and its variance [rad^2]."""
    arcs = states[0] + states[2]
    arc = float(weights @ arcs)
    variances = spreads[0] + 2 * spreads[2] + spreads[5]
    return arc, float(weights @ (variances + (arcs - arc) ** 2))


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
    """Let filters go on by a time [s], of whose error b the share e^(-|w| dt / ...) is kept.

    The rates wander with the variance cubed * wander in a second, the errors are of a variance.
    Returns `expected_measurement`.
    """
    states[0] += elapsed * states[1]
    states[2] *= kept
    carry = np.eye(6)
    carry[0, 1], carry[0, 3], carry[1, 3] = 2 * elapsed, elapsed**2, elapsed
    carry[2, 2], carry[2, 4], carry[4, 4], carry[5, 5] = kept, elapsed * kept, kept, kept**2
    spreads[:] = carry @ spreads
    added = cubed * elapsed * np.array([elapsed**2 / 3, elapsed / 2, 1.0])
    spreads[[0, 1, 3]] += added[:, None] * wander
    spreads[5] += errors * (1 - kept**2)
    return expected_measurement(states, spreads, weights)


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
    """Correct all filters by a measurement of the arc [rad] of a variance from few freedoms.

    Weights of all, shape (F,), are those of before. Shares and logarithmic likelihoods of all
    that are neither steady nor of a kick, shape (B - 1,), and logarithmic odds of the kicks,
    shape (F - B,), are brought up to date. Returns how much less likely [logarithm] the steady
    filter makes the measurement than those others, and the largest of the odds.
    """
    base = len(shares) + 1
    gathered = _MEASURED @ spreads
    surprises = arc - (states[0] + states[2])
    variances = gathered[0] + gathered[2] + variance
    squares = surprises * surprises / variances
    if math.isfinite(freedoms):
        squares = (freedoms + 1) * np.log1p(squares / freedoms)
    likely = -0.5 * (squares + np.log(variances))
    against = _together(shares, likely[1:base]) - float(likely[0])
    odds += likely[base:] - _together(weights[:base], likely[:base])
    likelihoods += likely[1:base]
    likelihoods -= likelihoods.max()
    np.exp(likelihoods, out=shares)
    shares /= shares.sum()
    gains = gathered / variances
    states += gains * surprises
    spreads -= gathered.take(_FIRST, 0) * gains.take(_SECOND, 0)
    return against, float(odds.max())


def weigh(
    weights: Array, shares: Array, odds: Array, against: float, rare: float, none: float
) -> None:
    """Set the weights of all filters, shape (F,).

    The steady one has the logarithmic odds against it; those of kicks, which are rare by a
    logarithm, count from odds on that are more than none.
    """
    base, doubted = len(shares) + 1, 1 / (1 + math.exp(-against))
    weights[1:base] = doubted * shares
    weights[0] = 1 - doubted
    weights[base:] = math.exp(-rare) * np.maximum(np.exp(odds) - math.exp(none), 0.0)
    weights /= weights.sum()


def mixture(
    weights: Array, states: Array, spreads: Array, base: int, least: float
) -> tuple[float, float, float, float, float]:
    """Mean s and w of weighted filters, variance of s, covariance, variance of w.

    Filters from the base on count from a least weight on.
    """
    likely = weights.copy()
    kicked = likely[base:]
    kicked[kicked < least] = 0.0
    likely /= likely.sum()
    arc, rate = (states[:2] @ likely).tolist()
    arcs, rates = states[0] - arc, states[1] - rate
    within = (spreads @ likely).tolist()
    return (
        arc,
        rate,
        within[0] + float((likely * arcs) @ arcs),
        within[1] + float((likely * arcs) @ rates),
        within[3] + float((likely * rates) @ rates),
    )


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
    """Let the filter begin that holds that the wall is kicked now; some grow older.

    It goes on from the likeliest without a kick, the rate being changed by about itself and the
    least, a variance [rad^2/s^2], somewhere in the time [s] since the last frame.
    """
    base = len(weights) - len(odds)
    likeliest = int(weights[:base].argmax())
    for rows in (states, spreads, errors):
        rows[..., base + 1 : base + 1 + older] = rows[..., base : base + older].copy()
        rows[..., base] = rows[..., likeliest]
    odds[1 : 1 + older] = odds[:older].copy()
    kick = float(states[1, base]) ** 2 + least
    spreads[0, base] += kick * elapsed**2 / 4
    spreads[3, base] += kick
    odds[0] = 0.0


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
    """What follows a measurement: `weigh`, `suppose_kick` and `mixture`, with their arguments."""
    weigh(weights, shares, odds, against, rare, none)
    suppose_kick(states, spreads, errors, odds, weights, older, elapsed, least_kick)
    return mixture(weights, states, spreads, len(shares) + 1, unlikely)


def gather(
    weights: Array, sums: Array, times: Array, residuals: Array, sides: Array, variance: float
) -> None:
    """Add residuals of a variance [rad^2] to the weights, sums and times (N,) of their rotors.

    Residuals [rad], NaN where unknown, and sides, +1, -1 and 0 about the wall: (N,) each.
    """
    for row, side in enumerate((1, -1)):
        known = (sides == side) & np.isfinite(residuals)
        times[known] += 1
        weights[row, known] += 1 / variance
        sums[row, known] += residuals[known] / variance


def solve(weights: Array, sums: Array, widest: float, trust: float, solution: Array) -> None:
    """Means o and delta and covariances oo, od and dd of `EncoderOffsets`, shape (5, N).

    From the 2 x 2 normal equations, with the weights of the priors of both [1/rad^2].
    """
    both = weights.sum(axis=0)
    of_offset, of_rest, mixed = both + widest, both + trust, weights[0] - weights[1]
    whole, apart = sums.sum(axis=0), sums[0] - sums[1]
    rows = (
        of_rest * whole - mixed * apart,
        of_offset * apart - mixed * whole,
        of_rest,
        -mixed,
        of_offset,
    )
    solution[:] = np.array(rows) / (of_offset * of_rest - mixed**2)


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
    """Learn offsets as `EncoderOffsets.update` does; arguments as `gather` and `solve`.

    Deviations of the offsets and what is sure of them [rad], shape (N,), are set.
    """
    gather(weights, sums, times, residuals, sides, variance)
    solve(weights, sums, widest, trust, solution)
    deviations[:] = np.sqrt(solution[2] + repeated)
    sure = (np.abs(solution[0]) > SIGNIFICANT * deviations) & (times >= LEAST_TIMES)
    corrections[:] = np.where(sure, solution[0], 0.0)


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
    """Means of the residuals of a block of frames, a share of their sums [rad], shape (N,).

    They are of angles less corrections [rad]. Rotors are before one place and beyond another
    [rotor spacings], which sets their sides. Found, shape (6, N), are the means, what they are
    more than expected, NaN about the wall, and how unsure that was [rad]; then, one after the
    other, squares of the surprises that are known and what they are more than unsure; and the
    sizes of offsets of rotors that were seen on both sides. Returns how many these are.
    """
    rotors = np.arange(len(sums))
    sides[:] = np.where(rotors < before, 1.0, np.where(rotors > beyond, -1.0, 0.0))
    expected, spreads = _expected(solution, sides)
    found[0] = share * sums + corrections
    found[1] = np.where(sides == 0, np.nan, found[0] - expected)
    found[2] = np.sqrt(spreads)
    known, passed = np.isfinite(found[1]), (weights > 0).all(axis=0)
    counts = int(np.count_nonzero(known)), int(np.count_nonzero(passed))
    found[3, : counts[0]] = found[1, known] ** 2
    found[4, : counts[0]] = np.maximum(np.abs(found[1, known]) - found[2, known], 0.0)
    found[5, : counts[1]] = np.abs(solution[0, passed])
    return counts


def stand_apart(solution: Array, sides: Array, repeated: float, apart: Array) -> None:
    """Set how far rotors are from the orbit beyond chance [rad], (N,), where they have a side.

    The repeated is the variance of the error that is the same in all frames [rad^2].
    """
    expected, spreads = _expected(solution, sides)
    beyond = np.maximum(np.abs(expected) - BEYOND_CHANCE * np.sqrt(spreads + repeated), 0)
    apart[:] = np.where(sides == 0, apart, beyond)


def find_stuck(read: Array, earlier: Array, outlying: Flags, stuck: Flags, few: float) -> None:
    """Set which rotors are stuck, shape (N,), who read what they did earlier [rad].

    Where these are more than few [1] of those that are known, only of the outlying, and of those
    that were stuck before. What was read earlier is then what is read now.
    """
    same = read == earlier
    if np.count_nonzero(same) > few * np.count_nonzero(np.isfinite(read)):
        same &= outlying | stuck
    earlier[:] = read
    stuck[:] = same


def lasting_residuals(weights: Array, sums: Array, means: Array, chances: Array) -> int:
    """Sizes of mean residuals, and what chance makes of them [rad], one after the other.

    Of rotors on the sides on which they were seen, shape (2 N,) at most; returns how many.
    """
    seen = weights > 0
    known = int(np.count_nonzero(seen))
    means[:known] = np.abs(sums[seen] / weights[seen])
    chances[:known] = 1 / np.sqrt(weights[seen])
    return known


def known_changes(first: Array, second: Array, third: Array, changes: Array) -> int:
    """Absolute second differences of three rows, the known ones in front; returns how many."""
    differences = np.abs(first - 2 * second + third)
    known = differences[np.isfinite(differences)]
    changes[: len(known)] = known
    return len(known)


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
    """Sums of p = x (4 x' - x'') / 3 of what three frames running left of some rotors [rad].

    They begin at their index in each of the frames. They are sum p, sum t^2 p, sum f and sum
    f^2 with f = t^2 - t^4.
    """
    end = begin + count
    earlier = oldest[in_oldest : in_oldest + count], older[in_older : in_older + count]
    products = left[begin:end] * (earlier[1] * (4 / 3) - earlier[0] / 3)
    share = tangent[begin:end] ** 2
    free = share - share**2
    return float(products.sum()), float(share @ products), float(free.sum()), float(free @ free)


def _together(shares: Array, likelihoods: Array) -> float:
    """Logarithm of the mean of likelihoods [logarithm] by their shares."""
    # One without a share may be likelier than all others by more than exponentials can tell.
    counting, weighed = shares[shares > 0], likelihoods[shares > 0]
    top = float(weighed.max())
    mean = float(counting @ np.exp(weighed - top)) / float(counting.sum())
    return top + math.log(mean)


def _expected(solution: Array, sides: Array) -> tuple[Array, Array]:
    """Residuals o + side * delta that are expected [rad] and their variances, (N,) each."""
    return (
        solution[0] + sides * solution[1],
        solution[2] + sides * (2 * solution[3] + sides * solution[4]),
    )
