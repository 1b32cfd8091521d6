# SPDX-License-Identifier: Apache-2.0
"""Estimation of the mean mass from impulses of known size and the changes of rates they cause.

An impulse J_n changes the rate of rotor n by J_n / (M m_n r_n^2), with the mean mass M, the
relative mass m_n and the rotor length r_n. A fit to the readings near the impulses estimates M,
the state before the impulses, and the delay of the impulses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.identification.free_motion import (
    FreeMotion,
    angles_at,
    propagate,
    split_chain,
)
from soliton_linkage.identification.motion_fit import MotionFit
from soliton_linkage.identification.readings import Readings, repeat_counts
from soliton_linkage.identification.windows import FreeWindow
from soliton_linkage.linkage.chain import Array

_BEFORE = 50
"""Number of fitted frames before the impulses; with twice this number, the initial rates would be
3 times as precise, but the fits would take longer."""
_AFTER = 25
"""Number of fitted frames after the impulses; they show most of the effect of the impulses."""
_MOST = 5
"""Largest number of fits [1]. Each fit uses all impulses between two successive free motions, and
takes a second."""
_LONGEST = 500
"""Impulses are used if at most this many frames separate the free motions before and after
them."""


def mass_scale(
    fitted: MotionFit, readings: Readings, spacing: float
) -> tuple[float, float] | None:
    """Return the mean mass [kg] and the standard deviation of its log [1]; None if unknown.

    `spacing` is the mean spacing [m].
    """
    found: list[tuple[float, float, float]] = []
    for before, after in pairwise(fitted.windows):
        impulses = _impulses_between(readings, before, after)
        if impulses and len(found) < _MOST:
            estimate = _by_impulses(fitted, readings, before, after, impulses, spacing)
            found += [] if estimate is None else [estimate]
    if not found:
        return None
    logarithms, variances, chain = (np.array(part) for part in zip(*found, strict=True))
    weights = (1 / variances) / np.sum(1 / variances)
    variance = 1 / np.sum(1 / variances) + weights @ chain
    return math.exp(-weights @ logarithms), math.sqrt(variance)


def _impulses_between(
    readings: Readings, before: FreeWindow, after: FreeWindow
) -> list[tuple[float, Array]]:
    first, last = before.frames.stop, after.frames.start
    begin, end = readings.times[first - 1], readings.times[last]
    some = sorted(
        (each for each in readings.impulses if begin <= each.time <= end),
        key=lambda each: each.time,
    )
    known = [(each.time, each.values) for each in some if each.values is not None]
    return known if len(known) == len(some) and last - first <= _LONGEST else []


def _by_impulses(
    fitted: MotionFit,
    readings: Readings,
    before: FreeWindow,
    after: FreeWindow,
    impulses: Sequence[tuple[float, Array]],
    spacing: float,
) -> tuple[float, float, float] | None:
    """Return log(1 / M), its variance due to noise, and its variance due to the fitted chain."""
    times = readings.times
    first, last = before.frames.stop, after.frames.start
    begin = max(before.frames.start, first - _BEFORE)
    motion = propagate(before.motion, times[before.frames.start : begin + 1])[1]
    some = slice(begin, min(last + _AFTER, after.frames.stop))
    inertias = motion.masses * (spacing * motion.lengths.rotor_lengths) ** 2
    steps = [(time, values / inertias) for time, values in impulses]
    ahead = propagate(motion, times[begin : last + 1])[1]
    kick = np.sum([change for _, change in steps], axis=0)
    by_momentum = float((after.motion.rates - ahead.rates) @ kick / (kick @ kick))
    gained = inertias @ (after.motion.rates**2 - motion.rates**2) / 2
    by_energy = float(gained) / _work(times[some], readings.filled[some], impulses)
    initial = [value for value in (by_momentum, by_energy) if value > 0]
    if not initial:
        return None
    read = readings.unwrapped[some] - motion.lengths.offsets
    repeated = repeat_counts(readings.unwrapped)[some]
    deviations = fitted.noise * readings.relative_deviations[some] * np.sqrt(repeated)
    seen = np.isfinite(read)
    rotors = len(kick)

    def residuals(unknowns: Array) -> Array:
        moved = replace(
            motion,
            angles=motion.angles + unknowns[:rotors],
            rates=motion.rates + unknowns[rotors:-2],
        )
        delay, factor = unknowns[-2], math.exp(unknowns[-1])
        late = [(time + delay, factor * change) for time, change in steps]
        return np.asarray(((read - _kicked(moved, times[some], late)) / deviations)[seen])

    starts = np.zeros((len(initial), 2 * rotors + 2))
    starts[:, -1] = np.log(initial)
    unknowns = min(starts, key=lambda start: float(np.sum(residuals(start) ** 2)))
    solution = least_squares(residuals, unknowns, method='lm')
    freedom = np.maximum((seen / repeated).sum(axis=0) - 2, 0).sum() - 2
    excess = max(1.0, 2 * solution.cost / max(freedom, 1.0))
    covariance = excess * np.linalg.inv(solution.jac.T @ solution.jac)
    weights = kick**2 / (kick @ kick)
    slopes = np.zeros(len(fitted.covariance))
    parts = split_chain(slopes)
    parts['rotor_length'][:], parts['mass'][:] = 2 * weights, weights
    return (
        float(solution.x[-1]),
        float(covariance[-1, -1]),
        float(slopes @ fitted.covariance @ slopes),
    )


def _work(times: Array, angles: Array, impulses: Sequence[tuple[float, Array]]) -> float:
    rates = np.gradient(angles, times, axis=0)
    frames = np.searchsorted(times, [time for time, _ in impulses])
    work = float(np.sum(np.array([values for _, values in impulses]) * rates[frames]))
    return work or math.inf


def _kicked(motion: FreeMotion, times: Array, steps: Sequence[tuple[float, Array]]) -> Array:
    parts, now, passed = [], float(times[0]), 0
    for time, change in steps:
        arrival = min(max(time, now), float(times[-1]))
        following = passed + int(np.searchsorted(times[passed:], arrival))
        angles, there = propagate(motion, np.array([now, *times[passed:following], arrival]))
        parts.append(angles[1:-1])
        motion = replace(there, rates=there.rates + change)
        now, passed = arrival, following
    return np.concatenate([*parts, angles_at(motion, np.array([now, *times[passed:]]))[1:]])
