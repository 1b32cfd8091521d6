# SPDX-License-Identifier: Apache-2.0
"""Windows of frames in which nothing but springs moves rotors, their normal equations and prior.

With the normal equations of a window in blocks of the chain q and its begin s,

    (A_qq - A_qs A_ss^-1 A_sq) dq = b_q - A_qs A_ss^-1 b_s

adds up to the information of all windows on the chain, and ds = A_ss^-1 (b_s - A_sq dq).
A priori, lengths are alike as `Tolerances` state, and so are stiffnesses and masses: their
logarithms are normal about a mean, with a standard deviation that is learnt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from soliton_linkage.identification.adjustment import measurable
from soliton_linkage.identification.free_motion import FreeMotion, frames_with_changes
from soliton_linkage.identification.lengths import OF_A_ROTOR, Tolerances, unknowns_of
from soliton_linkage.linkage.chain import Array

_FIRST = 25
"""Frames of a window to begin with [1]: in half as many rates are unsure, in twice as many walls
of chains that are 5 % off may be lost."""
_OF_RATES = 8
"""Frames by which rates at the begin of a window are told [1]."""
_FEWEST = 100
"""Frames between pushes that count, at least [1]: a wall passes some rotors in them."""
_ARRIVAL = 0.05
"""Time in which a push arrives [s]: commands act when they come, whatever their stamps say."""
_JOINED = 4
"""Windows that are made one [1]: 2 take more rounds, 8 may lose a wall."""


_IN_A_ROW = 0.05
"""Share of the frames, at least, that follow each other as they were recorded [1], where most are
left out for being of rotors at rest."""


class FreeWindow(NamedTuple):
    """Frames in a row of one free motion."""

    frames: slice
    motion: FreeMotion
    """Of which all windows share the chain."""


def free_spans(times: Array, pushes: Sequence[float]) -> list[slice]:
    """Frames between pushes [s], but for times that are too short to tell anything."""
    begins = [-math.inf, *(push + _ARRIVAL for push in sorted(pushes))]
    ends = [*sorted(pushes), math.inf]
    spans = [
        slice(int(np.searchsorted(times, begin, 'right')), int(np.searchsorted(times, end)))
        for begin, end in zip(begins, ends, strict=True)
    ]
    return [span for span in spans if span.stop - span.start >= _FEWEST]


def first_windows(
    times: Array,
    angles: Array,
    chain: FreeMotion,
    pushes: Sequence[float],
    tilt_at: Callable[[float], float] = lambda _: 0.0,
) -> list[FreeWindow]:
    """Short windows between pushes [s], which begin as angles [rad], (T, N), of times [s] do.

    None goes on where frames are left out, for so long that they tell no rates. The chain has a
    tilt [rad] at each instant [s].
    """
    made = []
    whole = free_spans(times, pushes)
    for span in (part for each in whole for part in _without_gaps(times, each)):
        tilted = replace(chain, tilt=tilt_at(float(times[span.start])))
        for begin in range(span.start, span.stop - _FIRST + 1, _FIRST):
            stop = begin + _FIRST
            own = slice(begin, span.stop if span.stop - stop < _FIRST else stop)
            few = slice(begin, begin + _OF_RATES)
            slopes = np.polyfit(times[few] - times[begin], angles[few], 1)
            made.append(FreeWindow(own, replace(tilted, angles=slopes[1], rates=slopes[0])))
    return made


def _without_gaps(times: Array, span: slice) -> list[slice]:
    """Parts of a span between which frames are left out, but for those that tell nothing."""
    between = np.diff(times)
    long = between > _OF_RATES * np.quantile(between, _IN_A_ROW)
    inner = 1 + span.start + np.flatnonzero(long[span.start : span.stop - 1])
    parts = [slice(*each) for each in pairwise([span.start, *inner.tolist(), span.stop])]
    return [part for part in parts if part.stop - part.start >= _FEWEST]


def joined(
    windows: Sequence[FreeWindow], follows: Callable[[FreeWindow, slice], bool]
) -> tuple[FreeWindow, ...]:
    """Windows of which some that follow each other without a frame between are one.

    As long as the motion of the first, in a window with the frames of both, follows those of the
    next.
    """
    made: list[FreeWindow] = []
    count = 0
    for window in windows:
        if made and count < _JOINED and made[-1].frames.stop == window.frames.start:
            whole = FreeWindow(slice(made[-1].frames.start, window.frames.stop), made[-1].motion)
            if follows(whole, window.frames):
                made[-1] = whole
                count += 1
                continue
        made.append(window)
        count = 1
    return tuple(made)


MASSES_BEGIN = 0.1
"""Standard deviation of masses and stiffnesses to begin with [1]: 0.3 lets some run away."""
_NARROWEST, _WIDEST = 1e-3, 0.3
"""The smallest and the largest that is learnt [1]."""
_DECAY = 1.0
"""Standard deviation of damping over a rotor's moment of inertia [1/s]."""
_STOPPING = 10.0
"""Standard deviation of what dry friction slows a rotor down by [rad/s^2]: rotors of a wall stop
in a second."""
_TOLD = 1e-12
"""Information on a change of the unknowns over the largest [1], below which it is rounding."""
_FALLING = 1.0
"""The same of the logarithm of gravity [1], whose unit is the mean spacing."""


