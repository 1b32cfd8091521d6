# SPDX-License-Identifier: Apache-2.0
"""Normal equations of the chain and of the initial states of all windows (runs of frames).

The normal equations of a window have the blocks A_qq, A_qs, A_sq and A_ss for the parameters q of
the chain and the initial state s of the window, and the right sides b_q and b_s. The elimination
of s leaves

    sum over windows of (A_qq - A_qs A_ss^-1 A_sq) dq = sum of (b_q - A_qs A_ss^-1 b_s),

and the change of each initial state is ds = A_ss^-1 (b_s - A_sq dq). A chain of N rotors has
Q - 2 N parameters q, and an initial state consists of 2 N angles and rates. A window has B frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.identification.free_motion import (
    UnknownSlices,
    gradient_of,
    states_at,
    states_with_sensitivities,
    transition,
)
from soliton_linkage.identification.lengths import UNKNOWNS_PER_ROTOR, split
from soliton_linkage.identification.windows import FreeWindow
from soliton_linkage.linkage.chain import Array

_STATE_DEVIATION = 10.0
"""Prior standard deviation of each initial angle [rad] and each initial rate [rad/s]."""
_TEST_STEP = 0.05
"""Time between two tests for a sudden change of the rates [s]."""
_TEST_FRAMES = 2
"""Smallest number of frames in the matrices of normal equations between two such tests [1]."""
_SIGNIFICANT_STAMPS = 4.0
"""The estimated variance of the errors of time stamps is significant if it is at least this times
its own standard deviation [1]."""

_ANY_VARIANCE = 1e12
"""Ratio of the variance of the errors of time stamps to the variance of a reading [s^2/rad^2]. It
is so large that residuals along the rates, which errors of stamps may cause, have no weight."""


class Eliminated(NamedTuple):
    """Matrices A_qq - A_qs A_ss^-1 A_sq, A_ss^-1 A_sq and A_ss^-1 of a window."""

    matrix: Array
    coupling: Array
    inverse: Array


def eliminated(matrix: Array, size: int, noise: float, damping: float) -> Eliminated:
    """Eliminate the initial state of a window from its normal equations.

    The first `size` unknowns of `matrix`, the result of `window_matrix`, belong to the chain, the
    others to the initial state. `noise` is the standard deviation of a reading [rad], and
    `damping` is the relative increase of the diagonal (Levenberg-Marquardt) [1].
    """
    matrix = matrix / noise**2
    states = np.eye(len(matrix) - size)
    own = matrix[size:, size:] * (1 + damping * states) + states / _STATE_DEVIATION**2
    inverse = np.asarray(np.linalg.inv(own))
    coupling = inverse @ matrix[size:, :size]
    return Eliminated(matrix[:size, :size] - matrix[:size, size:] @ coupling, coupling, inverse)


def solver(
    parts: Sequence[Eliminated], information: Array, basis: Array, damping: float
) -> Callable[[Array], Array]:
    """Return a function that solves the normal equations of the chain and of all initial states.

    The function maps the right side of the equations to their solution. In both vectors, the
    unknowns of the chain precede those of the initial states. The unknowns of the chain change
    only along the columns of `basis`. `information` is the information matrix of the prior of the
    chain, and `damping` is the relative increase of the diagonal (Levenberg-Marquardt) [1].
    """
    matrix = basis.T @ (information + np.sum([each.matrix for each in parts], axis=0)) @ basis
    matrix += damping * np.diag(np.diag(matrix))
    inverse, size = np.linalg.inv(matrix), len(information)

    def solve(right: Array) -> Array:
        own = right[size:].reshape(len(parts), -1)
        reduced = right[:size] - np.sum(
            [part.coupling.T @ each for part, each in zip(parts, own, strict=True)], axis=0
        )
        chain = basis @ (inverse @ (basis.T @ reduced))
        states = [
            part.inverse @ each - part.coupling @ chain
            for part, each in zip(parts, own, strict=True)
        ]
        return np.concatenate([chain, *states])

    return solve


def quasi_newton_step(
    right: Array, solve: Callable[[Array], Array], pairs: Sequence[tuple[Array, Array]]
) -> Array:
    """Return a step of the quasi-Newton method L-BFGS (Nocedal, 1980).

    `right` is the right side of the normal equations, and `solve` solves them approximately.
    `pairs` contains the previous steps, each with the decrease of the right side that it caused.
    """
    factors = []
    for step, change in reversed(pairs):
        factors.append(step @ right / (step @ change))
        right = right - factors[-1] * change
    solution = solve(right)
    for (step, change), factor in zip(pairs, reversed(factors), strict=True):
        solution = solution + (factor - change @ solution / (step @ change)) * step
    return solution


class StampErrors(NamedTuple):
    """Errors of time stamps, with the variance v.

    Weighted readings and weighted rates are divided by the relative standard deviations of the
    readings. In a frame with the weighted rates u, the error of the stamp adds v u u^T to the
    covariance of the weighted readings.
    """

    variance: float
    """Ratio of v to the variance of a reading [s^2/rad^2]; 0 if v is negligible."""
    delays: Array
    """Estimated minus recorded time of each frame [s], (T,)."""

    def whitened(self, pulls: Array, values: Array) -> Array:
        """Return whitened residuals or sensitivities, (..., B, N), of B frames.

        Errors of the stamps correlate the weighted readings of a frame. Therefore the `values` of
        each frame are combined so that their errors are independent. `pulls`, (B, N), are the
        weighted rates.
        """
        if not self.variance:
            return values
        squares = np.sum(pulls**2, axis=1)
        factors = (1 - 1 / np.sqrt(1 + self.variance * squares)) / np.maximum(squares, 1e-30)
        along = np.einsum('tn,...tn->...t', pulls, values)
        return np.asarray(values - (factors * along)[..., None] * pulls)


class Record(NamedTuple):
    """Estimated times [s], readings [rad] and relative standard deviations [1] of T frames."""

    times: Array
    readings: Array
    deviations: Array
    stamps: StampErrors

    def weighted(
        self, window: FreeWindow, some: NDArray[np.intp] | None = None, states: Array | None = None
    ) -> tuple[Array, ...]:
        """Return weights, weighted rates and weighted residuals of B frames, (B, N) each.

        `some` are the numbers of the frames in the record, by default those of the window.
        `states`, (B, 2, N), are the angles and rates of the motion in these frames; by default,
        they are computed. Weights are inverse relative deviations, or 0 for missing readings.
        """
        frames = window.frames if some is None else some
        if states is None:
            states = states_at(window.motion, self.times[frames])
        readings = self.readings[frames]
        weights = np.where(np.isnan(readings), 0.0, 1 / self.deviations[frames])
        errors = readings - window.motion.lengths.offsets - states[:, 0]
        return weights, states[:, 1] * weights, np.where(weights > 0, errors * weights, 0.0)

    def across_rates(self, window: FreeWindow) -> Array:
        """Return the components of the weighted residuals orthogonal to the rates, (B, N)."""
        _, pulls, errors = self.weighted(window)
        return StampErrors(_ANY_VARIANCE, self.times).whitened(pulls, errors)

    def whitened(self, frames: slice | NDArray[np.intp], pulls: Array, errors: Array) -> Array:
        """Return the whitened residuals of B frames at the recorded times, (B, N).

        `pulls` and `errors` are the weighted rates and residuals at the estimated times. The
        weighted residuals at the recorded times are `errors` plus `pulls` times the delays.
        """
        if self.stamps.variance:
            errors = errors + pulls * self.stamps.delays[frames, None]
        return self.stamps.whitened(pulls, errors)


def window_matrix(
    window: FreeWindow, record: Record, every: int, shapes: Array | None = None
) -> Array:
    """Return the matrix of the normal equations of a window, for readings of unit variance.

    To save time, only each `every`-th frame is used, and the matrix is scaled up to all frames.
    `shapes`, (K, B, N), are K kinds of errors of N encoders in the B frames of the window. In the
    matrix, the sizes of these K N errors are between the unknowns of the chain and the initial
    state.
    """
    motion, rotors = window.motion, np.arange(record.readings.shape[1])
    size = motion.size + (0 if shapes is None else len(shapes) * len(rotors))
    matrix = np.zeros((size, size))
    frames = np.arange(window.frames.start, window.frames.stop, every)
    factor = (window.frames.stop - window.frames.start) / len(frames)
    for states, slopes in states_with_sensitivities(motion, record.times[frames]):
        some, frames = np.split(frames, [len(states)])
        slopes[UNKNOWNS_PER_ROTOR * rotors + 1, :, rotors] += 1
        if shapes is not None:
            chain, initial = np.split(slopes, [motion.slices.forces.stop])
            own = shapes[:, None, some - window.frames.start] * np.eye(len(rotors))[:, None]
            slopes = np.concatenate([chain, *own, initial])
        weights, pulls, _ = record.weighted(window, some, states)
        slopes *= weights
        rows = record.stamps.whitened(pulls, slopes).reshape(size, -1)
        matrix += rows @ rows.T
    return np.asarray(factor * matrix)


def window_gradient(
    window: FreeWindow, record: Record, states: Array, shapes: Array | None = None
) -> Array:
    """Return the right side of the normal equations whose matrix `window_matrix` returns.

    The shape is (Q,), or (Q + K N,) with the `shapes` of K kinds of errors. `states` are the
    angles and rates in the B frames of the window, (B, 2, N).
    """
    times = record.times[window.frames]
    weights, pulls, errors = record.weighted(window, None, states)
    errors = record.stamps.whitened(pulls, record.whitened(window.frames, pulls, errors))
    gradient = gradient_of(window.motion, times, states, errors * weights)
    split(gradient[window.motion.slices.lengths])[1][:] += np.sum(errors * weights, axis=0)
    if shapes is not None:
        own = np.sum(errors * weights * shapes, axis=1).ravel()
        gradient = np.insert(gradient, window.motion.slices.forces.stop, own)
    return gradient


def error_equations(
    windows: Sequence[FreeWindow],
    record: Record,
    noise: float,
    every: int,
    shapes: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Return the normal equations of the chain and K N encoder errors: matrix and right side.

    The initial states are eliminated. `noise` is the standard deviation of a reading [rad], and
    `every` is an argument of `window_matrix`. The function `shapes` maps angles, (B, N), to the
    argument `shapes` of `window_matrix`, (K, B, N).
    """
    parts: list[tuple[Array, Array]] = []
    for window in windows:
        states = states_at(window.motion, record.times[window.frames])
        some = shapes(states[:, 0])
        size = window.motion.slices.forces.stop + some.shape[0] * some.shape[2]
        right = window_gradient(window, record, states, some) / noise**2
        part = eliminated(window_matrix(window, record, every, some), size, noise, 0.0)
        parts.append((part.matrix, right[:size] - part.coupling.T @ right[size:]))
    matrices, vectors = zip(*parts, strict=True)
    return np.sum(matrices, axis=0), np.sum(vectors, axis=0)


