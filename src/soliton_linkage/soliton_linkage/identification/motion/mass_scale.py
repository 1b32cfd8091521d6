# SPDX-License-Identifier: Apache-2.0
"""The mean mass, by what pushes of known impulses did to the rates of rotors.

Free motion shows masses and stiffnesses but for one common factor. An angular impulse J_n changes
the rate of rotor n by J_n / (M m_n r_n^2), with the mean mass M. Where the chain is before a push,
when that arrives and what it does are found by least squares with the readings about it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from soliton_linkage.identification.motion.free_motion import (
    FreeMotion,
    followed,
    frames,
    split_chain,
)
from soliton_linkage.identification.motion.motion_fit import MotionFit
from soliton_linkage.identification.readings import Readings
from soliton_linkage.linkage.chain import Array

_BEFORE = 50
"""Frames before a push that count [1]: twice as many tell rates three times as well."""
_AFTER = 25
"""Frames after it that count [1], in which most of what a push does is seen."""
_MOST = 5
"""Pushes that are looked at [1]: a second of computing each."""


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
    found = [
        _of_push(fitted, readings, push.time, push.impulses / spacing**2)
        for push in readings.pushes
        if push.impulses is not None
    ]
    shown = [each for each in found if each is not None][:_MOST]
    if not shown:
        return None
    logarithms, variances, of_chain = (np.array(part) for part in zip(*shown, strict=True))
    weights = (1 / variances) / np.sum(1 / variances)
    variance = 1 / np.sum(1 / variances) + weights @ of_chain
    return MassScale(math.exp(-weights @ logarithms), math.sqrt(variance))


def _of_push(
    fitted: MotionFit, readings: Readings, time: float, impulses: Array
) -> tuple[float, float, float] | None:
    """Logarithm of 1 / M, its variance by this push, and by what is unsure of the chain."""
    times = readings.times
    before = [each for each in fitted.windows if times[each.frames.stop - 1] <= time]
    after = [each for each in fitted.windows if times[each.frames.start] > time]
    if not before or not after:
        return None
    first, last = before[-1].frames.stop, after[0].frames.start
    others = [push.time for push in readings.pushes if push.time != time]
    if any(times[first - 1] <= other <= times[last] for other in others):
        return None
    begin = max(before[-1].frames.start, first - _BEFORE)
    motion = followed(before[-1].motion, times[before[-1].frames.start : begin + 1])[1]
    some = slice(begin, min(last + _AFTER, after[0].frames.stop))
    kick = impulses / (motion.masses * motion.lengths.rotor_lengths**2)
    ahead = followed(motion, times[begin : last + 1])[1]
    change = after[0].motion.rates - ahead.rates
    guess = float(change @ kick / (kick @ kick))
    if guess <= 0:
        return None
    read, noise = readings.seen[some] - motion.lengths.offsets, fitted.noise
    seen = np.isfinite(read)
    rotors = len(kick)

    def left(unknowns: Array) -> Array:
        moved = replace(
            motion,
            angles=motion.angles + unknowns[:rotors],
            rates=motion.rates + unknowns[rotors:-2],
        )
        pushed = _pushed(moved, times[some], time + unknowns[-2], math.exp(unknowns[-1]) * kick)
        errors = (read - pushed) / (noise * readings.spreads[some])
        return np.asarray(errors[seen])

    unknowns = np.zeros(2 * rotors + 2)
    unknowns[-1] = math.log(guess)
    solution = least_squares(left, unknowns, method='lm')
    excess = max(1.0, 2 * solution.cost / (seen.sum() - len(unknowns)))
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


def _pushed(motion: FreeMotion, times: Array, instant: float, changes: Array) -> Array:
    """Angles at each time [rad], (T, N), of a motion whose rates change at an instant [s]."""
    arrived = int(np.searchsorted(times, instant))
    arrived = min(max(arrived, 1), len(times) - 1)
    angles, there = followed(motion, np.append(times[:arrived], instant))
    there = replace(there, rates=there.rates + changes)
    return np.concatenate([angles[:-1], frames(there, np.insert(times[arrived:], 0, instant))[1:]])