def spreads_of_forces(inertia: float) -> Array:
    """Standard deviations of damping, friction and log gravity, for the inertia of a rotor."""
    return np.array([_DECAY * inertia, _STOPPING * inertia, _FALLING])


def learnt_spread(squares: float, count: int) -> float:
    """Standard deviation of so many logarithms of masses [1], by the sum of their squares."""
    return min(max(math.sqrt(squares / count), _NARROWEST), _WIDEST)


@dataclass(frozen=True)
class MotionPrior:
    """Normal distribution of the unknowns of a chain of springs."""

    gravity: float
    """About which the logarithm of gravity is normal [length/s^2], 0 for none."""
    tolerances: Tolerances
    of_masses: float = MASSES_BEGIN
    """Standard deviation by which masses and stiffnesses differ from each other [1]."""
    shift: Array | float = 0.0
    """Of its mean, in the order of the unknowns, (Q - 2 N,)."""

    def about(self, motion: FreeMotion) -> tuple[Array, Array]:
        """Information on a chain, (Q - 2 N, Q - 2 N), and its unknowns, from the mean on."""
        at, rotors = motion.parts, len(motion.masses)
        size = at.forces.stop
        information, values = np.zeros((size, size)), np.zeros(size)
        information[at.lengths, at.lengths] = self.tolerances.information(rotors)
        alike = np.eye(rotors - 1) - 1 / (rotors - 1)
        information[at.stiffnesses, at.stiffnesses] = alike / self.of_masses**2
        information[at.masses, at.masses] = np.eye(rotors) / self.of_masses**2
        spreads = spreads_of_forces(float(motion.inertias.mean()))
        information[at.forces, at.forces] = np.diag(spreads**-2)
        values[at.lengths] = unknowns_of(motion.lengths)
        values[at.stiffnesses] = np.log(motion.stiffnesses)
        values[at.masses] = np.log(motion.masses)
        fallen = math.log(motion.gravity / self.gravity) if self.gravity else 0.0
        values[at.forces] = motion.damping, motion.friction, fallen
        return information, values - self.shift

    def drawn(self, motion: FreeMotion, random: np.random.Generator) -> MotionPrior:
        """Return the prior about a mean that is drawn from it, without what it does not inform.

        The symmetric root of the covariance keeps the draw the same where eigenvalues are equal.
        """
        values, vectors = np.linalg.eigh(self.about(motion)[0])
        informed = values > _TOLD * values[-1]
        values, vectors = values[informed], vectors[:, informed]
        steps = vectors.T @ random.standard_normal(len(vectors)) / np.sqrt(values)
        return replace(self, shift=np.asarray(vectors @ steps))

    def relearnt(
        self, motion: FreeMotion, covariance: Array, tolerance: float | None
    ) -> MotionPrior:
        """The same as wide as a chain shows it, given what is known of that.

        A tolerance of lengths [1] is kept where it is given.
        """
        at = motion.parts
        of_lengths = covariance[at.lengths, at.lengths]
        tolerances = self.tolerances.relearnt(motion.lengths, of_lengths, tolerance)
        springs, masses = np.log(motion.stiffnesses), np.log(motion.masses)
        squares = np.sum((springs - springs.mean()) ** 2) + np.sum(masses**2)
        squares += np.diag(covariance)[at.stiffnesses.start : at.masses.stop].sum()
        spread = learnt_spread(float(squares), 2 * len(masses) - 3)
        return MotionPrior(self.gravity, tolerances, spread)


