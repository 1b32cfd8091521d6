# SPDX-License-Identifier: Apache-2.0
"""Search for kicks that were not recorded, and fits of the free motions before and after them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import uniform_filter1d

from soliton_linkage.identification.encoder_errors import EncoderFault, encoder_fault
from soliton_linkage.identification.motion_fit import UNEXPLAINED, MotionFit, MotionFitter
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.identification.windows import (
    ARRIVAL,
    FEWEST_FRAMES,
    FreeWindow,
    windows_around,
)
from soliton_linkage.linkage.chain import Array

_MOST_KICKS = 3
"""Largest number of unrecorded kicks that are searched for [1]; each requires another fit."""
_CANDIDATES = 5
"""A kick is tried at this number of the largest sudden changes of the speed [1]."""
_KICK_FRAMES = 7
"""Number of successive frames whose residuals are averaged in the search for a kick."""
_BEFORE_KICK = 0.06
"""Frames are not used from this time before an estimated kick [s], because the time of the kick is
uncertain. They are used again when the time `windows.ARRIVAL`, the largest delay of an impulse,
has passed after the kick."""
_SUSPICIOUS = 1.05
"""If springs do not fit without a kick, a kick is accepted only if the residual noise of rigid
bars is at least this times the residual noise of springs with the kick [1]."""
_KICKED = 5.5
"""A kick is assumed if a separate initial state after it decreases -2 log likelihood
significantly. The limit is the decrease that is expected without a kick, plus this number of
standard deviations of this decrease [1]."""
_STEP_NOISE = 0.02
"""The speed before and after a possible kick is averaged over so many frames that its standard
deviation due to noise is this fraction of the root mean square speed [1]. Sensitivity: in 14 of 16
recordings, the largest change of the speed is at the kick; with half this value, this is also so
in 14 recordings, and with twice this value in 12."""
_FEWEST = 8
"""Smallest number of frames over which the speed on each side of a kick is averaged [1]."""
_SMALLEST_STEP = 0.08
"""If springs do not fit without a kick, a kick is tried only at a change of the speed by more than
this fraction of the root mean square speed [1]."""
_AT_REST = 1e-3
"""The direction of motion is the vector of the rates divided by its norm. Because the norm
vanishes at rest, the divisor is at least this times the root mean square speed [1]."""

_TRIED = 3
"""If no fit explains the readings yet, this number of possible kicks is tried [1]. The fit may be
a local minimum. Then a frame after the kick often seems the most probable."""

_NEAR = 1.2
"""A fit without the frames near a kick continues from the previous fit if the noise of the latter
is at most this times the reading noise [1]. Otherwise, the previous fit may be a local minimum,
which the fit would leave only after many steps."""

_Fitted = tuple[MotionFitter, MotionFit] | str
_Windows = Sequence[FreeWindow]


def fit_around_kicks(
    some: Readings, fit: Callable[[Readings, _Windows], _Fitted], noise: float, bar_noise: float
) -> tuple[_Fitted, list[float]]:
    """Find unrecorded kicks; return a fit without the frames near them, and their times [s].

    The function `fit` fits springs to readings, and returns a text if springs do not fit. Its
    second argument contains windows from which the fit begins, or is empty. `noise` is the reading
    noise, and `bar_noise` is the residual noise of a fit of rigid bars [rad].
    """
    kicks: list[float] = []
    fitted = fit(some, ())
    while len(kicks) < _MOST_KICKS:
        explained = _explains(fitted, noise)
        times, doubtful = _possible_kicks(_without(some, kicks), fitted, noise)
        for time in times[: 1 if explained else _TRIED]:
            part = _without(some, [*kicks, time])
            better = fit(part, _windows_without(some, fitted, time, noise))
            if _is_better(better, fitted, noise, bar_noise) and not (
                doubtful and _encoder_fault(part, better)
            ):
                break
        else:
            break
        if kicks:
            # The earlier kicks may only have imitated this one.
            part = _without(some, [time])
            alone = fit(part, ())
            if _explains(alone, noise) and not _possible_kicks(part, alone, noise)[0]:
                return alone, [time]
        fitted, kicks = better, [*kicks, time]
    return fitted, kicks


def _explains(fitted: _Fitted, noise: float) -> bool:
    return not isinstance(fitted, str) and fitted[1].noise < UNEXPLAINED * noise


def _is_better(fitted: _Fitted, before: _Fitted, noise: float, bar_noise: float) -> bool:
    if isinstance(fitted, str):
        return False
    if isinstance(before, str):
        return bar_noise > _SUSPICIOUS * fitted[1].noise
    return _explains(before, noise) or _explains(fitted, noise)


def _encoder_fault(some: Readings, fitted: _Fitted) -> EncoderFault | None:
    return (
        None if isinstance(fitted, str) else encoder_fault(some.joints, *fitted[0].error_scores())
    )


def _windows_without(some: Readings, fitted: _Fitted, time: float, noise: float) -> _Windows:
    if isinstance(fitted, str) or fitted[1].noise > _NEAR * noise:
        return ()
    ends = np.searchsorted(some.times, [time - _BEFORE_KICK, time + ARRIVAL]).tolist()
    return windows_around(fitted[1].windows, some.times, ends[0], ends[1], FEWEST_FRAMES)


def _without(some: Readings, kicks: Sequence[float]) -> Readings:
    """Return readings in which no free motion contains frames near `kicks` [s].

    For this, two impulses of unknown size are added for each kick: one at its time, and one
    `_BEFORE_KICK` earlier. A free motion ends at an impulse, and the next one begins `ARRIVAL`
    after it.
    """
    around = [RecordedImpulse(time - before) for time in kicks for before in (_BEFORE_KICK, 0.0)]
    return replace(some, impulses=[*some.impulses, *around])


def _possible_kicks(some: Readings, fitted: _Fitted, noise: float) -> tuple[list[float], bool]:
    """Return the times of possible kicks [s], and whether an encoder error is more probable."""
    steps = list(largest_steps(some, noise))
    if isinstance(fitted, str):
        time, size = steps[0]
        return [time] if abs(size) > _SMALLEST_STEP else [], False
    fitter, fit = fitted
    times = np.array([*(time for time, _ in steps), some.times[_worst_frame(fit)]])
    frames = np.searchsorted(some.times, [times - _BEFORE_KICK, times + ARRIVAL])
    gains = np.array(fitter.gains_by_kicks(frames.T.tolist()))
    # Without a kick, another initial state reduces the sum of squares by 2 N, with variance 4 N.
    unknowns = 2 * fit.residuals.shape[1]
    order = np.argsort(-gains)
    order = order[gains[order] > unknowns + _KICKED * math.sqrt(2 * unknowns)]
    fault = _encoder_fault(some, fitted) if len(order) else None
    # Akaike's criterion: the decrease minus twice the number of additional unknowns.
    doubtful = fault is not None and fault.decrease - 2 > gains.max() - 2 * unknowns
    return times[order].tolist(), doubtful


def largest_steps(some: Readings, noise: float) -> Iterator[tuple[float, float]]:
    """Yield times [s] and sizes of the largest sudden changes of the speed, largest first.

    The speed is the rate at which the vector of all angles moves along its path. The size is the
    change of the speed, divided by the root mean square speed [1]. If there are too few frames,
    the size is 0. A kick changes the speed at once, whereas unequal masses and springs change it
    slowly. Changes at known impulses and tilts are ignored. `noise` is the reading noise [rad].
    """
    times, steps = _steps(some, noise)
    for _ in range(_CANDIDATES):
        frame = int(np.argmax(np.abs(steps)))
        yield float(times[frame]), float(steps[frame])
        steps[np.abs(times - times[frame]) < _BEFORE_KICK + ARRIVAL] = 0.0


def _steps(some: Readings, noise: float) -> tuple[Array, Array]:
    times, angles = some.times, some.filled
    if len(times) < 2 * _FEWEST:
        return times[:1], np.zeros(1)
    interval = float(np.median(np.diff(times)))
    paths = np.linalg.norm(angles[_FEWEST:] - angles[:-_FEWEST], axis=1)
    speed = math.sqrt(float(np.mean((paths / (times[_FEWEST:] - times[:-_FEWEST])) ** 2)))
    # The difference of slopes over n frames has the variance 24 (noise / interval)^2 / n^3.
    uncertainty = noise / (interval * speed * _STEP_NOISE)
    count = max(_FEWEST, round((24 * uncertainty**2) ** (1 / 3)))
    if len(times) < 2 * count:
        return times[:1], np.zeros(1)
    rates = _slopes(times, angles, count)
    before, after = rates[:-count], rates[count:]
    means = (before + after) / 2
    sizes = np.maximum(np.linalg.norm(means, axis=1), _AT_REST * speed)
    steps = np.sum((after - before) * means, axis=1) / (sizes * speed)
    ends = np.sort(some.interruptions)
    first = np.searchsorted(ends, times[: len(steps)] - ARRIVAL)
    steps[first != np.searchsorted(ends, times[2 * count - 1 :])] = 0.0
    return times[count : count + len(steps)], steps


def _slopes(times: Array, angles: Array, count: int) -> Array:
    weights = sliding_window_view(times, count)
    weights = weights - weights.mean(axis=1, keepdims=True)
    weights = weights / np.sum(weights**2, axis=1, keepdims=True)
    windows = sliding_window_view(angles, count, axis=0)
    return np.asarray(np.einsum('tnc,tc->tn', windows, weights))


def _worst_frame(fitted: MotionFit) -> int:
    means = np.abs(uniform_filter1d(fitted.residuals, _KICK_FRAMES, axis=0))
    return int(np.argmax(means.max(axis=1)))
