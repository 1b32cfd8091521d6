# SPDX-License-Identifier: Apache-2.0
"""The mean mass, by what pushes of known impulses did to the rates of rotors.

Free motion shows masses and stiffnesses but for one common factor. An angular impulse J_n changes
the rate of rotor n by J_n / (M m_n r_n^2), with the mean mass M. Where the chain is before pushes
in a row, by how much later they arrive and what they do are found by least squares with the
readings about them. A torque that lasts is a push at each frame. It leads the chain far from where
it had gone by itself, and what it does to the rates tells nothing of M to begin with: the work of
the pushes does, nearly all of which becomes kinetic energy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.identification.free_motion import (
    FreeMotion,
    followed,
    frames,
    split_chain,
)
from soliton_linkage.identification.motion_fit import MotionFit
from soliton_linkage.identification.readings import Readings, repeats
from soliton_linkage.identification.windows import FreeWindow
from soliton_linkage.linkage.chain import Array

_BEFORE = 50
"""Frames before a push that count [1]: twice as many tell rates three times as well."""
_AFTER = 25
"""Frames after it that count [1], in which most of what a push does is seen."""
_MOST = 5
"""Rows of pushes that are looked at [1]: a second of computing each."""
_LONGEST = 500
"""Frames from free motion to free motion about pushes [1]: beyond, what was known of the motion
before is no help to know that after."""


class RateStep(NamedTuple):
    """What a push does at its instant."""

    time: float
    """[s]."""
    change: Array
    """Of the rates [rad/s], shape (N,)."""


class MassScale(NamedTuple):
    """What pushes tell of the mean mass."""

    mass: float
    """[kg]."""
    deviation: float
    """Standard deviation of its logarithm [1]."""


def mass_scale(fitted: MotionFit, readings: Readings, spacing: float) -> MassScale | None:
    """Mean mass, None where no push of known impulses was between two free motions.

    For a mean spacing of pivots [m]; readings are those by which the motion was fitted.
    """
    shown: list[tuple[float, float, float]] = []
    for before, after in pairwise(fitted.windows):
        pushes = _pushes_between(readings, before, after)
        if pushes and len(shown) < _MOST:
            found = _of_pushes(fitted, readings, before, after, pushes, spacing)
            shown += [] if found is None else [found]
    if not shown:
        return None
    logarithms, variances, of_chain = (np.array(part) for part in zip(*shown, strict=True))
    weights = (1 / variances) / np.sum(1 / variances)
    variance = 1 / np.sum(1 / variances) + weights @ of_chain
    return MassScale(math.exp(-weights @ logarithms), math.sqrt(variance))


def _pushes_between(
    readings: Readings, before: FreeWindow, after: FreeWindow
) -> list[tuple[float, Array]]:
    """Times and impulses between windows, none where one is not known or they last too long."""
    first, last = before.frames.stop, after.frames.start
    begin, end = readings.times[first - 1], readings.times[last]
    pushes = sorted(
        (push for push in readings.impulses if begin <= push.time <= end),
        key=lambda each: each.time,
    )
    known = [(push.time, push.values) for push in pushes if push.values is not None]
    return known if len(known) == len(pushes) and last - first <= _LONGEST else []


def _of_pushes(
    fitted: MotionFit,
    readings: Readings,
    before: FreeWindow,
    after: FreeWindow,
    pushes: Sequence[tuple[float, Array]],
    spacing: float,
) -> tuple[float, float, float] | None:
    """Logarithm of 1 / M, its variance by these pushes, and by what is unsure of the chain.

    None where rates and energy change against the pushes.
    """
    times = readings.times
    first, last = before.frames.stop, after.frames.start
    begin = max(before.frames.start, first - _BEFORE)
    motion = followed(before.motion, times[before.frames.start : begin + 1])[1]
    some = slice(begin, min(last + _AFTER, after.frames.stop))
    inertias = motion.masses * (spacing * motion.lengths.rotor_lengths) ** 2
    steps = [RateStep(time, impulses / inertias) for time, impulses in pushes]
    ahead = followed(motion, times[begin : last + 1])[1]
    kick = np.sum([step.change for step in steps], axis=0)
    of_momentum = float((after.motion.rates - ahead.rates) @ kick / (kick @ kick))
    gained = inertias @ (after.motion.rates**2 - motion.rates**2) / 2
    of_energy = float(gained) / _work(times[some], readings.whole[some], pushes)
    guesses = [guess for guess in (of_momentum, of_energy) if guess > 0]
    if not guesses:
        return None
    read, repeated = readings.seen[some] - motion.lengths.offsets, repeats(readings.seen)[some]
    deviations = fitted.noise * readings.spreads[some] * np.sqrt(repeated)
    seen = np.isfinite(read)
    rotors = len(kick)

    def left(unknowns: Array) -> Array:
        moved = replace(
            motion,
            angles=motion.angles + unknowns[:rotors],
            rates=motion.rates + unknowns[rotors:-2],
        )
        late, factor = unknowns[-2], math.exp(unknowns[-1])
        made = [RateStep(step.time + late, factor * step.change) for step in steps]
        return np.asarray(((read - _pushed(moved, times[some], made)) / deviations)[seen])

    starts = np.zeros((len(guesses), 2 * rotors + 2))
    starts[:, -1] = np.log(guesses)
    unknowns = min(starts, key=lambda start: float(np.sum(left(start) ** 2)))
    solution = least_squares(left, unknowns, method='lm')
    freedom = np.maximum((seen / repeated).sum(axis=0) - 2, 0).sum() - 2
    excess = max(1.0, 2 * solution.cost / max(freedom, 1.0))
    covariance = excess * np.linalg.inv(solution.jac.T @ solution.jac)
    shares = kick**2 / (kick @ kick)
    slopes = np.zeros(len(fitted.covariance))
    of_chain = split_chain(slopes)
    of_chain['rotor_length'][:], of_chain['mass'][:] = 2 * shares, shares
    return (
        float(solution.x[-1]),
        float(covariance[-1, -1]),
        float(slopes @ fitted.covariance @ slopes),
    )


def _work(times: Array, angles: Array, pushes: Sequence[tuple[float, Array]]) -> float:
    """Work of pushes at rotors that turn as angles do [J], infinite for none."""
    rates = np.gradient(angles, times, axis=0)
    instants = np.searchsorted(times, [time for time, _ in pushes])
    work = float(np.sum(np.array([impulses for _, impulses in pushes]) * rates[instants]))
    return work or math.inf


def _pushed(motion: FreeMotion, times: Array, steps: Sequence[RateStep]) -> Array:
    """Angles at each time [rad], (T, N), of a motion with steps of its rates."""
    parts, now, passed = [], float(times[0]), 0
    for step in steps:
        instant = min(max(step.time, now), float(times[-1]))
        arrived = passed + int(np.searchsorted(times[passed:], instant))
        angles, there = followed(motion, np.array([now, *times[passed:arrived], instant]))
        parts.append(angles[1:-1])
        motion = replace(there, rates=there.rates + step.change)
        now, passed = instant, arrived
    return np.concatenate([*parts, frames(motion, np.array([now, *times[passed:]]))[1:]])
