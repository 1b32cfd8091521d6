# SPDX-License-Identifier: Apache-2.0
"""Windows of frames of free motion, their normal equations, and the prior of the chain.

The unknowns of a window are the chain, q, and its initial state, s. With its normal
equations in blocks,

    (A_qq - A_qs A_ss^-1 A_sq) dq = b_q - A_qs A_ss^-1 b_s

is the contribution of a window to the equations of the chain, and ds = A_ss^-1 (b_s - A_sq dq).
`Tolerances` is the prior of lengths. Logarithms of stiffnesses and of masses have normal
distributions about a mean, with a standard deviation that is estimated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import observable_basis
from soliton_linkage.identification.free_motion import FreeMotion, states_with_sensitivities
from soliton_linkage.identification.lengths import UNKNOWNS_PER_ROTOR, Tolerances, to_unknowns
from soliton_linkage.linkage.chain import Array

_INITIAL_FRAMES = 25
"""Number of frames of an initial window [1]. Sensitivity: at 0.5x, initial rates are uncertain; at
2x, the simulated wall may deviate too far from the readings if lengths have errors of 5 %."""
_RATE_FRAMES = 8
"""Number of frames from which the initial rates of a window are estimated [1]."""
_FEWEST_FRAMES = 30
"""Smallest number of frames between impulses [1]; in this time a wall passes some rotors."""
_ARRIVAL = 0.05
"""Delay of an impulse after its command [s]."""
_MERGED = 4
"""Number of windows that are merged into one [1]. With 2, more rounds are needed; with 8, the fit
may lose the wall."""
_DENSE_FRAMES = 0.05
"""Smallest density of the frames of a window, relative to successive frames [1]."""


class FreeWindow(NamedTuple):
    """Successive frames of one free motion."""

    frames: slice
    motion: FreeMotion
    """Motion from the first frame; all windows have the same chain."""


def free_intervals(times: Array, interruptions: Sequence[float]) -> list[slice]:
    """Return the intervals of frames between interruptions [s]; omit short intervals."""
    begins = [-math.inf, *(time + _ARRIVAL for time in sorted(interruptions))]
    ends = [*sorted(interruptions), math.inf]
    intervals = [
        slice(int(np.searchsorted(times, begin, 'right')), int(np.searchsorted(times, end)))
        for begin, end in zip(begins, ends, strict=True)
    ]
    return [each for each in intervals if each.stop - each.start >= _FEWEST_FRAMES]


def initial_windows(
    times: Array,
    angles: Array,
    chain: FreeMotion,
    interruptions: Sequence[float],
    tilt_at: Callable[[float], float] = lambda _: 0.0,
) -> list[FreeWindow]:
    """Return short windows between interruptions [s], with initial states from the angles.

    Angles [rad], (T, N), are at times [s]. `tilt_at` returns the tilt of the chain [rad] at a time
    [s]. No window extends over a gap that is too long to estimate rates.
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
    """Return the parts of an interval between gaps, without short parts."""
    averages = (times[_RATE_FRAMES:] - times[:-_RATE_FRAMES]) / _RATE_FRAMES
    gaps = np.diff(times) > _RATE_FRAMES * np.quantile(averages, _DENSE_FRAMES)
    inner = 1 + interval.start + np.flatnonzero(gaps[interval.start : interval.stop - 1])
    ends = [interval.start, *inner.tolist(), interval.stop]
    parts = [slice(*each) for each in pairwise(ends)]
    return [part for part in parts if part.stop - part.start >= _FEWEST_FRAMES]


def merge_windows(
    windows: Sequence[FreeWindow], fits: Callable[[FreeWindow, slice], bool]
) -> tuple[FreeWindow, ...]:
    """Merge adjacent windows.

    Two windows are merged if the motion of the first, continued, fits the frames of the second.
    """
    merged: list[FreeWindow] = []
    count = 0
    for window in windows:
        if merged and count < _MERGED and merged[-1].frames.stop == window.frames.start:
            frames = slice(merged[-1].frames.start, window.frames.stop)
            whole = FreeWindow(frames, merged[-1].motion)
            if fits(whole, window.frames):
                merged[-1] = whole
                count += 1
                continue
        merged.append(window)
        count = 1
    return tuple(merged)


INITIAL_MASS_DEVIATION = 0.1
"""Initial prior standard deviation of masses and stiffnesses [1]; with 0.3 some fits diverge."""
_SMALLEST, _LARGEST = 1e-3, 0.3
"""Limits of the estimated standard deviation [1]."""
_DAMPING_RATE = 1.0
"""Prior standard deviation of damping divided by the moment of inertia of a rotor [1/s]."""
_FRICTION_DECELERATION = 10.0
"""Prior standard deviation of dry friction divided by the moment of inertia of a rotor [rad/s^2];
this friction stops the rotors of a wall in a second."""
_LOG_GRAVITY = 1.0
"""Prior standard deviation of the logarithm of g [1], where g is in mean spacings per s^2."""
_INFORMED = 1e-12
"""Smallest eigenvalue of the information, relative to the largest [1]; smaller ones are
rounding."""


def force_deviations(inertia: float) -> Array:
    """Return prior deviations of damping, friction and log gravity, given an inertia."""
    return np.array([_DAMPING_RATE * inertia, _FRICTION_DECELERATION * inertia, _LOG_GRAVITY])


def estimated_deviation(squares: float, count: int) -> float:
    """Return the standard deviation of logarithms [1] from the sum of their squares."""
    return min(max(math.sqrt(squares / count), _SMALLEST), _LARGEST)


