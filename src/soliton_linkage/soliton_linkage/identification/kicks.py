# SPDX-License-Identifier: Apache-2.0
"""Search for kicks that were not recorded, and fits of the free motions before and after them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import uniform_filter1d

from soliton_linkage.identification.motion_fit import MotionFit, MotionFitter
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.identification.windows import ARRIVAL
from soliton_linkage.linkage.chain import Array

_MOST_KICKS = 3
"""Largest number of unrecorded kicks that are searched [1]; each search requires another fit."""
_KICK_FRAMES = 7
"""Number of successive frames whose residuals are averaged in the search for a kick."""
_BEFORE_KICK = 0.06
"""Frames less than this before an estimated kick are not used [s]. Frames less than `ARRIVAL`
after the kick are not used either."""
_SUSPICIOUS = 1.05
"""A kick is suspected if the ratio of residual noise to reading noise is larger than this [1]."""
_KICKED = 5.5
"""A kick is suspected if a mean residual of `_KICK_FRAMES` frames is larger than this [standard
deviations]. It is accepted if it improves the likelihood by more than chance would, with the same
threshold."""
_STEP_NOISE = 0.02
"""Speeds are averaged over so many frames that noise causes steps with this standard deviation,
relative to the root mean square speed [1]. Sensitivity: in 14 of 16 recordings with a random kick,
the largest step is the kick; at 2x, in 12; at 0.5x, in 14."""
_FEWEST = 8
"""Smallest number of frames before a step, and also after it, from which the speeds are computed
[1]."""
_SMALLEST_STEP = 0.08
"""A kick is suspected at a step of the speed that is larger than this, relative to the root mean
square speed [1]. Elastic vibrations also cause steps of 7 % to 15 %. Therefore a kick is accepted
only if a fit confirms it."""
_AT_REST = 1e-3
"""Smallest speed by which changes of the speed are divided, relative to the root mean square speed
[1]; it prevents a division by 0 while the chain is at rest."""

_Fitted = tuple[MotionFitter, MotionFit] | str


def fit_around_kicks(
    some: Readings, fit: Callable[[Readings], _Fitted], noise: float, bar_noise: float
) -> tuple[_Fitted, list[float]]:
    """Find unrecorded kicks and fit springs to the motions between them; return fit and times [s].

    The result contains the times of the kicks. The function `fit` fits springs to readings, and
    returns a text if springs do not fit. `noise` is the reading noise, and `bar_noise` is the
    residual noise of a fit of rigid bars [rad].
    """
    kicks: list[float] = []
    fitted = fit(some)
    while len(kicks) < _MOST_KICKS:
        for time in _possible_kicks(some, fitted, noise):
            around = [RecordedImpulse(time - _BEFORE_KICK), RecordedImpulse(time)]
            without = replace(some, impulses=[*some.impulses, *around])
            better = fit(without)
            if _explains_more(better, fitted, bar_noise, some.angles.size):
                break
        else:
            break
        some, fitted = without, better
        kicks.append(time)
    return fitted, kicks


def _explains_more(better: _Fitted, fitted: _Fitted, bar_noise: float, readings: int) -> bool:
    if isinstance(better, str):
        return False
    after, rotors = better[1].noise, better[1].residuals.shape[1]
    if isinstance(fitted, str):
        return bar_noise > _SUSPICIOUS * after
    gain = 2 * readings * math.log(fitted[1].noise / after)
    spreads = fitted[1].prior.mass_deviation / better[1].prior.mass_deviation
    gain += 2 * (2 * rotors - 3) * math.log(spreads)
    # By chance, an additional initial state reduces the sum of squares by 2 N, with variance 4 N.
    return bool(gain > 2 * rotors + _KICKED * math.sqrt(4 * rotors))


def _possible_kicks(some: Readings, fitted: _Fitted, noise: float) -> Iterator[float]:
    time, step = largest_step(some, noise)
    if abs(step) > _SMALLEST_STEP:
        yield time
    if not isinstance(fitted, str):
        frame, excess = _worst_frames(fitted[1])
        if excess >= 1 or fitted[1].noise >= _SUSPICIOUS * noise:
            yield float(some.times[frame])


def largest_step(some: Readings, noise: float) -> tuple[float, float]:
    """Return the time [s] and the size of the largest sudden change of the speed of a chain.

    The speed is the rate at which the vector of all angles moves along its path. The size is
    relative to the root mean square speed [1]; it is 0 if there are too few frames. A kick changes
    the speed at once, whereas unequal masses and springs change it slowly. Changes at known
    impulses and at changes of the tilt are ignored. `noise` is the reading noise [rad].
    """
    times, angles = some.times, some.filled
    if len(times) < 2 * _FEWEST:
        return float(times[0]), 0.0
    interval = float(np.median(np.diff(times)))
    paths = np.linalg.norm(angles[_FEWEST:] - angles[:-_FEWEST], axis=1)
    speed = math.sqrt(float(np.mean((paths / (times[_FEWEST:] - times[:-_FEWEST])) ** 2)))
    # The difference of slopes over n frames has the variance 24 (noise / interval)^2 / n^3.
    uncertainty = noise / (interval * speed * _STEP_NOISE)
    count = max(_FEWEST, round((24 * uncertainty**2) ** (1 / 3)))
    if len(times) < 2 * count:
        return float(times[0]), 0.0
    rates = _slopes(times, angles, count)
    before, after = rates[:-count], rates[count:]
    means = (before + after) / 2
    sizes = np.maximum(np.linalg.norm(means, axis=1), _AT_REST * speed)
    steps = np.sum((after - before) * means, axis=1) / (sizes * speed)
    ends = np.sort(some.interruptions)
    first = np.searchsorted(ends, times[: len(steps)] - ARRIVAL)
    steps[first != np.searchsorted(ends, times[2 * count - 1 :])] = 0.0
    frame = int(np.argmax(np.abs(steps)))
    return float(times[frame + count]), float(steps[frame])


def _slopes(times: Array, angles: Array, count: int) -> Array:
    """Return the slopes of the lines that fit `count` successive angles, (T - count + 1, N)."""
    weights = sliding_window_view(times, count)
    weights = weights - weights.mean(axis=1, keepdims=True)
    weights = weights / np.sum(weights**2, axis=1, keepdims=True)
    windows = sliding_window_view(angles, count, axis=0)
    return np.asarray(np.einsum('tnc,tc->tn', windows, weights))


def _worst_frames(fitted: MotionFit) -> tuple[int, float]:
    means = np.abs(uniform_filter1d(fitted.residuals, _KICK_FRAMES, axis=0))
    frame = int(np.argmax(means.max(axis=1)))
    return frame, float(means[frame].max() * math.sqrt(_KICK_FRAMES) / (_KICKED * fitted.noise))
