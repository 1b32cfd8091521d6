# SPDX-License-Identifier: Apache-2.0
"""A chain and its forces by the free motion of springs, all frames at once.

Springs about a moving wall are strained, in proportion to the square of its speed, so that bonds
do not close. The motion follows from where it begins: least squares between its angles and the
readings is the likeliest chain under normal noise. Frames are divided into windows, each of which
begins anew, so that angles stay nearly linear in all unknowns (multiple shooting, after Bock);
windows grow as the chain becomes known, and end where the chain is pushed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.free_motion import FreeMotion, Parts, frames
from soliton_linkage.identification.least_squares import covariance_in, damped_change, minimised
from soliton_linkage.identification.lengths import Tolerances
from soliton_linkage.identification.readings import repeats
from soliton_linkage.identification.windows import (
    MASSES_BEGIN,
    FreeWindow,
    MotionPrior,
    WindowEquations,
    joined,
    measurable_changes,
    window_equations,
)
from soliton_linkage.linkage.chain import Array

_ALIKE = 0.03
"""Standard deviation of masses and stiffnesses while windows grow [1]: with 0.1 fits of wobbling
flippers ended in a neighbouring valley twice in ten, where stiffnesses are off by 8 to 10 %."""
_STEPS = 6
"""Steps with windows of one length, at most [1]; 2 or 3 are usual."""
_LAST_STEPS = 40
"""Steps with the longest windows for given tolerances [1]; 2 to 6 are usual, 20 where lengths and
stiffnesses stand in for each other along bent valleys."""
_ROUNDS = 4
"""Times that tolerances are learnt [1]."""
_SETTLED = 0.1
"""Gain that a step promises, as twice a logarithm of the likelihood, that ends the last steps [1]:
a third of the uncertainty of all unknowns together. What it keeps may be less by far where
valleys are bent, far from their end."""
_COARSE = 3.0
"""The same with shorter windows [1]."""
_STIFFER = (1, 1 / 5, 5)
"""Stiffnesses over the given one to begin with [1]; steps go a factor of 2 or 3 by themselves.
Springs that vibrate faster than frames come are none that frames show."""
_LEARNT = 0.05
"""Relative change of the tolerances that ends learning them [1]."""
_SAMPLES = 4
"""Of what readings leave open [1]: half of them tell deviations 1.4 times as badly, in half the
time."""
_SAMPLED_STEPS = 20
"""Of least squares for one of them, at most [1]; 3 to 10 are usual."""
_NEAR = 0.5
"""Distance of all angles of a motion from readings at which it follows them [rad]: a third of what
rotors turn by as a wall goes from one to the next, from where steps of least squares lead back."""
_UNEXPLAINED = 3.0
"""Noise that is left over that of readings, beyond which springs are no model of them [1]: then no
more is to be learnt of how unsure they are, which takes most of the time."""
_CHANCE = 3.0
"""By how many standard deviations bars must leave more than springs [1]."""


@dataclass(frozen=True)
class MotionFit:
    """A motion that the readings show, and how well."""

    windows: tuple[FreeWindow, ...]
    covariance: Array
    """Of the unknowns of the chain, in their order, shape (Q - 2 N, Q - 2 N)."""
    information: Array
    """What readings alone say of the same."""
    basis: Array
    """Orthonormal changes of a chain that keep the mean spacing and the mean mass."""
    noise: float
    """Standard deviation of a reading [rad], by what the motion leaves of all."""
    times: Array
    """Of the frames [s], shape (T,)."""
    left: Array
    """What is left of readings [rad], over their spreads, 0 where none was read, (T, N)."""
    prior: MotionPrior

    @property
    def motion(self) -> FreeMotion:
        """Of the first window."""
        return self.windows[0].motion


class MotionFitting:
    """Brings a chain, and where each window begins, ever nearer to readings."""

    def __init__(
        self,
        windows: Sequence[FreeWindow],
        times: Array,
        readings: Array,
        spreads: Array,
        noise: float,
        tolerance: float | None,
        gravity_known: bool = True,
    ) -> None:
        """Begin with motions, for readings [rad], NaN where missing, (T, N), of times [s], (T,).

        The standard deviation of a reading is its spread [1], (T, N), times the noise [rad]. A
        tolerance of lengths [1] is learnt unless it is given, and gravity where it is not known
        in lengths of the mean spacing, as that is not.
        """
        self._times, self._readings = times, readings
        self._repeats = repeats(readings)
        self._spreads = spreads * np.sqrt(self._repeats)
        self._noise, self._tolerance = noise, tolerance
        self._windows = tuple(windows)
        motion = self._motion
        self._prior = MotionPrior(
            motion.gravity,
            Tolerances(tolerance or Tolerances.of_lengths),
            _ALIKE,
        )
        self._rotors = len(motion.masses)
        self._basis = measurable_changes(motion, gravity_known)

    def fit(self, of_bars: float) -> MotionFit | None:
        """Chain that all readings show, None where bars, which leave a noise [rad], do as well."""
        if not self._begun(of_bars):
            return None
        while (windows := joined(self._windows, self._follows)) != self._windows:
            self._windows = windows
            self._improve(_STEPS, _COARSE)
        self._prior = replace(self._prior, of_masses=MASSES_BEGIN)
        most = _UNEXPLAINED * self._noise
        for _ in range(_ROUNDS):
            self._improve(_LAST_STEPS, _SETTLED)
            before = self._prior.tolerances
            covariance, information = self._learn()
            if self._noise > most or self._prior.tolerances.close_to(before, _LEARNT):
                break
        if self._noise > of_bars:
            return None
        if self._noise <= most:
            covariance = inflated_covariance(covariance, self._samples(), self._motion.parts)
        left = np.zeros_like(self._readings)
        for window in self._windows:
            repeated = np.sqrt(self._repeats[window.frames])
            left[window.frames] = np.nan_to_num(self._left(window) * repeated)
        return MotionFit(
            tuple(window._replace(motion=window.motion.in_means()) for window in self._windows),
            covariance,
            information,
            self._basis,
            self._noise,
            self._times,
            left,
            self._prior,
        )

    def _samples(self) -> Array:
        """Changes to chains that readings and their prior allow as well, (S, Q - 2 N).

        Least squares with readings and a prior that are drawn about their own are, where motions
        are linear in all unknowns, as likely as these leave it, and nearly so elsewhere
        (randomized maximum likelihood: Oliver, He and Reynolds 1996).
        """
        found, readings, prior = self._windows, self._readings, self._prior
        random, values = np.random.default_rng(0), prior.about(self._motion)[1]
        samples = []
        for _ in range(_SAMPLES):
            noise = self._noise * self._spreads * random.standard_normal(readings.shape)
            self._readings = readings + noise
            self._prior = prior.drawn(found[0].motion, random)
            self._improve(_SAMPLED_STEPS, _SETTLED)
            samples.append(prior.about(self._motion)[1] - values)
            self._windows, self._readings, self._prior = found, readings, prior
        return np.array(samples)

    def _begun(self, of_bars: float) -> bool:
        """Begin with the stiffness about the given one that leaves least, if less than bars."""
        given, found = self._windows, []
        stiffest = float(np.median(np.diff(self._times))) ** -2
        for factor in _STIFFER:
            stiffened = factor * given[0].motion.stiffnesses
            self._windows = tuple(
                window._replace(motion=replace(window.motion, stiffnesses=stiffened))
                for window in given
            )
            if factor > 1 and self._motion.stiffnesses.max() > stiffest:
                continue
            self._improve(_STEPS, _COARSE)
            if of_bars**2 > self._squared_noise() * (1 + _CHANCE * self._chance()):
                self._windows = joined(self._windows, self._follows)
                self._improve(_STEPS, _COARSE)
                found.append((self._cost(self._windows), self._windows))
                if self._squared_noise() < self._noise**2 * (1 + _CHANCE * self._chance()):
                    break
        if found:
            self._windows = min(found, key=lambda each: each[0])[1]
        return bool(found)

    def _squared_noise(self) -> float:
        """Of readings, by what the windows leave of them [rad^2]."""
        squares = sum(float(np.nansum(self._left(window) ** 2)) for window in self._windows)
        return float(squares / max(self._freedom() - self._motion.parts.forces.stop, 1.0))

    def _freedom(self) -> float:
        """Number of independent readings beyond those that tell where windows begin.

        What is read of a rotor at rest may be less than that.
        """
        seen = (self._counts(window).sum(axis=0) for window in self._windows)
        return sum(float(np.maximum(each - 2, 0).sum()) for each in seen)

    def _counts(self, window: FreeWindow) -> Array:
        """How much of an independent reading each is of a window [1], (T, N)."""
        return np.asarray(self._seen(window) / self._repeats[window.frames])

    def _chance(self) -> float:
        """Standard deviation of what bars leave more of noise squared, over that [1].

        Bars and springs leave the same of a frame but for what springs say more, one number.
        """
        seen = sum(float(self._counts(window).sum()) for window in self._windows)
        return math.sqrt(2 / (seen * self._rotors))

    @property
    def _motion(self) -> FreeMotion:
        return self._windows[0].motion

    def _left(self, window: FreeWindow) -> Array:
        """What a window leaves of its readings [rad], over their spreads, NaN where missing."""
        angles = frames(window.motion, self._times[window.frames])
        left = self._readings[window.frames] - window.motion.lengths.offsets - angles
        return np.asarray(left / self._spreads[window.frames])

    def _follows(self, window: FreeWindow, frames: slice) -> bool:
        """Whether the motion of a window is near the readings of its last frames."""
        errors = self._left(window)[frames.start - window.frames.start :] * self._spreads[frames]
        return bool(np.nansum(errors**2) < _NEAR**2 * len(errors))

    def _cost(self, windows: Sequence[FreeWindow]) -> float:
        """Twice the negative logarithm of the likelihood, infinite where a motion runs away."""
        information, values = self._prior.about(windows[0].motion)
        cost = float(values @ information @ values)
        for window in windows:
            left = self._left(window)
            if not np.isfinite(left[self._seen(window)]).all():
                return math.inf
            cost += float(np.nansum(left**2)) / self._noise**2
        return cost

    def _seen(self, window: FreeWindow) -> Array:
        return np.isfinite(self._readings[window.frames])

    def _equations(self, windows: Sequence[FreeWindow]) -> list[WindowEquations]:
        given = self._times, self._readings, self._spreads
        return [window_equations(window, *given) for window in windows]

    def _improve(self, steps: int, settled: float) -> None:
        """Take some steps of least squares, until one gains little."""
        self._windows = minimised(self._windows, self._linearised, self._cost, steps, settled)

    def _linearised(
        self, windows: tuple[FreeWindow, ...]
    ) -> Callable[[float], tuple[tuple[FreeWindow, ...], float]]:
        """Return a function from a damping to the windows after a step and the promised gain."""
        equations = self._equations(windows)
        information, values = self._prior.about(windows[0].motion)

        def step(damping: float) -> tuple[tuple[FreeWindow, ...], float]:
            told = [each.eliminated(self._rotors, self._noise, damping) for each in equations]
            matrix = information + np.sum([each.matrix for each in told], axis=0)
            vector = np.sum([each.vector for each in told], axis=0) - information @ values
            change = damped_change(matrix, vector, self._basis, damping)
            changed = tuple(
                window._replace(motion=window.motion.changed(each.change(change)))
                for window, each in zip(windows, told, strict=True)
            )
            return changed, float(change @ vector) + sum(each.gain for each in told)

        return step

    def _learn(self) -> tuple[Array, Array]:
        """Learn noise and tolerances from all frames; covariance of the chain, information."""
        equations, motion = self._equations(self._windows), self._motion
        told = [each.eliminated(self._rotors, self._noise, 0.0) for each in equations]
        information = np.sum([each.matrix for each in told], axis=0)
        whole = information + self._prior.about(motion)[0]
        covariance = covariance_in(self._basis, whole)
        known = float(np.sum(covariance * information))
        squares = sum(each.squares for each in equations)
        self._noise = math.sqrt(squares / max(self._freedom() - known, 1.0))
        self._prior = self._prior.relearnt(motion, covariance, self._tolerance)
        return covariance, information


def inflated_covariance(covariance: Array, samples: Array, at: Parts) -> Array:
    """Return the covariance of a chain, (P, P), as wide as samples of its changes, (S, P).

    Lengths, stiffnesses and masses compensate each other along curved valleys, and samples spread
    further than to first order: by one factor for lengths and offsets, one for stiffnesses and one
    for masses, as samples are few, and none below 1: to first order they are the least that there
    is.
    """
    variances, factors = np.diag(covariance), np.ones(len(covariance))
    for part in (at.lengths, at.stiffnesses, at.masses):
        over = samples[:, part] ** 2 / variances[part]
        factors[part] = max(1.0, float(np.sqrt(np.mean(over))))
    return np.asarray(factors[:, None] * covariance * factors)
