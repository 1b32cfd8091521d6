# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording, before a chain is identified and by the residuals that it leaves.

All rotors beyond a wall lean to one side, and the staggered angles of the two sides lie evenly
about 0, or of all rotors about pi, whatever their lengths. A wall comes to rotors in their order:
the first instants at which they lean over have no peak among rotors of one parity, wherever the
wall begins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.readings import MOST_NAMED, Readings, repeats, rounding_noise
from soliton_linkage.linkage.chain import Array, staggered

_LEANING = 0.5
"""sin(phi) of a rotor that leans to one side for certain, over its typical size [1]."""
_OFF_ZERO = 0.5
"""Error of the zero of an encoder that least squares can begin with [rad]: 5 % in every length
and offsets of 0.05 rad look like 0.3 rad of it."""
_TRIMMINGS = 6
"""Times that frames far from where a rotor rests are left out [1]."""
_NEAR = 20.0
"""Sharpness with which they are: 1 / 0.22 rad, squared [1/rad^2]."""
_FRAMES = 5
"""At the begin and the end of which the median counts [1]: one may be anything."""
_OUT_OF_STEP = 0.5
"""By how much a rotor leans over too late, over the time from one to the next but one [1]."""


def check_motion(times: Array, readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError where no wall passes all rotors, or not in their order.

    Times [s] of frames, shape (T,), and their readings [rad], shape (T, N).
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
    beside = np.isfinite(over[still - 1]) & np.isfinite(over[still + 1])
    if beside.any():
        raise ValueError(
            f'{names[int(still[np.argmax(beside)])]} does not lean over although the soliton '
            'passes the rotors beside it: it is held, or its zero is off by more than it leans'
        )
    if still.size:
        raise ValueError(
            f'the soliton passes only {len(inner) - still.size} of {len(inner)} inner rotors, '
            f'not {names[int(still[0])]}; record until it has been at both edges'
        )
    instants = times[inner.astype(np.intp)]
    for parity in (0, 1):
        _check_order(instants[parity::2], names[1:-1][parity::2])


def check_leans(readings: Array, names: Sequence[str]) -> None:
    """Raise ValueError for rotors that do not lean as a chain does, but those at the edges.

    Those of flippers toggle, and have two angles on each side.
    """
    turned = _otherwise(readings[:_FRAMES]) & _otherwise(readings[-_FRAMES:])
    centres = _centres(readings)
    half_turn = np.abs(centres) > math.pi - _OFF_ZERO
    inner = turned[1:-1] | (np.abs(centres[1:-1]) > _OFF_ZERO)
    strange = 1 + np.flatnonzero(inner)
    if not strange.size:
        return
    rotor = int(strange[0])
    if strange.size > 1:
        shown = ', '.join(names[n] for n in strange[:MOST_NAMED])
        more = ', ...' if strange.size > MOST_NAMED else ''
        raise ValueError(
            f'{shown}{more} do not lean as their neighbours do: the joints are not in the order '
            'of the rotors, or read backwards; name them from the first rotor to the last'
        )
    if turned[rotor] != half_turn[rotor]:
        raise ValueError(
            f'{names[rotor]} is mounted backwards: its angle falls where those of its neighbours '
            f'say that it grows; publish {"pi - " if half_turn[rotor] else "-"}phi for it'
        )
    off = float(centres[rotor]) * (-1 if rotor % 2 else 1)
    raise ValueError(
        f'the zero of {names[rotor]} is off by about {off:.2g} rad; set it upright, to within '
        f'{_OFF_ZERO:g} rad'
    )


def _otherwise(readings: Array) -> NDArray[np.bool_]:
    """Rotors that lean to the side to which none beside them leans, shape (N,)."""
    sides = np.sign(np.sin(np.median(readings, axis=0)))
    padded = np.concatenate([sides[1:2], sides, sides[-2:-1]])
    return np.asarray((padded[:-2] != sides) & (padded[2:] != sides))


def _centres(readings: Array) -> Array:
    """What the staggered angles of each rotor seem to be off by [rad], shape (N,).

    Of flippers that is the middle of both sides, which offsets move and lengths do not; spinners
    turn by half a turn, so that both sides tell the same.
    """
    sine = np.sin(readings)
    certain = np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0)
    turns = np.exp(1j * staggered(readings))
    right, left = (_at_rest(turns, certain & side) for side in (sine > 0, sine < 0))
    if np.median(np.real(right) * np.real(left)) > 0:
        up = np.sign(np.sum(np.real(right + left))) or 1.0
        off = (right + left) * up
    else:
        off = right * np.conj(np.sum(right)) + left * np.conj(np.sum(left))
    both = (np.abs(right) > 0) & (np.abs(left) > 0)
    return np.where(both, np.angle(off), 0.0)


def _at_rest(turns: NDArray[np.complex128], some: NDArray[np.bool_]) -> NDArray[np.complex128]:
    """Direction in which each rotor is most of the time, of some frames, 0 for none, (N,)."""
    weights = some.astype(np.float64)
    for _ in range(_TRIMMINGS):
        means = np.sum(turns * weights, axis=0)
        middle = means / np.maximum(np.abs(means), 1e-9)
        weights = some * np.exp(_NEAR * (np.real(turns * np.conj(middle)) - 1))
    return np.asarray(middle)