class RateChange(NamedTuple):
    """Normal equations of a sudden change of the N rates in a frame of a window."""

    time: float
    """Time of the frame [s]."""
    rates: Array
    """Rates in the frame [rad/s], (N,)."""
    coupling: Array
    """Columns of the matrix that couple the change to the unknowns of the window, (Q, N)."""
    matrix: Array
    right: Array


def rate_changes(
    window: FreeWindow, record: Record, every: int, interval: float
) -> tuple[Array, Array, list[RateChange]]:
    """Return the normal equations of a window, and of sudden changes of the rates in it.

    The first two values are the matrix, (Q, Q), and the right side, (Q,), of the window. They are
    for readings of unit variance. `every` is an argument of `window_matrix`. The window is divided
    at regular times, and `interval` is the median frame interval [s]. From part to part, a change
    of the state x and of the unknowns q of the chain changes the state by F x + H q.
    """
    times, begin, end = record.times, window.frames.start, window.frames.stop
    states = states_at(window.motion, times[window.frames])
    size, rotors = window.motion.slices.forces.stop, states.shape[2]
    slope = np.eye(size + 2 * rotors)
    parts: list[tuple[FreeWindow, Array, Array, Array, Array]] = []
    step = max(round(_TEST_STEP / interval), _TEST_FRAMES * every)
    for first, last in pairwise([*range(begin, end, step), end]):
        own = states[first - begin : last - begin]
        motion = replace(window.motion, angles=own[0, 0], rates=own[0, 1])
        part = FreeWindow(slice(first, last), motion)
        # The derivatives of the state at the end of a part are (H, F), transposed.
        move = transition(motion, float(times[min(last, end - 1)] - times[first]))
        equations = window_matrix(part, record, every), window_gradient(part, record, own)
        parts.append((part, slope, move, *equations))
        slope = np.hstack([slope[:, :size], slope[:, size:] @ move[size:]])
        slope[:size, size:] += move[:size]
    matrix = np.sum([slope @ each @ slope.T for _, slope, _, each, _ in parts], axis=0)
    right = np.sum([slope @ each for _, slope, _, _, each in parts], axis=0)
    # Sums over all later parts: derivatives by the unknowns of the chain and by the state.
    columns, later = np.zeros((size + 2 * rotors, 2 * rotors)), np.zeros(2 * rotors)
    found = []
    for part, slope, move, block, gradient in parts[:0:-1]:
        columns, later = columns @ move[size:].T, move[size:] @ later
        columns[:size] += move[:size] @ columns[size:]
        columns[size:] = move[size:] @ columns[size:]
        columns += block[:, size:]
        later += gradient[size:]
        by_rates = columns[:, rotors:]
        time, rates = float(times[part.frames.start]), part.motion.rates
        sides = by_rates[size + rotors :], later[rotors:].copy()
        found.append(RateChange(time, rates, slope @ by_rates, *sides))
    return matrix, right, found


