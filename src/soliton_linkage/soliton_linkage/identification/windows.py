# SPDX-License-Identifier: Apache-2.0
"""Windows (runs of frames) of free motion, and the normal prior of the unknowns of a chain.

A `FreeMotion` of N rotors has Q unknowns: its 2 N initial angles and rates, and the Q - 2 N
unknowns of the chain, which are the same in all windows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import observable_basis
from soliton_linkage.identification.free_motion import FreeMotion, propagate
from soliton_linkage.identification.lengths import Tolerances, to_unknowns
from soliton_linkage.identification.readings import dense_interval
from soliton_linkage.linkage.chain import Array

_INITIAL_FRAMES = 25
"""Number of frames in an initial window; with fewer frames, the initial rates are uncertain."""
_RATE_FRAMES = 8
"""Number of frames from which the initial rates of a window are estimated."""
FEWEST_FRAMES = 30
"""The frames between two impulses are used only if their number is at least this."""
ARRIVAL = 0.05
"""Largest delay between the command of an impulse and its effect [s]."""
_MERGED = 2
"""Largest number of windows that are merged into one at a time [1]. Sensitivity: with twice this
number, the fit of a wobbling flipper takes up to four times as long, because the initial motions
of the merged windows fit badly."""
_LONGEST_WINDOW = 1600
"""Largest number of frames in a merged window; in longer windows, the fit is less linear."""
_GAP = 8.0
"""A window ends where the frame interval is more than this times `dense_interval` [1]."""


class FreeWindow(NamedTuple):
    """Successive frames of one free motion."""

    frames: slice
    motion: FreeMotion
    """Motion that begins with the state in the first frame; all windows have the same chain."""


def free_intervals(times: Array, interruptions: Sequence[float]) -> list[slice]:
    """Return runs of frames between interruptions [s] that are long enough for a fit."""
    begins = [-math.inf, *(time + ARRIVAL for time in sorted(interruptions))]
    ends = [*sorted(interruptions), math.inf]
    intervals = [
        slice(int(np.searchsorted(times, begin, 'right')), int(np.searchsorted(times, end)))
        for begin, end in zip(begins, ends, strict=True)
    ]
    return [each for each in intervals if each.stop - each.start >= FEWEST_FRAMES]


def initial_windows(
    times: Array,
    angles: Array,
    chain: FreeMotion,
    interruptions: Sequence[float],
    tilt_at: Callable[[float], float] = lambda _: 0.0,
) -> list[FreeWindow]:
    """Return short windows of free motion between interruptions at given times [s].

    The initial state of each window is estimated from the angles [rad], (T, N). `tilt_at` returns
    the tilt of the chain [rad] at a time [s].
    """
    windows = []
    intervals = free_intervals(times, interruptions)
    for interval in (part for each in intervals for part in _without_gaps(times, each)):
        tilted = replace(chain, tilt=tilt_at(float(times[interval.start])))
        last = interval.stop - _INITIAL_FRAMES
        for begin in range(interval.start, last + 1, _INITIAL_FRAMES):
            stop = begin + _INITIAL_FRAMES
            frames = slice(begin, interval.stop if stop > last else stop)
            few = slice(begin, begin + _RATE_FRAMES)
            slopes = np.polyfit(times[few] - times[begin], angles[few], 1)
            motion = replace(tilted, angles=slopes[1], rates=slopes[0])
            windows.append(FreeWindow(frames, motion))
    return windows


def _without_gaps(times: Array, interval: slice) -> list[slice]:
    gaps = np.diff(times) > _GAP * dense_interval(times)
    inner = 1 + interval.start + np.flatnonzero(gaps[interval.start : interval.stop - 1])
    ends = [interval.start, *inner.tolist(), interval.stop]
    parts = [slice(*each) for each in pairwise(ends)]
    return [part for part in parts if part.stop - part.start >= FEWEST_FRAMES]


def merge_windows(
    windows: Sequence[FreeWindow], fits: Callable[[FreeWindow, slice], bool]
) -> tuple[FreeWindow, ...]:
    """Merge adjacent windows if the motion of the first one also fits the second one.

    The function `fits` decides this. Its arguments are the merged window, with the motion of the
    first one, and the frames of the second one.
    """
    merged: list[FreeWindow] = []
    count = 0
    for window in windows:
        if merged and count < _MERGED and merged[-1].frames.stop == window.frames.start:
            frames = slice(merged[-1].frames.start, window.frames.stop)
            whole = FreeWindow(frames, merged[-1].motion)
            short = frames.stop - frames.start <= _LONGEST_WINDOW
            if short and fits(whole, window.frames):
                merged[-1] = whole
                count += 1
                continue
        merged.append(window)
        count = 1
    return tuple(merged)


def windows_around(
    windows: Sequence[FreeWindow], times: Array, before: int, after: int, fewest: int = 1
) -> tuple[FreeWindow, ...]:
    """Remove the frames from `before` to `after` - 1 from all windows.

    A window that begins earlier and ends later is divided into two. Parts with fewer frames than
    `fewest` are omitted. `times` [s] are the times of all frames.
    """
    parts: list[FreeWindow] = []
    for window in windows:
        begin, end = window.frames.start, window.frames.stop
        if end <= before or after <= begin:
            parts.append(window)
            continue
        if before - begin >= fewest:
            parts.append(window._replace(frames=slice(begin, before)))
        if end - after >= fewest:
            _, motion = propagate(window.motion, times[begin : after + 1])
            parts.append(FreeWindow(slice(after, end), motion))
    return tuple(parts)


def join_windows(windows: Sequence[FreeWindow], before: int, after: int) -> tuple[FreeWindow, ...]:
    """Join adjacent windows if one ends, and the next begins, at a frame from `before` to `after`.

    The motion of the first one continues through the second one. Windows that would be longer than
    `merge_windows` allows are not joined.
    """
    parts: list[FreeWindow] = []
    for window in windows:
        begin, end = window.frames.start, window.frames.stop
        first = parts[-1] if parts else window
        short = end - first.frames.start <= _LONGEST_WINDOW
        if short and first.frames.stop == begin and before <= begin <= after:
            parts[-1] = first._replace(frames=slice(first.frames.start, end))
        else:
            parts.append(window)
    return tuple(parts)


INITIAL_MASS_DEVIATION = 0.1
"""Prior standard deviation of log masses and log stiffnesses [1]; with three times this value,
some fits diverge."""
_SMALLEST, _LARGEST = 1e-3, 0.3
"""Limits of the estimated standard deviation of log masses and log stiffnesses [1]."""
_DAMPING_RATE = 1.0
"""Prior standard deviation of the ratio of damping to moment of inertia [1/s]."""
_FRICTION_DECELERATION = 10.0
"""Prior standard deviation of the ratio of dry friction to moment of inertia [rad/s^2]."""
_LOG_GRAVITY = 1.0
"""Prior standard deviation of the log of gravity [1], used only if the spacing is unknown."""
_INFORMED = 1e-12
"""Eigenvalues of the prior information below this fraction of the largest are neglected [1]."""


def force_deviations(inertia: float) -> Array:
    """Return the prior standard deviations of damping, dry friction and log gravity, (3,).

    `inertia` is the mean moment of inertia of a rotor.
    """
    return np.array([_DAMPING_RATE * inertia, _FRICTION_DECELERATION * inertia, _LOG_GRAVITY])


def estimated_deviation(squares: float, count: int) -> float:
    """Return an estimated standard deviation of log masses and log stiffnesses [1].

    `squares` is the expected sum of the squared differences of the logarithms from their prior
    means, and `count` is the number of degrees of freedom. The result is limited to a plausible
    range.
    """
    return min(max(math.sqrt(squares / count), _SMALLEST), _LARGEST)


@dataclass(frozen=True)
class MotionPrior:
    """Normal distribution of the unknowns of a chain of springs."""

    gravity: float
    tolerances: Tolerances
    mass_deviation: float = INITIAL_MASS_DEVIATION
    """Prior standard deviation of the logarithms of masses and stiffnesses [1]."""
    shift: Array | float = 0.0
    """Shift of the prior mean, (Q - 2 N,), for a sample of the posterior; otherwise 0."""

    def evaluate(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Return the prior information, and the unknowns of the chain minus their prior mean.

        Both contain the Q - 2 N unknowns of the chain. For the log lengths of one kind, and for
        the log stiffnesses, the prior restricts only the scatter about their mean, not the mean.
        """
        at, rotors = motion.slices, len(motion.masses)
        size = at.forces.stop
        information, values = np.zeros((size, size)), np.zeros(size)
        information[at.lengths, at.lengths] = self.tolerances.information(rotors)
        centred = np.eye(rotors - 1) - 1 / (rotors - 1)
        information[at.stiffnesses, at.stiffnesses] = centred / self.mass_deviation**2
        information[at.masses, at.masses] = np.eye(rotors) / self.mass_deviation**2
        deviations = force_deviations(float(motion.inertias.mean()))
        information[at.forces, at.forces] = np.diag(deviations**-2)
        values[at.lengths] = to_unknowns(motion.lengths)
        values[at.stiffnesses] = np.log(motion.stiffnesses)
        values[at.masses] = np.log(motion.masses)
        log_gravity = math.log(motion.gravity / self.gravity) if self.gravity else 0.0
        values[at.forces] = motion.damping, motion.friction, log_gravity
        return information, values - self.shift

    def sampled(self, motion: FreeMotion, random: np.random.Generator) -> MotionPrior:
        """Return this prior with its mean shifted by a random sample of the prior."""
        values, vectors = np.linalg.eigh(self.evaluate(motion)[0])
        informed = values > _INFORMED * values[-1]
        values, vectors = values[informed], vectors[:, informed]
        steps = vectors.T @ random.standard_normal(len(vectors)) / np.sqrt(values)
        return replace(self, shift=np.asarray(vectors @ steps))

    def reestimated(
        self, motion: FreeMotion, covariance: Array, tolerance: float | None
    ) -> MotionPrior:
        """Return this prior with standard deviations replaced by estimates from a fitted chain.

        The standard deviations are estimated from the scatter of the unknowns of the chain of
        `motion`, and from the covariance of these unknowns. If `tolerance` [1] is not None, it
        replaces the estimated standard deviation of the log lengths.
        """
        at = motion.slices
        lengths = covariance[at.lengths, at.lengths]
        tolerances = Tolerances.estimated(motion.lengths, lengths, tolerance)
        springs, masses = np.log(motion.stiffnesses), np.log(motion.masses)
        squares = np.sum((springs - springs.mean()) ** 2) + np.sum(masses**2)
        squares += np.diag(covariance)[at.stiffnesses.start : at.masses.stop].sum()
        deviation = estimated_deviation(float(squares), 2 * len(masses) - 3)
        return MotionPrior(self.gravity, tolerances, deviation)


def observable_changes(motion: FreeMotion, gravity_known: bool) -> Array:
    """Return an orthonormal basis of the changes that keep the mean spacing and the mean log mass.

    The columns are changes of the Q - 2 N unknowns of the chain. If `gravity_known`, these changes
    also keep gravity.
    """
    at, rotors = motion.slices, len(motion.masses)
    basis = np.eye(at.forces.stop)
    equal_sum = np.linalg.qr(np.ones((rotors, 1)), mode='complete')[0][:, 1:]
    lengths = observable_basis(motion.lengths)
    basis[at.lengths, at.lengths] = basis[at.masses, at.masses] = 0
    basis[at.lengths, : lengths.shape[1]] = lengths
    basis[at.masses, at.masses.start : at.masses.stop - 1] = equal_sum
    removed = [lengths.shape[1], at.masses.stop - 1]
    if gravity_known or not motion.gravity:
        removed.append(at.forces.stop - 1)
    return np.delete(basis, removed, axis=1)