def _leaning_over(readings: Array) -> Array:
    """First frame in which each rotor leans over to the side it began not on, NaN if none."""
    sine = np.sin(readings)
    sides = np.where(np.abs(sine) > _LEANING * np.median(np.abs(sine), axis=0), np.sign(sine), 0)
    found = np.full(sides.shape[1], np.nan)
    for rotor, side in enumerate(sides.T):
        certain = np.flatnonzero(side)
        if certain.size:
            over = np.flatnonzero(side == -side[certain[0]])
            found[rotor] = over[0] if over.size else np.nan
    return found


def _check_order(instants: Array, names: Sequence[str]) -> None:
    """Raise ValueError where a wall comes to a rotor later than to both beside it."""
    if len(instants) < 3:
        return
    margin = _OUT_OF_STEP * float(np.median(np.abs(np.diff(instants))))
    late = instants[1:-1] - np.maximum(instants[:-2], instants[2:]) > margin
    if late.any():
        rotor = 1 + int(np.flatnonzero(late)[0])
        beside = rotor + (1 if instants[rotor + 1] > instants[rotor - 1] else -1)
        first, second = sorted((rotor, beside))
        raise ValueError(
            f'the joints are not in the order of the rotors: the soliton comes to {names[first]} '
            f'after {instants[first]:.3g} s and to {names[second]} after '
            f'{instants[second]:.3g} s; swap them, or name the joints from the first to the last'
        )


LEAST_NOISE = 1e-4
"""Noise with which a motion is fitted at least [rad]: better encoders are rounded."""
_SLIPPING = 3.0
"""Largest range of a sum of so many independent numbers, over the root of their number [1], that
chance makes of 40 rotors once in a million recordings."""
_LEAST_SLIP = 2.0
"""Over the noise of a reading [1]: less makes no line in a report."""
_JUMP_FRAMES = 15
"""Over which readings are averaged before and after a jump [1]."""
_JUMP_OF_NOISE = 12.0
"""Bend of the rate over the noise of a reading [1], of which it has 2.2: more is no chance."""
_LEAST_JUMP = 0.1
"""Bend of the rate that no motion makes from frame to frame [rad]."""
_JUMP_OF_NEIGHBOURS = 3.0
"""Jump over the larger one of both neighbours [1]: next to a wall rotors move less unequally."""


def noise_of(readings: Array, spreads: Array) -> float:
    """Noise of readings [rad] by what three in a row leave of a straight line, shape (T, N).

    It is that of a reading whose spread is 1, which are of shape (T, N) too.

    Most rotors are at rest most of the time, and the median does not see the others. It is no less
    than that of rounding to the least step by which readings change, and NaN where there are not
    three.
    """
    bends = readings[2:] - 2 * readings[1:-1] + readings[:-2]
    bends /= np.sqrt(spreads[2:] ** 2 + 4 * spreads[1:-1] ** 2 + spreads[:-2] ** 2)
    sizes = np.abs(bends[np.isfinite(bends)])
    if not len(sizes):
        return math.nan
    return max(robust_deviation(sizes), rounding_noise(readings) / float(np.nanmedian(spreads)))


def check_jumps(recording: Readings, noise: float) -> None:
    """Raise ValueError for an inner rotor that jumps at once while those beside it keep still.

    The noise [rad] is that of a reading whose spread is 1.
    """
    times, readings, spreads = recording.times, recording.whole, recording.spreads
    width = min(_JUMP_FRAMES, len(readings) // 4)
    rates = np.diff(readings, axis=0)
    sudden = np.abs(rates[1:-1] - (rates[:-2] + rates[2:]) / 2)
    sudden /= np.max([spreads[frame : frame + len(sudden)] for frame in range(4)], axis=0)
    steps = np.minimum(_steps(readings, width), sudden[width - 2 : 2 - width])
    beside = np.maximum(steps[:, :-2], steps[:, 2:])
    limit = max(_JUMP_OF_NOISE * noise, _LEAST_JUMP) + _JUMP_OF_NEIGHBOURS * beside
    excess = steps[:, 1:-1] / limit
    frame, rotor = divmod(int(np.argmax(excess)), excess.shape[1])
    if excess[frame, rotor] > 1:
        raise _slipping(
            recording.joints[rotor + 1], steps[frame, rotor + 1], times[frame + width] - times[0]
        )


def _steps(readings: Array, width: int) -> Array:
    """Size of the step from so many frames to as many after them [rad], (T + 1 - 2 width, N)."""
    sums = np.cumsum(np.vstack([np.zeros(readings.shape[1]), readings]), axis=0)
    means = (sums[width:] - sums[:-width]) / width
    return np.asarray(np.abs(means[width:] - means[:-width]))


def check_slips(some: Readings, left: Array, noise: float) -> None:
    """Raise ValueError for an encoder whose residuals have a step.

    Residuals are over the spreads of readings [rad], (T, N), the noise [rad] is that of one.
    """
    single = left / np.sqrt(repeats(some.seen))
    sums = np.cumsum(single - single.mean(axis=0), axis=0) / (noise * math.sqrt(len(left)))
    largest = np.abs(sums).max(axis=0)
    rotor = int(np.argmax(largest))
    frame = int(np.argmax(np.abs(sums[:, rotor]))) + 1
    step = float(left[frame:, rotor].mean() - left[:frame, rotor].mean())
    if largest[rotor] > _SLIPPING and abs(step) > _LEAST_SLIP * noise:
        raise _slipping(some.joints[rotor], step, some.times[frame] - some.times[0])


def _slipping(name: str, step: float, time: float) -> ValueError:
    return ValueError(
        f'the encoder of {name} slips by about {abs(step):.2g} rad at {time:.3g} s; fasten it and '
        'record again'
    )