def eliminated_changes(
    changes: Sequence[Sequence[RateChange]],
    right: Array,
    solve: Callable[[Array], Array],
    noise: float,
) -> list[RateChange]:
    """Eliminate all unknowns of a fit from the normal equations of changes in each window.

    `right` is the right side of the normal equations of the fit, which `solve` solves. `noise` is
    the standard deviation of a reading [rad].
    """
    solved, found = solve(right), list[RateChange]()
    for number, each in ((n, each) for n, some in enumerate(changes) for each in some):
        rotors = len(each.rates)
        size = len(each.coupling) - 2 * rotors
        own = size + 2 * rotors * number
        columns = np.zeros((len(right), rotors))
        chain, state = np.split(each.coupling / noise**2, [size])
        columns[:size], columns[own : own + 2 * rotors] = chain, state
        matrix = each.matrix / noise**2 + np.eye(rotors) / _STATE_DEVIATION**2
        matrix -= columns.T @ np.transpose([solve(column) for column in columns.T])
        score = each.right / noise**2 - columns.T @ solved
        found.append(each._replace(matrix=matrix, right=score))
    return found


def estimated_stamps(
    record: Record, windows: Sequence[FreeWindow], stamps: Array, noise: float
) -> Record | None:
    """Return `record` with corrected times, or None if the errors of stamps are not significant.

    `stamps` are the recorded times [s], and `noise` is the standard deviation of a reading [rad].

    The delay of a frame is estimated from its residuals, because a delay causes residuals that are
    proportional to the rates. Errors of the model also cause apparent delays, but these vary
    slowly. Therefore the variance of stamp errors is computed from second differences of the
    delays.
    """
    delays, weights = np.zeros((2, len(stamps)))
    sums, squares = 0.0, 0.0
    for window in windows:
        some = window.frames
        _, pulls, residuals = record.weighted(window)
        weights[some] = np.sum(pulls**2, axis=1)
        errors = noise**2 / np.maximum(weights[some], 1e-30)
        delays[some] = np.sum(pulls * residuals, axis=1) / np.maximum(weights[some], 1e-30)
        delays[some] += record.stamps.delays[some]
        bends = delays[some][1:-1] - (delays[some][:-2] + delays[some][2:]) / 2
        expected = errors[1:-1] + (errors[:-2] + errors[2:]) / 4
        sums += float(np.sum((bends**2 / expected - 1) / expected))
        squares += float(np.sum(1.5 / expected**2))
    spread = np.sqrt(3 / max(squares, 1e-30))
    variance = sums / max(squares, 1e-30)
    if variance < _SIGNIFICANT_STAMPS * spread:
        return None
    ratio = variance / noise**2
    delays *= ratio * weights / (1 + ratio * weights)
    return record._replace(times=stamps + delays, stamps=StampErrors(ratio, delays))


def inflated_covariance(covariance: Array, samples: Array, at: UnknownSlices) -> Array:
    """Return a covariance with standard deviations increased to the scatter of samples.

    `covariance`, (Q - 2 N, Q - 2 N), is the covariance of the unknowns of the chain. `samples`,
    (S, Q - 2 N), are S samples of these unknowns minus their fitted values. `at` contains the
    indices of the unknowns of each kind.

    The standard deviations of all lengths and offsets increase by one common factor: the root mean
    square of the ratios of samples to standard deviations, or 1 if this is larger. The standard
    deviations of all stiffnesses have a second factor, and those of all masses a third one; the
    others do not change. If factors within a kind differed, the variance of a combination in which
    errors compensate each other would become too large.
    """
    variances, factors = np.diag(covariance), np.ones(len(covariance))
    for part in (at.lengths, at.stiffnesses, at.masses):
        ratios = samples[:, part] ** 2 / variances[part]
        factors[part] = max(1.0, float(np.sqrt(np.mean(ratios))))
    return np.asarray(factors[:, None] * covariance * factors)