@dataclass(frozen=True)
class MotionPrior:
    """Normal distribution of the unknowns of a chain of springs."""

    gravity: float
    """Median of gravity [length/s^2], 0 for none."""
    tolerances: Tolerances
    mass_deviation: float = INITIAL_MASS_DEVIATION
    """Standard deviation of logarithms of masses and stiffnesses [1]."""
    shift: Array | float = 0.0
    """Shift of the mean, in the order of the unknowns, (Q - 2 N,)."""

    def evaluate(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Return the information, (Q - 2 N, Q - 2 N), and the unknowns minus their prior mean."""
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
        """Return the prior with a random mean, drawn from the prior itself.

        Combinations without information are not drawn. With the symmetric root of the covariance,
        the sample does not depend on the choice of eigenvectors for equal eigenvalues.
        """
        values, vectors = np.linalg.eigh(self.evaluate(motion)[0])
        informed = values > _INFORMED * values[-1]
        values, vectors = values[informed], vectors[:, informed]
        steps = vectors.T @ random.standard_normal(len(vectors)) / np.sqrt(values)
        return replace(self, shift=np.asarray(vectors @ steps))

    def reestimated(
        self, motion: FreeMotion, covariance: Array, tolerance: float | None
    ) -> MotionPrior:
        """Return the prior with standard deviations estimated from a chain and its covariance.

        `tolerance` is the relative tolerance of the lengths [1]; None estimates it too.
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
    """Return orthonormal changes of a chain with constant mean spacing and mean mass.

    Gravity is also constant if it is known or 0.
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


_STATE_DEVIATION = 10.0
"""Prior standard deviation of an initial state [rad], [rad/s]."""


class Eliminated(NamedTuple):
    """Reduced normal equations of the chain, and the solution for the initial state.

    `matrix` and `vector` are the equations of the chain, `state` is A_ss^-1 b_s, and `coupling` is
    A_ss^-1 A_sq. The gain, b_s A_ss^-1 b_s, is the decrease of the squares due to the initial
    state alone [1].
    """

    matrix: Array
    vector: Array
    state: Array
    coupling: Array
    gain: float

    def change(self, chain: Array) -> Array:
        """Return the change of all unknowns of the window, (Q,), given the chain's."""
        return np.concatenate([chain, self.state - self.coupling @ chain])


class WindowEquations(NamedTuple):
    """Normal equations of a window for unit variance, and the sum of squared residuals [rad^2].

    The initial state is the last part of the unknowns: shapes are (Q, Q) and (Q,).
    """

    matrix: Array
    vector: Array
    squares: float

    def eliminated(self, rotors: int, noise: float, damping: float) -> Eliminated:
        """Eliminate the initial state, given the noise of readings [rad] and a damping [1]."""
        matrix, vector = self.matrix / noise**2, self.vector / noise**2
        size = len(vector) - 2 * rotors
        own = matrix[size:, size:] * (1 + damping * np.eye(2 * rotors))
        own += np.eye(2 * rotors) / _STATE_DEVIATION**2
        coupling = np.asarray(np.linalg.solve(own, matrix[size:, :size]))
        state = np.asarray(np.linalg.solve(own, vector[size:]))
        return Eliminated(
            matrix[:size, :size] - matrix[:size, size:] @ coupling,
            vector[:size] - matrix[:size, size:] @ state,
            state,
            coupling,
            float(vector[size:] @ state),
        )


class StampErrors(NamedTuple):
    """Errors of the stamps of T frames, of unknown variance.

    A stamp that is late by d changes the readings of all rotors by -d times their rates. Let u be
    the rates divided by the deviations of the readings. An error of variance v adds v u u^T to the
    covariance of the weighted readings. The inverse square root of I + v u u^T reduces residuals
    along u.
    """

    variance: float
    """Variance of the errors divided by the variance of a reading [s^2/rad^2], 0 if negligible."""
    delays: Array
    """Estimated times of the readings minus their stamps [s], shape (T,)."""

    def whiten(self, frames: slice, pulls: Array, errors: Array, slopes: Array) -> None:
        """Whiten weighted residuals, (B, N), and sensitivities, (B, N, Q), in place.

        `pulls` are the rates divided by the deviations of readings, 0 if missing, (B, N).
        """
        if not self.variance:
            return
        errors += pulls * self.delays[frames, None]
        squares = np.sum(pulls**2, axis=1)
        factors = (1 - 1 / np.sqrt(1 + self.variance * squares)) / np.maximum(squares, 1e-30)
        errors -= pulls * (factors * np.einsum('tn,tn->t', pulls, errors))[:, None]
        if slopes.size:
            along = np.matmul(pulls[:, None], slopes)
            slopes -= (factors[:, None] * pulls)[..., None] * along


def window_equations(
    window: FreeWindow,
    times: Array,
    readings: Array,
    relative_deviations: Array,
    stamps: StampErrors,
) -> WindowEquations:
    """Return the normal equations of a window, given readings of all frames [rad], (T, N)."""
    rotors, size = np.arange(readings.shape[1]), window.motion.size
    matrix, vector, squares = np.zeros((size, size)), np.zeros(size), 0.0
    begin = window.frames.start
    for states, slopes in states_with_sensitivities(window.motion, times[window.frames]):
        frames = slice(begin, begin + len(states))
        begin = frames.stop
        slopes[:, rotors, UNKNOWNS_PER_ROTOR * rotors + 1] += 1
        errors = readings[frames] - window.motion.lengths.offsets - states[:, 0]
        weights = np.where(np.isfinite(errors), 1 / relative_deviations[frames], 0.0)
        errors = np.nan_to_num(errors) * weights
        slopes *= weights[..., None]
        stamps.whiten(frames, states[:, 1] * weights, errors, slopes)
        rows, errors = slopes.reshape(-1, size), errors.ravel()
        matrix += rows.T @ rows
        vector += rows.T @ errors
        squares += float(errors @ errors)
    return WindowEquations(matrix, vector, squares)
