# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording before identification, and of the residuals afterwards.

All rotors on one side of a wall lean to the same side. For any lengths, the staggered angles on
both sides are symmetric about 0, or about pi for all rotors. A wall reaches the rotors in their
order. Therefore the times at which the rotors of one parity first lean over have no local maximum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.readings import (
    MOST_NAMED,
    Readings,
    repeat_counts,
    rounding_noise,
)
from soliton_linkage.linkage.chain import Array, staggered

_LEANING = 0.5
"""|sin(phi)| above which a rotor clearly leans to one side, relative to its median [1]."""
_LARGEST_ZERO_ERROR = 0.5
"""Largest zero error of an encoder with which least squares converges [rad]. Deviations of 5 % in
every length and offsets of 0.05 rad appear as zero errors of 0.3 rad."""
_TRIMMINGS = 6
"""Iterations of the robust mean angle at rest [1]."""
_SHARPNESS = 20.0
"""Exponent of the weights of this mean, 1 / (0.22 rad)^2 [1/rad^2]."""
_FRAMES = 5
"""Number of frames in the medians at the start and at the end [1]."""
_LATE = 0.5
"""Smallest delay of a rotor out of order, relative to the time of a wall per two rotors [1]."""


def check_motion(times: Array, readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError unless a wall passes all rotors in their order.

    Times [s] have the shape (T,), readings [rad] the shape (T, N).
    """
    check_leans(readings, names)
    over = _leaning_over(readings)
    inner = over[1:-1]
    if not np.isfinite(inner).any():
        raise ValueError(
            'no soliton passes in this recording: no rotor leans over from one side to the '
            'other; nudge the chain while it records'
        )
    still = 1 + np.flatnonzero(~np.isfinite(inner))
    between = np.isfinite(over[still - 1]) & np.isfinite(over[still + 1])
    if between.any():
        raise ValueError(
            f'{names[int(still[np.argmax(between)])]} does not lean over although the soliton '
            'passes both its neighbours: it is held, or the zero of its encoder is wrong by more '
            'than it leans; free it and set the zero'
        )
    if still.size:
        raise ValueError(
            f'the soliton passes only {len(inner) - still.size} of {len(inner)} inner rotors, '
            f'not {names[int(still[0])]}; record until it has been at both edges'
        )
    first = times[inner.astype(np.intp)]
    for parity in (0, 1):
        _check_order(first[parity::2], names[1:-1][parity::2])


def check_leans(readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError for inner rotors that do not lean as a chain does.

    Edge rotors of flippers toggle and have two angles on each side.
    """
    opposite = _opposite(readings[:_FRAMES]) & _opposite(readings[-_FRAMES:])
    errors = _zero_errors(readings)
    half_turn = np.abs(errors) > math.pi - _LARGEST_ZERO_ERROR
    inner = opposite[1:-1] | (np.abs(errors[1:-1]) > _LARGEST_ZERO_ERROR)
    wrong = 1 + np.flatnonzero(inner)
    if not wrong.size:
        return
    rotor = int(wrong[0])
    if wrong.size > 1:
        named = ', '.join(names[n] for n in wrong[:MOST_NAMED])
        more = ', ...' if wrong.size > MOST_NAMED else ''
        raise ValueError(
            f'{named}{more} do not lean as their neighbours do: the joints are not in the order '
            'of the rotors, or encoders are mounted backwards; name the joints from the first '
            'rotor to the last, and check the signs'
        )
    if opposite[rotor] != half_turn[rotor]:
        raise ValueError(
            f'{names[rotor]} is mounted backwards: its angle decreases when its neighbours show '
            f'that it increases; publish {"pi - " if half_turn[rotor] else "-"}phi for it'
        )
    error = float(errors[rotor]) * (-1 if rotor % 2 else 1)
    raise ValueError(
        f'the zero of {names[rotor]} has an error of about {error:.2g} rad, more than '
        f'{_LARGEST_ZERO_ERROR:g} rad; set it to the upright position'
    )


def _opposite(readings: Array) -> NDArray[np.bool_]:
    """Return which rotors lean to the other side than both neighbours, shape (N,)."""
    sides = np.sign(np.sin(np.median(readings, axis=0)))
    padded = np.concatenate([sides[1:2], sides, sides[-2:-1]])
    return np.asarray((padded[:-2] != sides) & (padded[2:] != sides))


def _zero_errors(readings: Array) -> Array:
    """Return the approximate error of the staggered angles of each rotor [rad], shape (N,).

    For flippers it is the mean of both sides, which depends on offsets and not on lengths.
    Spinners turn by half a turn, so that both sides have the same error.
    """
    sine = np.sin(readings)
    clear = np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0)
    turns = np.exp(1j * staggered(readings))
    right, left = (_direction_at_rest(turns, clear & side) for side in (sine > 0, sine < 0))
    if np.median(np.real(right) * np.real(left)) > 0:
        up = np.sign(np.sum(np.real(right + left))) or 1.0
        error = (right + left) * up
    else:
        error = right * np.conj(np.sum(right)) + left * np.conj(np.sum(left))
    both = (np.abs(right) > 0) & (np.abs(left) > 0)
    return np.where(both, np.angle(error), 0.0)


def _direction_at_rest(
    turns: NDArray[np.complex128], some: NDArray[np.bool_]
) -> NDArray[np.complex128]:
    """Return the usual direction of each rotor in some frames, 0 without frames, (N,)."""
    weights = some.astype(np.float64)
    for _ in range(_TRIMMINGS):
        means = np.sum(turns * weights, axis=0)
        middle = means / np.maximum(np.abs(means), 1e-9)
        weights = some * np.exp(_SHARPNESS * (np.real(turns * np.conj(middle)) - 1))
    return np.asarray(middle)


