# SPDX-License-Identifier: Apache-2.0
"""Search for kicks that were not recorded, and fits of the free motions before and after them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.stats import chi2

from soliton_linkage.identification.encoder_errors import EncoderFault, encoder_fault
from soliton_linkage.identification.free_motion import propagate
from soliton_linkage.identification.motion_fit import UNEXPLAINED, MotionFit, MotionFitter
from soliton_linkage.identification.readings import Readings, RecordedImpulse
from soliton_linkage.identification.windows import (
    ARRIVAL,
    FEWEST_FRAMES,
    FreeWindow,
    free_intervals,
    windows_around,
)
from soliton_linkage.linkage.chain import Array

_MOST_KICKS = 3
"""Largest number of unrecorded kicks that are searched for [1]; each requires another fit."""
_CANDIDATES = 5
"""A kick is tried at this number of the largest sudden changes of the speed [1]."""
_BEFORE_KICK = 0.06
"""Frames are not used from this time before an estimated kick [s], because the time of the kick is
uncertain. They are used again when the time `windows.ARRIVAL`, the largest delay of an impulse,
has passed after the kick."""
_SUSPICIOUS = 1.05
"""If springs do not fit without a kick, a kick is accepted only if the residual noise of rigid
bars is at least this times the residual noise of springs with the kick [1]."""
_FALSE_ALARM = 0.02
"""A kick is assumed if a test for it has a significant result. The limit is such that, with this
probability [1], at least one of all tests of a recording without a kick has such a result."""
_SMALLEST_KICK = 1e-3
"""A kick is neglected if it changes the vector of all rates by less than this fraction [1]. In
readings without noise, errors of the integration imitate such a kick."""
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


class _KickTest(NamedTuple):
    """Test of the hypothesis that a kick acts at a given time [s]."""

    time: float
    decrease: float
    """Decrease of -2 log likelihood [1]."""
    unknowns: int
    """Number of unknowns that describe the kick."""
    log_probability: float
    """Logarithm of the probability of a larger decrease if no kick acts."""

    @classmethod
    def of(cls, time: float, decrease: float, unknowns: int) -> _KickTest:
        """Return a test; without a kick, its decrease has a chi-squared distribution."""
        return cls(time, decrease, unknowns, float(chi2.logsf(decrease, unknowns)))


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
        if not explained and _explains(better, noise):
            # The fit without this kick may have been a local minimum.
            part = _without(some, kicks)
            whole = fit(part, _windows_over(part, better))
            if _explains(whole, noise):
                fitted = whole
                continue
        if kicks:
            # The earlier kicks may only have imitated this one.
            part = _without(some, [time])
            alone = fit(part, _windows_over(part, better))
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


def _windows_over(some: Readings, fitted: _Fitted) -> _Windows:
    """Return the windows of a fit, extended to all frames of free motion; none if impossible."""
    windows = () if isinstance(fitted, str) else fitted[1].windows
    extended: list[FreeWindow] = []
    for interval in free_intervals(some.times, some.interruptions):
        inside = [each for each in windows if interval.start <= each.frames.start < interval.stop]
        if not inside:
            return ()
        begins = [interval.start, *(each.frames.start for each in inside[1:]), interval.stop]
        for each, (begin, end) in zip(inside, pairwise(begins), strict=True):
            motion = propagate(each.motion, some.times[[each.frames.start, begin]])[1]
            extended.append(FreeWindow(slice(begin, end), motion))
    return extended


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
    if isinstance(fitted, str):
        time, size = next(largest_steps(some, noise))
        return [time] if abs(size) > _SMALLEST_STEP else [], False
    tests = sorted(_tests(fitted[0]), key=lambda each: each.log_probability)
    limit = math.log(_FALSE_ALARM / max(len(tests), 1))
    tests = [each for each in tests if each.log_probability < limit]
    fault = _encoder_fault(some, fitted) if tests else None
    # Akaike's criterion: the decrease minus twice the number of additional unknowns.
    largest = max((each.decrease - 2 * each.unknowns for each in tests), default=0.0)
    doubtful = fault is not None and fault.decrease - 2 > largest
    times: list[float] = []
    for each in tests:
        if all(abs(each.time - time) > _BEFORE_KICK + ARRIVAL for time in times):
            times.append(each.time)
    return times, doubtful


def _tests(fitter: MotionFitter) -> list[_KickTest]:
    """Return tests of a kick that changes all rates in proportion, or independently.

    A third test compares two adjacent windows with one free motion through both.
    """
    tests, states = list[_KickTest](), 0
    for time, rates, _, matrix, score in fitter.rate_changes():
        weight, rotors = float(rates @ matrix @ rates), len(rates)
        alike = float(rates @ score) / max(weight, 1e-30) * rates
        for change, unknowns in ((alike, 1), (np.linalg.solve(matrix, score), rotors)):
            if np.linalg.norm(change) > _SMALLEST_KICK * np.linalg.norm(rates):
                tests.append(_KickTest.of(time, float(score @ change), unknowns))
        states = 2 * rotors
    return tests + [_KickTest.of(*each, states) for each in fitter.decreases_at_boundaries()]


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