def measurable_changes(motion: FreeMotion, gravity_known: bool) -> Array:
    """Orthonormal changes of a chain that keep the mean spacing and the mean mass.

    And gravity, where that is known, or there is none.
    """
    at, rotors = motion.parts, len(motion.masses)
    basis = np.eye(at.forces.stop)
    alike = np.linalg.qr(np.ones((rotors, 1)), mode='complete')[0][:, 1:]
    lengths = measurable(motion.lengths)
    basis[at.lengths, at.lengths] = basis[at.masses, at.masses] = 0
    basis[at.lengths, : lengths.shape[1]] = lengths
    basis[at.masses, at.masses.start : at.masses.stop - 1] = alike
    kept = [lengths.shape[1], at.masses.stop - 1]
    if gravity_known or not motion.gravity:
        kept.append(at.forces.stop - 1)
    return np.delete(basis, kept, axis=1)


_UNSURE = 10.0
"""Standard deviation of a begin that no reading tells [rad], [rad/s]: more than rotors do."""


class Eliminated(NamedTuple):
    """What a window says of the chain, and how its begin follows from that."""

    matrix: Array
    """(Q - 2 N, Q - 2 N)."""
    vector: Array
    """(Q - 2 N,)."""
    begin: Array
    """A_ss^-1 b_s, (2 N,)."""
    across: Array
    """A_ss^-1 A_sq, (2 N, Q - 2 N)."""
    gain: float
    """b_s A_ss^-1 b_s: what the squares lose by the begin where the chain keeps still [1]."""

    def change(self, of_chain: Array) -> Array:
        """Change of all unknowns of the window, (Q,), given that of the chain."""
        return np.concatenate([of_chain, self.begin - self.across @ of_chain])


class WindowEquations(NamedTuple):
    """Normal equations of a window, for readings of unit variance; its begin is at the end."""

    matrix: Array
    """(Q, Q)."""
    vector: Array
    """(Q,)."""
    squares: float
    """Of what is left of the readings [rad^2]."""

    def eliminated(self, rotors: int, noise: float, damping: float) -> Eliminated:
        """Eliminate the begin, for a noise of readings [rad], with a damped step [1]."""
        matrix, vector = self.matrix / noise**2, self.vector / noise**2
        size = len(vector) - 2 * rotors
        begin = matrix[size:, size:] * (1 + damping * np.eye(2 * rotors))
        begin += np.eye(2 * rotors) / _UNSURE**2
        across = np.asarray(np.linalg.solve(begin, matrix[size:, :size]))
        moved = np.asarray(np.linalg.solve(begin, vector[size:]))
        return Eliminated(
            matrix[:size, :size] - matrix[:size, size:] @ across,
            vector[:size] - matrix[:size, size:] @ moved,
            moved,
            across,
            float(vector[size:] @ moved),
        )


def window_equations(
    window: FreeWindow, times: Array, readings: Array, spreads: Array
) -> WindowEquations:
    """Normal equations of a window of all readings [rad] and their spreads [1], (T, N)."""
    rotors = np.arange(readings.shape[1])
    rows, angles = [], []
    for frame, x in frames_with_changes(window.motion, times[window.frames]):
        x[rotors, OF_A_ROTOR * rotors + 1] += 1
        rows.append(x)
        angles.append(frame)
    left = readings[window.frames] - window.motion.lengths.offsets - np.array(angles)
    seen = np.isfinite(left)
    weights = 1 / spreads[window.frames][seen]
    slopes, errors = np.array(rows)[seen] * weights[:, None], left[seen] * weights
    return WindowEquations(slopes.T @ slopes, slopes.T @ errors, float(errors @ errors))
