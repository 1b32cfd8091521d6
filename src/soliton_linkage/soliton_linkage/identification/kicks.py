# SPDX-License-Identifier: Apache-2.0
"""Search for kicks that were not recorded, and fits of the motions between these kicks."""

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
"""Time before an estimated kick [s]; its frames, and those in 0.05 s after the kick, are not
used."""
_SUSPICIOUS = 1.05
"""Ratio of residual noise to reading noise above which a kick is searched [1]."""
_KICKED = 5.5
"""Mean residual of `_KICK_FRAMES` frames above which a kick is assumed [standard deviations]."""
_STEP_NOISE = 0.02
"""Standard deviation of a step of the speed along the orbit, relative to the speed [1].
Sensitivity: of 16 random kicks, 14 are the largest step; at 2x, 12; at 0.5x, 14."""
_FEWEST = 8
"""Smallest number of frames on each side of a step [1]."""
_SMALLEST_STEP = 0.08
"""Smallest relative step of the speed at which a kick is searched [1]. Elastic vibrations cause
steps of 7 % to 15 %, so that each step is checked by a fit."""
_AT_REST = 1e-3
"""Speed, relative to the root mean square speed, below which a chain is at rest [1]."""

_Fitted = tuple[MotionFitter, MotionFit] | str


def fit_around_kicks(
    some: Readings, fit: Callable[[Readings], _Fitted], noise: float, bar_noise: float
) -> tuple[_Fitted, list[float]]:
    """Fit springs to the motions between kicks; return the fit and the times of the kicks [s].

    The function `fit` returns a text if springs do not fit. `noise` is the reading noise and
    `bar_noise` the residual noise of the fit of bars [rad].
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
    """Return the time [s] and the size of the largest step of the speed along the orbit.

    The step is relative to the root mean square speed [1]; it is 0 if there are too few frames. A
    kick changes this speed at once, but unequal masses and springs change it slowly. Frames near
    known impulses are not searched. `noise` is the reading noise [rad].
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
    """Return the slopes of lines through `count` successive frames, (T - count + 1, N)."""
    weights = sliding_window_view(times, count)
    weights = weights - weights.mean(axis=1, keepdims=True)
    weights = weights / np.sum(weights**2, axis=1, keepdims=True)
    windows = sliding_window_view(angles, count, axis=0)
    return np.asarray(np.einsum('tnc,tc->tn', windows, weights))


def _worst_frames(fitted: MotionFit) -> tuple[int, float]:
    means = np.abs(uniform_filter1d(fitted.residuals, _KICK_FRAMES, axis=0))
    frame = int(np.argmax(means.max(axis=1)))
    return frame, float(means[frame].max() * math.sqrt(_KICK_FRAMES) / (_KICKED * fitted.noise))