def _leaning_over(readings: Array) -> Array:
    """Return the first frame in which each rotor leans to the other side, NaN if none, (N,)."""
    sine = np.sin(readings)
    sides = np.where(np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0), np.sign(sine), 0)
    found = np.full(sides.shape[1], np.nan)
    for rotor, side in enumerate(sides.T):
        clear = np.flatnonzero(side)
        if clear.size:
            over = np.flatnonzero(side == -side[clear[0]])
            found[rotor] = over[0] if over.size else np.nan
    return found


def _check_order(times: Array, names: Sequence[str]) -> None:
    """Raise ValueError if a wall reaches a rotor later than both neighbours of its parity."""
    if len(times) < 3:
        return
    margin = _LATE * float(np.median(np.abs(np.diff(times))))
    late = times[1:-1] - np.maximum(times[:-2], times[2:]) > margin
    if late.any():
        rotor = 1 + int(np.flatnonzero(late)[0])
        beside = rotor + (1 if times[rotor + 1] > times[rotor - 1] else -1)
        first, second = sorted((rotor, beside))
        raise ValueError(
            f'the joints are not in the order of the rotors: the soliton reaches {names[first]} '
            f'after {times[first]:.3g} s and {names[second]} after {times[second]:.3g} s; swap '
            'them, or name the joints from the first to the last'
        )


LEAST_NOISE = 1e-4
"""Smallest noise with which a motion is fitted [rad]."""
_SLIP_RANGE = 3.0
"""Largest sum of n independent numbers over sqrt(n) [1]; among 40 rotors noise exceeds it in one
of a million recordings."""
_SMALLEST_SLIP = 2.0
"""Smallest reported slip, relative to the noise of a reading [1]."""
_JUMP_FRAMES = 15
"""Frames that are averaged before and after a jump [1]."""
_JUMP_OVER_NOISE = 12.0
"""Second difference of a jump, relative to the noise of a reading [1]; noise alone gives 2.2."""
_SMALLEST_JUMP = 0.1
"""Second difference that no motion reaches from frame to frame [rad]."""
_JUMP_OVER_NEIGHBOURS = 3.0
"""Jump, relative to the larger jump of both neighbours [1]; a wall moves neighbours similarly."""


def noise_of(readings: Array, relative_deviations: Array) -> float:
    """Return the noise of readings with a relative deviation of 1 [rad]; both of shape (T, N).

    It follows from the second differences of readings. Their median ignores the few rotors that
    move. The result is at least the noise of rounding to the smallest step of readings, and NaN
    without three successive readings.
    """
    bends = readings[2:] - 2 * readings[1:-1] + readings[:-2]
    squares = relative_deviations**2
    bends /= np.sqrt(squares[2:] + 4 * squares[1:-1] + squares[:-2])
    sizes = np.abs(bends[np.isfinite(bends)])
    if not len(sizes):
        return math.nan
    rounding = rounding_noise(readings) / float(np.nanmedian(relative_deviations))
    return max(robust_deviation(sizes), rounding)


def check_jumps(recording: Readings, noise: float) -> None:
    """Raise ValueError for an inner rotor that jumps while its neighbours do not.

    The noise [rad] belongs to a reading with a relative deviation of 1.
    """
    times, readings, deviations = recording.times, recording.filled, recording.relative_deviations
    width = min(_JUMP_FRAMES, len(readings) // 4)
    rates = np.diff(readings, axis=0)
    sudden = np.abs(rates[1:-1] - (rates[:-2] + rates[2:]) / 2)
    sudden /= np.max([deviations[frame : frame + len(sudden)] for frame in range(4)], axis=0)
    sums = np.cumsum(np.vstack([np.zeros(readings.shape[1]), readings]), axis=0)
    means = (sums[width:] - sums[:-width]) / width
    steps = np.minimum(np.abs(means[width:] - means[:-width]), sudden[width - 2 : 2 - width])
    beside = np.maximum(steps[:, :-2], steps[:, 2:])
    limit = max(_JUMP_OVER_NOISE * noise, _SMALLEST_JUMP) + _JUMP_OVER_NEIGHBOURS * beside
    excess = steps[:, 1:-1] / limit
    frame, rotor = divmod(int(np.argmax(excess)), excess.shape[1])
    if excess[frame, rotor] > 1:
        raise _slip_error(
            recording.joints[rotor + 1], steps[frame, rotor + 1], times[frame + width] - times[0]
        )


def check_slips(recording: Readings, residuals: Array, noise: float) -> None:
    """Raise ValueError for an encoder whose residuals have a step.

    Residuals [rad], (T, N), are divided by the relative deviations of the readings. The noise
    [rad] belongs to one reading.
    """
    single = residuals / np.sqrt(repeat_counts(recording.unwrapped))
    sums = np.cumsum(single - single.mean(axis=0), axis=0) / (noise * math.sqrt(len(residuals)))
    largest = np.abs(sums).max(axis=0)
    rotor = int(np.argmax(largest))
    frame = int(np.argmax(np.abs(sums[:, rotor]))) + 1
    step = float(residuals[frame:, rotor].mean() - residuals[:frame, rotor].mean())
    if largest[rotor] > _SLIP_RANGE and abs(step) > _SMALLEST_SLIP * noise:
        time = recording.times[frame] - recording.times[0]
        raise _slip_error(recording.joints[rotor], step, time)


def _slip_error(name: str, step: float, time: float) -> ValueError:
    return ValueError(
        f'the encoder of {name} slips by about {abs(step):.2g} rad at {time:.3g} s; fasten it and '
        'record again'
    )
