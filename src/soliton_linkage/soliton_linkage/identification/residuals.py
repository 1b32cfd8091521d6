# SPDX-License-Identifier: Apache-2.0
"""What a chain leaves of the readings: noise, and what is more than that."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.identification.readings import Readings
from soliton_linkage.identification.rounding import repeats, rounding_noise
from soliton_linkage.linkage.chain import Array

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
