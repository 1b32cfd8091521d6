# SPDX-License-Identifier: Apache-2.0
"""Estimation of a chain of springs, and of the forces on its rotors, from free motions.

The solution of the equation of motion is fitted to the readings in windows, each with its own
initial state (multiple shooting, after Bock). The first windows are short, because the angles in
them are nearly linear in all unknowns. Windows are merged as the estimate improves. The fit does
not use `scipy.optimize`, which would need 10 GB for 3000 frames of 40 rotors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from soliton_linkage.identification.bundle import covariance_in
from soliton_linkage.identification.encoder_errors import error_scores, error_shapes
from soliton_linkage.identification.free_motion import FreeMotion, states_at
from soliton_linkage.identification.lengths import Tolerances
from soliton_linkage.identification.motion_equations import (
    Eliminated,
    RateChange,
    Record,
    StampErrors,
    eliminated,
    eliminated_changes,
    error_equations,
    estimated_stamps,
    inflated_covariance,
    quasi_newton_step,
    rate_changes,
    solver,
    window_gradient,
    window_matrix,
)
from soliton_linkage.identification.readings import repeat_counts
from soliton_linkage.identification.screening import LEAST_NOISE
from soliton_linkage.identification.stages import Stages
from soliton_linkage.identification.windows import (
    INITIAL_MASS_DEVIATION,
    FreeWindow,
    MotionPrior,
    join_windows,
    merge_windows,
    observable_changes,
)
from soliton_linkage.linkage.chain import Array

_GROWTH_MASS_DEVIATION = 0.03
"""Prior standard deviation of log masses and log stiffnesses while windows are merged [1]; with
three times this value, the stiffnesses of two of ten wobbling flippers were wrong by 8 to 10 %."""
_STEPS = 6
"""Largest number of steps of a fit between two mergers of windows [1]; 2 or 3 are usual."""
_LAST_STEPS = 40
"""Largest number of steps of a fit with the longest windows [1]; 2 to 20 are usual."""
_ROUNDS = 4
"""Largest number of times that the tolerances are estimated and the motion is fitted again [1]."""
_CONVERGED = 0.1
"""The fit of the longest windows ends when the expected decrease of -2 log likelihood in a step is
smaller than this [1]."""
_COARSE = 0.1
"""For shorter windows, the limit is this times the number of unknowns, not `_CONVERGED` [1]."""
_SAMPLED = 1.0
"""For the fit of a sample of the posterior, the limit is this instead of `_CONVERGED` [1]."""
_STIFFNESS_FACTORS = (1, 1 / 5, 5)
"""Initial stiffnesses that are tried, relative to the given stiffness [1]."""
_TOLERANCE_CHANGE = 0.05
"""The tolerances have converged if an estimate changes them by at most this fraction [1]."""
_SAMPLES, _SAMPLED_ROTORS = 4, 80
"""For N rotors, the number of samples of the posterior [1] is the first value or, if smaller, the
second value divided by N, rounded up. With fewer, the standard deviations are less certain."""
_SAMPLED_STEPS = 20
"""Largest number of steps of the fit of a sample [1]; 3 to 10 are usual."""
_FITTING = 0.5
"""Two windows are merged if the motion of the first one fits the readings in the second one: the
root mean square, over these frames, of the norm of the residuals is smaller than this [rad]."""
UNEXPLAINED = 1.5
"""A model matches readings if its residual noise is at most this times the reading noise [1]."""
_SIGNIFICANT = 3.0
"""Differences of squared noise are significant if larger than this [standard deviations]."""
NOISE_SCATTER = 2.3
"""The squared noise of n readings has the relative standard deviation this / sqrt(n) [1]."""
_MATRIX_FRAMES = 1000
"""Approximate number of frames used for matrices of normal equations; gradients use all frames."""
_DAMPINGS = 12
"""Largest number of damping factors that are tried for one step [1]; the last is about 100."""
_FASTEST = 100.0
"""A motion is rejected if `FreeMotion.fastest` times the frame interval exceeds this [1]."""
_LONGEST_STEP = 1.0
"""Largest change of a log length, stiffness or mass in a step [1]; longer steps are shortened."""
_FAR = 5.0
"""After a step, the matrices are computed again if the decrease of -2 log likelihood that was
expected in this step, divided by the number of unknowns, is larger than this [1]."""
_SLOW = 0.5
"""The matrices are also computed if the expected decrease exceeds this times the last one [1]."""
_SHARES = 0.3, 0.55, 0.7, 0.8, 0.99
"""Fractions of the work that are done after each of five stages [1]: search for the initial
stiffness, merging of windows, estimation of the tolerances, search for kicks, and samples."""
_INITIAL_DAMPING = 0.1
"""Damping factor of the first step if the expected decrease is large (see `_FAR`) [1]. Without
damping, some fits of wobbling flippers end in a local minimum, whose residuals look as if a kick
had acted; with a damping factor of 0.01, they do not."""
_DAMPED = 1e-3
"""If the damping factor is not smaller than this [1], a small expected decrease does not count as
convergence, because the damping may have caused it."""


@dataclass(frozen=True)
class MotionFit:
    """Free motion that fits the readings, with the covariance of the unknowns of the chain.

    A `FreeMotion` of N rotors has Q unknowns: its 2 N initial angles and rates, and the Q - 2 N
    unknowns of the chain, which are the same in all windows.
    """

    windows: tuple[FreeWindow, ...]
    covariance: Array
    """Covariance of the unknowns of the chain, (Q - 2 N, Q - 2 N)."""
    information: Array
    """Information of the readings, not of the prior, about these unknowns, (Q - 2 N, Q - 2 N)."""
    basis: Array
    noise: float
    residuals: Array
    """Residuals divided by relative deviations [rad], (T, N); 0 for missing readings."""
    prior: MotionPrior
    stamp_deviation: float
    """Standard deviation of the errors of time stamps [s], 0 if negligible."""

    @property
    def motion(self) -> FreeMotion:
        """Motion of the first window."""
        return self.windows[0].motion


class MotionFitter:
    """Quasi-Newton fit of a chain, and of the initial states of all windows, to readings."""

    def __init__(
        self,
        windows: Sequence[FreeWindow],
        times: Array,
        readings: Array,
        relative_deviations: Array,
        noise: float,
        tolerance: float | None,
        gravity_known: bool = True,
        stages: Stages | None = None,
    ) -> None:
        """Start with windows whose motions approximate the readings [rad], (T, N), NaN if missing.

        The standard deviation of a reading is its relative deviation [1], (T, N), times `noise`
        [rad]. `tolerance` is the prior standard deviation of the log of a length [1]; if it is
        None, it is estimated. Gravity is estimated unless `gravity_known`.
        """
        self._stamps, self._repeats = times, repeat_counts(readings)
        deviations = relative_deviations * np.sqrt(self._repeats)
        exact = StampErrors(0.0, np.zeros_like(times))
        self._record = Record(times, readings, deviations, exact)
        fitted = sum(window.frames.stop - window.frames.start for window in windows)
        self._every = max(1, fitted // _MATRIX_FRAMES)
        self._found, self._interval = list[Array](), float(np.median(np.diff(times)))
        self._noise, self._tolerance = noise, tolerance
        self._windows, self._stages = tuple(windows), stages or Stages()
        motion = self._motion
        tolerances = Tolerances(tolerance or Tolerances.lengths)
        self._prior = MotionPrior(motion.gravity, tolerances, _GROWTH_MASS_DEVIATION)
        self._rotors = len(motion.masses)
        self._basis = observable_changes(motion, gravity_known)

    def fit(self, bar_noise: float, begun_well: bool = False) -> MotionFit | None:
        """Fit springs to the readings; return None if bars, with noise `bar_noise` [rad], fit too.

        If `begun_well`, the chain of the given windows fits the readings, and its stiffness is not
        searched for.
        """
        show, (begun, merged, estimated, *_) = self._stages, _SHARES
        show.enter(0.0, begun)
        if not (begun_well or self._begin(bar_noise)):
            return None
        levels = math.log(len(self._windows)) or 1.0
        while (windows := merge_windows(self._windows, self._fits)) != self._windows:
            left = (math.log(len(each)) / levels for each in (self._windows, windows))
            show.enter(*(merged - (merged - begun) * part for part in left))
            self._windows = windows
            self._improve(_STEPS, _COARSE * self._unknowns)
            if self._record.stamps.variance:
                self._correct_stamps()
        self._prior = replace(self._prior, mass_deviation=INITIAL_MASS_DEVIATION)
        most = UNEXPLAINED * self._noise
        for number in range(_ROUNDS):
            show.enter(*(estimated - (estimated - merged) / 2 ** (number + k) for k in (0, 1)))
            self._correct_stamps()
            self._improve(_LAST_STEPS, _CONVERGED, self._found)
            before = self._prior.tolerances
            self._found = self._equations()
            covariance, information = self._reestimate(self._found)
            converged = self._prior.tolerances.is_close(before, _TOLERANCE_CHANGE)
            if self._noise > most or converged:
                break
        if self._squared_noise() * (1 + _SIGNIFICANT * self._scatter()) > bar_noise**2:
            return None
        residuals = np.zeros_like(self._record.readings)
        for window in self._windows:
            repeated = np.sqrt(self._repeats[window.frames])
            residuals[window.frames] = self._record.weighted(window)[2] * repeated
        return MotionFit(
            tuple(window._replace(motion=window.motion.normalised()) for window in self._windows),
            covariance,
            information,
            self._basis,
            self._noise,
            residuals,
            self._prior,
            math.sqrt(self._record.stamps.variance) * self._noise,
        )

    def rate_changes(self) -> list[RateChange]:
        """Return the normal equations of sudden changes of the rates at regular times.

        All other unknowns are eliminated. Masses that differ before and after a time imitate a
        change. Therefore the prior deviation of the masses is at most `INITIAL_MASS_DEVIATION`,
        even if the fitted masses differ more.
        """
        found, prior = self._windows, self._prior
        limited = min(prior.mass_deviation, INITIAL_MASS_DEVIATION)
        self._prior = replace(prior, mass_deviation=limited)
        ends, parts = np.linspace(*_SHARES[2:4], len(found) + 1).tolist(), []
        for window, stage in zip(found, pairwise(ends), strict=True):
            self._stages.enter(*stage)
            parts.append(rate_changes(window, self._record, self._every, self._interval))
        matrices, vectors, changes = zip(*parts, strict=True)
        solve = self._solver(matrices, 0.0)
        tested = eliminated_changes(changes, self._joined(vectors), solve, self._noise)
        self._prior = prior
        return tested

    def decreases_at_boundaries(self) -> list[tuple[float, float]]:
        """Return times [s] where adjacent windows meet, and a decrease of -2 log likelihood [1].

        In the fit to which the decrease is relative, the motion of the first window continues.
        """
        found, decreases = self._windows, []
        before = self._cost(found)[0]
        for frame in [window.frames.start for window in found[1:]]:
            self._windows = join_windows(found, frame, frame)
            if len(self._windows) < len(found):
                self._improve(_STEPS, _SAMPLED)
                decrease = self._cost(self._windows)[0] - before
                decreases.append((float(self._record.times[frame]), decrease))
            self._windows = found
        return decreases

    def error_scores(self) -> tuple[Array, Array]:
        """Return the result of `encoder_errors.error_scores` for this fit."""
        prior, given = self._prior.evaluate(self._motion), (self._windows, self._record)
        equations = error_equations(*given, self._noise, self._every, error_shapes)
        return error_scores(*equations, *prior, self._basis)

    def sampled(self, found: MotionFit) -> MotionFit:
        """Return the fit `found` with its covariance increased to the scatter of samples."""
        given = found.covariance, self._samples(), found.motion.slices
        return replace(found, covariance=inflated_covariance(*given))

    def _samples(self) -> Array:
        """Return samples of the posterior, as differences from the fit, (S, Q - 2 N).

        The method is randomized maximum likelihood (Oliver, He and Reynolds, 1996): random errors
        are added to the readings and to the prior mean, and the chain is fitted again.
        """
        found, record, prior = self._windows, self._record, self._prior
        random, values = np.random.default_rng(0), prior.evaluate(self._motion)[1]
        samples = []
        ends = np.linspace(*_SHARES[3:], 1 + min(_SAMPLES, -(-_SAMPLED_ROTORS // self._rotors)))
        for stage in pairwise(ends.tolist()):
            self._stages.enter(*stage)
            noise = self._noise * record.deviations * random.standard_normal(record.readings.shape)
            self._record = record._replace(readings=record.readings + noise)
            self._prior = prior.sampled(found[0].motion, random)
            self._improve(_SAMPLED_STEPS, _SAMPLED, self._found)
            samples.append(prior.evaluate(self._motion)[1] - values)
            self._windows, self._record, self._prior = found, record, prior
        return np.array(samples)

    def _begin(self, bar_noise: float) -> bool:
        given, found = self._windows, []
        stiffest = self._interval**-2
        for factor in _STIFFNESS_FACTORS:
            stiffnesses = factor * given[0].motion.stiffnesses
            self._windows = tuple(
                window._replace(motion=replace(window.motion, stiffnesses=stiffnesses))
                for window in given
            )
            if factor > 1 and self._motion.stiffnesses.max() > stiffest:
                continue
            self._improve(_STEPS, _COARSE * self._unknowns)
            if self._correct_stamps():
                self._improve(_STEPS, _COARSE * self._unknowns)
            before = self._squared_noise()
            self._windows = merge_windows(self._windows, self._fits)
            self._improve(_STEPS, _COARSE * self._unknowns)
            if min(before, self._squared_noise()) < bar_noise**2:
                found.append((self._cost(self._windows)[0], self._windows))
                count = sum(float(self._counts(window).sum()) for window in self._windows)
                spread = self._scatter() + NOISE_SCATTER / math.sqrt(count)
                if self._squared_noise() < self._noise**2 * (1 + _SIGNIFICANT * spread):
                    break
        if found:
            self._windows = min(found, key=lambda each: each[0])[1]
        return bool(found)

    def _squared_noise(self) -> float:
        """Return the squared noise [rad^2], from the residuals orthogonal to the rates."""
        # The result is compared with a fit of rigid bars, which has no residuals along the rates.
        across = [self._record.across_rates(window) for window in self._windows]
        freedom = self._freedom() - self._motion.slices.forces.stop - sum(map(len, across))
        return float(sum(np.sum(each**2) for each in across) / max(freedom, 1.0))

    def _freedom(self) -> float:
        counts = (self._counts(window).sum(axis=0) for window in self._windows)
        return sum(float(np.maximum(each - 2, 0).sum()) for each in counts)

    def _counts(self, window: FreeWindow) -> Array:
        seen = np.isfinite(self._record.readings[window.frames])
        return np.asarray(seen / self._repeats[window.frames])

    def _scatter(self) -> float:
        """Return the relative standard deviation of the squared noise due to the unknowns [1]."""
        # A fit of K unknowns decreases the sum of squared residuals. This decrease, divided by the
        # variance of a reading, has the mean K and the variance 2 K.
        return math.sqrt(2 * self._unknowns) / max(self._freedom(), 1.0)

    @property
    def _unknowns(self) -> int:
        return len(self._basis) + 2 * self._rotors * len(self._windows)

    @property
    def _motion(self) -> FreeMotion:
        return self._windows[0].motion

    def _correct_stamps(self) -> bool:
        found = estimated_stamps(self._record, self._windows, self._stamps, self._noise)
        if found is not None:
            self._record = found
        return found is not None

    def _fits(self, window: FreeWindow, frames: slice) -> bool:
        errors = self._record.weighted(window)[2][frames.start - window.frames.start :]
        errors = errors * self._record.deviations[frames]
        return bool(np.sum(errors**2) < _FITTING**2 * len(errors))

    def _cost(self, windows: Sequence[FreeWindow]) -> tuple[float, list[Array]]:
        """Return -2 log likelihood, and for each window the states in its B frames, (B, 2, N)."""
        if not windows[0].motion.fastest * self._interval < _FASTEST:
            return math.inf, []
        information, values = self._prior.evaluate(windows[0].motion)
        cost, record = float(values @ information @ values), self._record
        states = [states_at(each.motion, record.times[each.frames]) for each in windows]
        for window, own in zip(windows, states, strict=True):
            _, pulls, errors = record.weighted(window, None, own)
            whitened = record.whitened(window.frames, pulls, errors)
            cost += float(np.sum(whitened**2)) / self._noise**2
        return (cost if math.isfinite(cost) else math.inf), states

    def _equations(self) -> list[Array]:
        return [window_matrix(each, self._record, self._every) for each in self._windows]

    def _improve(self, steps: int, converged: float, equations: list[Array] | None = None) -> None:
        equations = equations or self._equations()
        before, states = self._cost(self._windows)
        if not states:
            return
        right, at = self._right(states), self._motion.slices
        pairs: list[tuple[Array, Array]] = []
        damping, first, last, rejected = 0.0, 0.0, math.inf, 0
        solve, fresh = self._solver(equations, damping), True
        if right @ solve(right) > _FAR * self._unknowns:
            damping = _INITIAL_DAMPING
            solve = self._solver(equations, damping)
        while rejected < _DAMPINGS:
            step = quasi_newton_step(right, solve, pairs)
            expected = float(step @ right)
            first = max(first, expected)
            self._stages.show_decrease(first, expected, converged)
            step *= min(1.0, _LONGEST_STEP / float(np.abs(step[: at.masses.stop]).max()))
            changed = self._changed(step)
            with np.errstate(all='ignore'):
                after, reached = self._cost(changed)
            accepted = after < before
            if accepted:
                self._windows, before, states = changed, after, reached
                steps, rejected = steps - 1, 0
                if not steps or (expected < converged and damping < _DAMPED):
                    return
                damping /= 8
            elif fresh:
                damping, rejected = max(4 * damping, 1e-4), rejected + 1
                solve = self._solver(equations, damping)
                continue
            slow = bool(pairs) and expected > _SLOW * last
            far = expected > _FAR * self._unknowns
            fresh = far or slow or not accepted
            last = expected
            previous, right = right, self._right(states)
            if fresh:
                equations, pairs = self._equations(), []
            elif step @ (previous - right) > 0:
                pairs.append((step, previous - right))
            if fresh or damping:
                solve = self._solver(equations, damping)

    def _right(self, states: Sequence[Array]) -> Array:
        pairs = zip(self._windows, states, strict=True)
        return self._joined([window_gradient(each, self._record, own) for each, own in pairs])

    def _joined(self, gradients: Sequence[Array]) -> Array:
        information, values = self._prior.evaluate(self._motion)
        vectors, size = np.array(gradients) / self._noise**2, len(values)
        chain = vectors[:, :size].sum(axis=0) - information @ values
        return np.concatenate([chain, vectors[:, size:].ravel()])

    def _solver(self, equations: Sequence[Array], damping: float) -> Callable[[Array], Array]:
        information, _ = self._prior.evaluate(self._motion)
        return solver(self._eliminated(equations, damping), information, self._basis, damping)

    def _eliminated(self, equations: Sequence[Array], damping: float) -> list[Eliminated]:
        size = len(self._basis)
        return [eliminated(each, size, self._noise, damping) for each in equations]

    def _changed(self, step: Array) -> tuple[FreeWindow, ...]:
        chain, states = np.split(step, [len(self._basis)])
        changes = states.reshape(len(self._windows), -1)
        return tuple(
            window._replace(motion=window.motion.changed(np.concatenate([chain, own])))
            for window, own in zip(self._windows, changes, strict=True)
        )

    def _reestimate(self, equations: Sequence[Array]) -> tuple[Array, Array]:
        motion = self._motion
        parts = self._eliminated(equations, 0.0)
        information = np.sum([each.matrix for each in parts], axis=0)
        prior, values = self._prior.evaluate(motion)
        covariance = covariance_in(self._basis, information + prior)
        freedom = self._freedom() - float(np.sum(covariance * information))
        squares = (self._cost(self._windows)[0] - values @ prior @ values) * self._noise**2
        self._noise = max(math.sqrt(squares / max(freedom, 1.0)), LEAST_NOISE)
        self._prior = self._prior.reestimated(motion, covariance, self._tolerance)
        return covariance, information
