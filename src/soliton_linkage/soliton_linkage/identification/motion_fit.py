# SPDX-License-Identifier: Apache-2.0
"""Estimation of a chain of springs and the forces on its rotors from its free motion.

The strain of springs near a moving wall is proportional to the square of the speed of the wall, so
that the bonds do not close with the relaxed lengths. The equation of motion determines all angles
from the initial state. The most likely chain minimises the squared differences between these
angles and the readings.

The frames are divided into windows with separate initial states, so that angles are nearly linear
in all unknowns (multiple shooting, after Bock). As the estimate improves, windows are merged. No
window extends over an impulse.

The initial states are eliminated from the normal equations of the chain.
`scipy.optimize.least_squares` is not used, because its Jacobian would contain the initial states
and need 10 GB for 3000 frames of 40 rotors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from soliton_linkage.identification.bundle import covariance_in
from soliton_linkage.identification.free_motion import (
    FreeMotion,
    UnknownSlices,
    angles_at,
    states_at,
)
from soliton_linkage.identification.lengths import Tolerances
from soliton_linkage.identification.readings import repeat_counts
from soliton_linkage.identification.windows import (
    INITIAL_MASS_DEVIATION,
    FreeWindow,
    MotionPrior,
    StampErrors,
    WindowEquations,
    merge_windows,
    observable_changes,
    window_equations,
)
from soliton_linkage.linkage.chain import Array

_GROWTH_MASS_DEVIATION = 0.03
"""Prior standard deviation of masses and stiffnesses while windows are merged [1]. Sensitivity: at
0.1, two of ten fits of wobbling flippers converged to a local minimum with errors of the stiffness
of 8 to 10 %."""
_STEPS = 6
"""Largest number of steps before windows are merged again [1]; usually 2 or 3 are taken."""
_LAST_STEPS = 40
"""Largest number of steps with the longest windows before tolerances are estimated [1]. Usually 2
to 6 steps are taken. In curved valleys of the cost, along which lengths and stiffnesses compensate
each other, 20 steps are needed."""
_ROUNDS = 4
"""Largest number of times that tolerances are estimated [1]."""
_CONVERGED = 0.1
"""Threshold of the expected decrease of -2 log likelihood in a step [1]: the steps with the
longest windows end if it is smaller. The value corresponds to a third of a standard deviation. In
curved valleys the actual decrease may be much smaller than the expected one."""
_COARSE = 3.0
"""Threshold of the same decrease at which the steps with shorter windows end [1]."""
_STIFFNESS_FACTORS = (1, 1 / 5, 5)
"""Initial stiffnesses that are tried, relative to the given stiffness [1]. The fit can correct
errors by a factor of 2 or 3. A stiffness is omitted if its vibrations are faster than the frame
rate."""
_TOLERANCE_CHANGE = 0.05
"""Threshold of the relative change of the tolerances [1]: they have converged if they change by
less."""
_SAMPLES = 4
"""Number of samples of the posterior [1]. Sensitivity: at 0.5x, sampling takes half the time, and
the uncertainty of the standard deviations is 1.4 times as large."""
_SAMPLED_STEPS = 20
"""Largest number of steps for a sample [1]; usually 3 to 10 are taken."""
_FITTING = 0.5
"""Threshold of the rms difference between motion and readings [rad]: windows are merged if the
difference is smaller. Least squares converges from this difference, which is a third of the
rotation of a rotor by a wall."""
UNEXPLAINED = 1.5
"""Threshold of the ratio of residual noise to reading noise [1]: the model does not explain the
readings if the ratio is larger. The posterior is then not sampled, because this would take most of
the time."""
_SIGNIFICANT = 3.0
"""Threshold of the difference between the residuals of bars and of springs, in its standard
deviations [1]: a larger difference is significant."""
_SIGNIFICANT_STAMPS = 6.0
"""Threshold of the variance of stamp errors, in its standard deviations [1]: a larger variance is
significant."""
_DAMPINGS = 12
"""Number of damping factors that are tried for one step [1]; the last factor is 100."""
_DAMPED = 1e-3
"""Threshold of the damping factor [1]: with more damping, a small expected decrease does not mean
convergence, because the step may be too short."""


@dataclass(frozen=True)
class MotionFit:
    """A free motion that fits the readings, with the covariance of the chain."""

    windows: tuple[FreeWindow, ...]
    covariance: Array
    """Covariance of the Q - 2 N unknowns of the chain, shape (Q - 2 N, Q - 2 N)."""
    information: Array
    """Information of the readings on the same unknowns, without the prior, same shape."""
    basis: Array
    """Orthonormal basis of the changes of a chain that keep its mean spacing and mean mass."""
    noise: float
    """Standard deviation of a reading, estimated from the residuals [rad]."""
    residuals: Array
    """Residuals divided by the relative deviations of the readings [rad], shape (T, N).

    Missing readings have the residual 0.
    """
    prior: MotionPrior
    stamp_deviation: float
    """Standard deviation of the errors of time stamps [s], 0 if negligible."""

    @property
    def motion(self) -> FreeMotion:
        """Motion of the first window."""
        return self.windows[0].motion


class MotionFitter:
    """Levenberg-Marquardt fit to readings; unknown are the chain and the states of windows."""

    def __init__(
        self,
        windows: Sequence[FreeWindow],
        times: Array,
        readings: Array,
        relative_deviations: Array,
        noise: float,
        tolerance: float | None,
        gravity_known: bool = True,
    ) -> None:
        """Start with motions that approximate the readings.

        `readings` [rad] have the shape (T, N); missing readings are NaN. `times` [s] have the
        shape (T,). The standard deviation of a reading is its relative deviation [1], (T, N),
        times `noise` [rad]. The tolerance of lengths [1] is estimated if it is None. Gravity is
        estimated unless `gravity_known`.
        """
        self._stamps, self._times, self._readings = times, times, readings
        self._stamp_errors = StampErrors(0.0, np.zeros_like(times))
        self._repeats = repeat_counts(readings)
        self._deviations = relative_deviations * np.sqrt(self._repeats)
        self._noise, self._tolerance = noise, tolerance
        self._windows = tuple(windows)
        motion = self._motion
        tolerances = Tolerances(tolerance or Tolerances.lengths)
        self._prior = MotionPrior(motion.gravity, tolerances, _GROWTH_MASS_DEVIATION)
        self._rotors = len(motion.masses)
        self._basis = observable_changes(motion, gravity_known)

    def fit(self, bar_noise: float) -> MotionFit | None:
        """Fit the chain to all readings; return None if bars explain the readings equally well.

        `bar_noise` is the standard deviation of a reading if bonds are bars [rad].
        """
        if not self._begin(bar_noise):
            return None
        while (windows := merge_windows(self._windows, self._fits)) != self._windows:
            self._windows = windows
            self._improve(_STEPS, _COARSE)
            if self._stamp_errors.variance:
                self._correct_stamps()
        self._prior = replace(self._prior, mass_deviation=INITIAL_MASS_DEVIATION)
        most = UNEXPLAINED * self._noise
        for _ in range(_ROUNDS):
            self._correct_stamps()
            self._improve(_LAST_STEPS, _CONVERGED)
            before = self._prior.tolerances
            covariance, information = self._reestimate()
            converged = self._prior.tolerances.is_close(before, _TOLERANCE_CHANGE)
            if self._noise > most or converged:
                break
        if self._noise > bar_noise:
            return None
        if self._noise <= most:
            covariance = inflated_covariance(covariance, self._samples(), self._motion.slices)
        residuals = np.zeros_like(self._readings)
        for window in self._windows:
            repeated = np.sqrt(self._repeats[window.frames])
            residuals[window.frames] = np.nan_to_num(self._residuals(window) * repeated)
        return MotionFit(
            tuple(window._replace(motion=window.motion.normalised()) for window in self._windows),
            covariance,
            information,
            self._basis,
            self._noise,
            residuals,
            self._prior,
            math.sqrt(self._stamp_errors.variance) * self._noise,
        )

    def _samples(self) -> Array:
        """Return S samples of the posterior, as changes of the chain, shape (S, Q - 2 N).

        For each sample, random errors are added to the readings and to the prior mean, and the
        cost is minimised again. The samples are exact if motions are linear in all unknowns
        (randomized maximum likelihood: Oliver, He and Reynolds 1996).
        """
        found, readings, prior = self._windows, self._readings, self._prior
        random, values = np.random.default_rng(0), prior.evaluate(self._motion)[1]
        samples = []
        for _ in range(_SAMPLES):
            noise = self._noise * self._deviations * random.standard_normal(readings.shape)
            self._readings = readings + noise
            self._prior = prior.sampled(found[0].motion, random)
            self._improve(_SAMPLED_STEPS, _CONVERGED)
            samples.append(prior.evaluate(self._motion)[1] - values)
            self._windows, self._readings, self._prior = found, readings, prior
        return np.array(samples)

    def _begin(self, bar_noise: float) -> bool:
        """Find the best initial stiffness; return whether springs fit better than bars."""
        given, found = self._windows, []
        stiffest = float(np.median(np.diff(self._times))) ** -2
        for factor in _STIFFNESS_FACTORS:
            stiffnesses = factor * given[0].motion.stiffnesses
            self._windows = tuple(
                window._replace(motion=replace(window.motion, stiffnesses=stiffnesses))
                for window in given
            )
            if factor > 1 and self._motion.stiffnesses.max() > stiffest:
                continue
            self._improve(_STEPS, _COARSE)
            if self._correct_stamps():
                self._improve(_STEPS, _COARSE)
            if bar_noise**2 > self._squared_noise() * (1 + _SIGNIFICANT * self._scatter()):
                self._windows = merge_windows(self._windows, self._fits)
                self._improve(_STEPS, _COARSE)
                found.append((self._cost(self._windows), self._windows))
                limit = self._noise**2 * (1 + _SIGNIFICANT * self._scatter())
                if self._squared_noise() < limit:
                    break
        if found:
            self._windows = min(found, key=lambda each: each[0])[1]
        return bool(found)

    def _squared_noise(self) -> float:
        """Return the variance of a reading, estimated from the residuals [rad^2]."""
        squares = sum(float(np.sum(self._whitened(window) ** 2)) for window in self._windows)
        return float(squares / max(self._freedom() - self._motion.slices.forces.stop, 1.0))

    def _freedom(self) -> float:
        """Return the number of independent readings minus the number of initial values."""
        counts = (self._counts(window).sum(axis=0) for window in self._windows)
        return sum(float(np.maximum(each - 2, 0).sum()) for each in counts)

    def _counts(self, window: FreeWindow) -> Array:
        """Return the weight of each reading, 1 for an independent reading [1], shape (T, N)."""
        return np.asarray(self._seen(window) / self._repeats[window.frames])

    def _scatter(self) -> float:
        """Return the standard deviation of the ratio of residual variances, bars to springs [1].

        The residuals of the two models differ by one independent number per frame.
        """
        count = sum(float(self._counts(window).sum()) for window in self._windows)
        return math.sqrt(2 / (count * self._rotors))

    @property
    def _motion(self) -> FreeMotion:
        return self._windows[0].motion

    def _residuals(self, window: FreeWindow) -> Array:
        """Return the residuals of a window divided by relative deviations [rad], (T, N).

        Missing readings have the residual NaN.
        """
        angles = angles_at(window.motion, self._times[window.frames])
        residuals = self._readings[window.frames] - window.motion.lengths.offsets - angles
        return np.asarray(residuals / self._deviations[window.frames])

    def _whitened(self, window: FreeWindow, residuals: Array | None = None) -> Array:
        """Return the residuals of a window, 0 if missing, corrected for errors of time stamps."""
        if residuals is None:
            residuals = self._residuals(window)
        errors = np.nan_to_num(residuals)
        if self._stamp_errors.variance:
            pulls = np.where(np.isfinite(residuals), self._pulls(window), 0.0)
            self._stamp_errors.whiten(window.frames, pulls, errors, np.empty(0))
        return errors

    def _pulls(self, window: FreeWindow) -> Array:
        """Return rates divided by the relative deviations of the readings [rad/s], (T, N)."""
        rates = states_at(window.motion, self._times[window.frames])[:, 1]
        return np.asarray(rates / self._deviations[window.frames])

    def _correct_stamps(self) -> bool:
        """Estimate the errors of time stamps; return whether they are significant.

        The component of the residuals along the rates gives the delay of each frame. The variance
        of stamp errors is computed from second differences of these delays, because model errors
        also cause delays, but slowly varying ones.
        """
        delays, weights = np.zeros((2, len(self._times)))
        sums, squares = 0.0, 0.0
        for window in self._windows:
            residuals, some = self._residuals(window), window.frames
            pulls = np.where(np.isfinite(residuals), self._pulls(window), 0.0)
            weight = np.sum(pulls**2, axis=1)
            shifts = np.sum(pulls * np.nan_to_num(residuals), axis=1) / np.maximum(weight, 1e-30)
            delays[some] = shifts + (self._times - self._stamps)[some]
            weights[some] = weight
            errors = self._noise**2 / np.maximum(weight, 1e-30)
            bends = delays[some][1:-1] - (delays[some][:-2] + delays[some][2:]) / 2
            expected = errors[1:-1] + (errors[:-2] + errors[2:]) / 4
            sums += float(np.sum((bends**2 / expected - 1) / expected))
            squares += float(np.sum(1.5 / expected**2))
        spread = math.sqrt(3 / max(squares, 1e-30))
        variance = sums / max(squares, 1e-30)
        if variance < _SIGNIFICANT_STAMPS * spread:
            return False
        ratio = variance / self._noise**2
        delays *= ratio * weights / (1 + ratio * weights)
        self._stamp_errors = StampErrors(ratio, delays)
        self._times = self._stamps + delays
        return True

    def _fits(self, window: FreeWindow, frames: slice) -> bool:
        """Return whether the motion of a window is close to the readings of its last frames."""
        errors = self._residuals(window)[frames.start - window.frames.start :]
        errors = errors * self._deviations[frames]
        return bool(np.nansum(errors**2) < _FITTING**2 * len(errors))

    def _cost(self, windows: Sequence[FreeWindow]) -> float:
        """Return -2 log likelihood, or infinity if a motion diverges."""
        information, values = self._prior.evaluate(windows[0].motion)
        cost = float(values @ information @ values)
        for window in windows:
            residuals = self._residuals(window)
            if not np.isfinite(residuals[self._seen(window)]).all():
                return math.inf
            cost += float(np.sum(self._whitened(window, residuals) ** 2)) / self._noise**2
        return cost

    def _seen(self, window: FreeWindow) -> Array:
        return np.isfinite(self._readings[window.frames])

    def _equations(self) -> list[WindowEquations]:
        given = self._times, self._readings, self._deviations, self._stamp_errors
        return [window_equations(window, *given) for window in self._windows]

    def _improve(self, steps: int, converged: float) -> None:
        """Take Levenberg-Marquardt steps until the expected decrease is below `converged`."""
        damping, before = 0.0, self._cost(self._windows)
        for _ in range(steps):
            step = self._linearised()
            for _ in range(_DAMPINGS):
                changed, expected = step(damping)
                with np.errstate(all='ignore'):
                    after = self._cost(changed)
                if after < before:
                    break
                damping = max(4 * damping, 1e-4)
            else:
                return
            self._windows, before = changed, after
            if expected < converged and damping < _DAMPED:
                return
            damping /= 8

    def _linearised(self) -> Callable[[float], tuple[tuple[FreeWindow, ...], float]]:
        """Return a function that takes a step with a given damping.

        The function returns the windows after the step and the expected decrease of the cost.
        """
        windows, equations = self._windows, self._equations()
        information, values = self._prior.evaluate(windows[0].motion)

        def step(damping: float) -> tuple[tuple[FreeWindow, ...], float]:
            parts = [each.eliminated(self._rotors, self._noise, damping) for each in equations]
            matrix = information + np.sum([each.matrix for each in parts], axis=0)
            vector = np.sum([each.vector for each in parts], axis=0) - information @ values
            reduced = self._basis.T @ matrix @ self._basis
            reduced += damping * np.diag(np.diag(reduced))
            change = self._basis @ np.linalg.solve(reduced, self._basis.T @ vector)
            changed = tuple(
                window._replace(motion=window.motion.changed(each.change(change)))
                for window, each in zip(windows, parts, strict=True)
            )
            return changed, float(change @ vector) + sum(each.gain for each in parts)

        return step

    def _reestimate(self) -> tuple[Array, Array]:
        """Estimate noise and prior again; return covariance and information of the chain."""
        equations, motion = self._equations(), self._motion
        parts = [each.eliminated(self._rotors, self._noise, 0.0) for each in equations]
        information = np.sum([each.matrix for each in parts], axis=0)
        whole = information + self._prior.evaluate(motion)[0]
        covariance = covariance_in(self._basis, whole)
        parameters = float(np.sum(covariance * information))
        squares = sum(each.squares for each in equations)
        self._noise = math.sqrt(squares / max(self._freedom() - parameters, 1.0))
        self._prior = self._prior.reestimated(motion, covariance, self._tolerance)
        return covariance, information


def inflated_covariance(covariance: Array, samples: Array, at: UnknownSlices) -> Array:
    """Return the covariance of a chain, (P, P), inflated to the scatter of samples, (S, P).

    Lengths, stiffnesses and masses compensate each other along curved valleys of the cost, so that
    samples scatter more than the first-order covariance states. Only three factors of standard
    deviations are estimated, because there are few samples: for lengths and offsets, for
    stiffnesses, and for masses. Each factor is at least 1.
    """
    variances, factors = np.diag(covariance), np.ones(len(covariance))
    for part in (at.lengths, at.stiffnesses, at.masses):
        ratios = samples[:, part] ** 2 / variances[part]
        factors[part] = max(1.0, float(np.sqrt(np.mean(ratios))))
    return np.asarray(factors[:, None] * covariance * factors)
