# SPDX-License-Identifier: Apache-2.0
"""Measurement of the arc length along the orbit from one frame, and tests of frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.likelihood import (
    DENSITY,
    compare,
    frame_likelihood,
    weigh_frame,
)
from soliton_linkage.estimation.settings import EstimationSettings, LikelihoodSettings
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment

NO_FLAGS: Flags = np.zeros(0, dtype=np.bool_)
"""Empty array of flags; it means that no rotor is doubtful."""
LEAST_INFORMATION = 1e-6
"""A frame determines the arc length only if `LinearisedMeasurement.information` is at least this
[1]."""
LONGEST_STEP = 0.5
"""Largest Gauss-Newton step along the orbit [rad]; it moves a wall by about half a spacing."""
SAME_SITE = 0.5
"""Two points of the orbit count as the same position of a wall only if their sites differ by less
than this [rotor spacings]."""
MOST_STEPS = 20
"""Largest number of Gauss-Newton steps in a search [1]."""
_LONGEST_RUN = 2
"""A frame is not accepted if more than this number of adjacent rotors have gross errors [1]."""


class LinearisedMeasurement(NamedTuple):
    """Measurement of the arc length along the orbit, linearised about a point of the orbit."""

    arc: float
    """Most likely arc length, to first order in the residuals [rad]."""
    first: int
    """Index of the first rotor near the wall."""
    tangent: Array
    """Derivative of the angles of the n rotors near the wall with respect to the arc length,
    divided by the scales of their readings (see `ReadingScales`) [1], shape (n,)."""
    residuals: Array
    """Measured angles minus the angles on the orbit at `arc` [rad], shape (N,), NaN if unknown."""
    weights: Array
    """Weight of each rotor, from 0 to 1, shape (N,)."""
    inlying: Array
    """Residuals of inliers near the wall, divided by their scales [rad], (N,); 0 elsewhere."""
    information: float
    """Information I on the arc length [1]: if the standard deviation of a residual is sigma [rad],
    the standard deviation of `arc` is sigma / sqrt(I) [rad]."""
    full_information: float
    """Value of `information` if all known rotors that are not doubtful had the weight 1 [1]."""
    squares: float
    """Sum of the squares of the residuals in `inlying` [rad^2]."""
    degrees_of_freedom: int
    """Number of inliers near the wall, minus 1; at least 1."""
    likelihood: float
    """Log likelihood of the frame [1]."""
    known: int
    """Number of rotors with known angles."""
    random: float
    """Log likelihood that the frame would have if all angles were random [1]."""
    gross: int
    """Number of rotors with gross errors (see `FrameLikelihood.gross`)."""
    run: int
    """Largest number of adjacent rotors that all have gross errors."""
    outliers: int
    """Number of known rotors with a weight below 0.5."""
    largest: float
    """Largest absolute residual [rad]; infinite if a rotor is unknown."""
    unseen_share: float = 1.0
    """Fraction of the variance of `arc` due to unseen rotors that remains after the correction for
    unseen rotors [1]; 1 without this correction."""
    rate_shift: float = 0.0
    """Correction of `arc` for the deflections of unseen rotors by inertial forces, divided by the
    squared rate of the arc length [s^2/rad]; 0 without this correction."""

    @property
    def mean_square(self) -> float:
        """Mean square of the residuals in `inlying` [rad^2]."""
        return self.squares / self.degrees_of_freedom

    @property
    def outlying(self) -> Flags:
        """Flags of known rotors with a weight below 0.5, shape (N,)."""
        return np.asarray((self.weights < 0.5) & np.isfinite(self.residuals))


def search_arc(arc: float, target: Callable[[float], float], close: float) -> float:
    """Return the likeliest arc length [rad], found by iteration from `arc` [rad].

    From an arc length, `target` computes a better one. The search ends when an iteration changes
    the arc length by less than `close` [rad].
    """
    for _ in range(MOST_STEPS):
        step = target(arc) - arc
        arc += min(max(step, -LONGEST_STEP), LONGEST_STEP)
        if abs(step) < close:
            break
    return arc


class OrbitComparison:
    """Comparison of frames with an orbit."""

    def __init__(self, orbit: Orbit) -> None:
        self._orbit = orbit
        legs = range(orbit.number_of_legs)
        states = [orbit.background(orbit.arc_at(orbit.middle, leg)) for leg in legs]
        self.before = np.array([before for before, _ in states])
        """Angles of rotors far before the wall [rad], shape (legs, N)."""
        self.beyond = np.array([beyond for _, beyond in states])
        """Angles of rotors far beyond the wall [rad], shape (legs, N)."""

    def at(
        self, arc: float, angles: Array, corrections: Array, upside_down: bool
    ) -> tuple[OrbitSegment, Array]:
        """Return the rotors near a wall on the orbit, and the result of `compare` [rad], (N,).

        The wall is at the arc length `arc` [rad]. The other arguments are those of `compare`.
        """
        about, leg = self._orbit.segment(arc), self._orbit.leg(arc)
        differences = np.empty_like(angles)
        compare(
            angles,
            corrections,
            upside_down,
            self.before[leg],
            about.angles,
            self.beyond[leg],
            about.first,
            differences,
        )
        return about, differences


_CORE = 2.5
"""`FrameLikelihood.fits` uses only rotors up to this distance from a wall [rotor spacings]."""
_FAR, _FAR_NOISE, _FAR_SHARE = 0.75, 2.0, 0.3
"""A residual contradicts a wall if its absolute value exceeds `_FAR` times the smallest gross
error plus `_FAR_NOISE` times the standard deviation of the noise [1]. A frame contradicts a wall
if more than the fraction `_FAR_SHARE` of the residuals within `_CORE` contradict it [1]."""


class FrameLikelihood:
    """Likelihood of frames, from a probability density of residuals that allows outliers."""

    def __init__(self, swing: float, settings: LikelihoodSettings) -> None:
        """Compute the density; `swing` is the result of `rotor_swing` [rad]."""
        self._settings = settings
        self.gross = settings.gross_share * swing
        """An absolute residual above this is a gross error [rad]."""
        self._density = np.zeros(1, DENSITY)
        bound, wrong = settings.bound, settings.wrong
        core = math.sqrt(2 * math.pi) * math.erf(bound / math.sqrt(2))
        tails = 2 * bound / (bound**2 - 1) * math.exp(-0.5 * bound**2)
        self._log_wrong = math.log(wrong)
        self._floor = math.log(wrong / (1 - wrong) * (core + tails) / (2 * math.pi))
        self.scales: Array | None = None
        """Scale of each reading [1], shape (N,), see `ReadingScales`; None if all scales are 1."""

    def floor(self, variance: float) -> float:
        """Return `floor` of `DENSITY` [1], given the variance of a difference [rad^2]."""
        return self._floor + 0.5 * math.log(variance)

    def random(self, known: int, variance: float) -> float:
        """Return the log likelihood of a frame with `known` random angles [1]."""
        return known * (self.floor(variance) - self._log_wrong)

    def linearise(
        self,
        arc: float,
        first: int,
        tangent: Array,
        differences: Array,
        variance: float,
        spread: float = 0.0,
        doubtful: Flags = NO_FLAGS,
    ) -> LinearisedMeasurement:
        """Return the measurement of a frame, linearised at an arc length along the orbit [rad].

        `differences` between the angles and the orbit [rad], shape (N,), are overwritten by the
        residuals at the likeliest arc length. `tangent` is the derivative of the angles of the
        rotors near the wall, from rotor `first` on. `variance` is the variance of a difference,
        and `spread` the variance of the predicted arc length [rad^2] (see `DENSITY`).
        """
        rows, floor = np.empty((2, len(differences))), self.floor(variance)
        self._density[0] = variance, spread, self._settings.bound, floor, self.gross
        if self.scales is not None:
            tangent = tangent / self.scales[first : first + len(tangent)]
            differences /= self.scales
        (information, ahead, full), counts, sums = weigh_frame(
            differences, first, tangent, self._density, doubtful, rows
        )
        used, known, gross, run, outliers = counts
        squares, likelihood, largest = sums
        random = self.random(known, variance)
        if self.scales is not None:
            differences *= self.scales
            largest = float(np.abs(differences).max()) if math.isfinite(largest) else largest
            random += self._log_scales(differences)
        return LinearisedMeasurement(
            arc + ahead,
            first,
            tangent,
            differences,
            rows[0],
            rows[1],
            information,
            full,
            squares,
            max(used - 1, 1),
            likelihood,
            known,
            random,
            gross,
            run,
            outliers,
            largest,
        )

    def over_random(self, residuals: Array, variance: float) -> float:
        """Return the log likelihood ratio of residuals [rad], shape (n,), against random angles.

        If the angles are random, the result exceeds x with a probability of at most exp(-x)
        (Markov's inequality).
        """
        bound, floor = self._settings.bound, self.floor(variance)
        likelihood = frame_likelihood(residuals, variance, bound, floor)
        return likelihood - self.random(int(np.isfinite(residuals).sum()), variance)

    def explains(self, view: LinearisedMeasurement, largest: float) -> bool:
        """Return whether wrong readings can explain the outliers of a frame.

        The result is False if more than two adjacent rotors have gross errors. It is also False if
        random angles are likelier than the orbit, even with the largest possible variance
        `largest` of a difference from the orbit [rad^2].
        """
        if view.run > _LONGEST_RUN:
            return False
        if view.likelihood < view.random:
            residuals = view.residuals if self.scales is None else view.residuals / self.scales
            return self.over_random(residuals, largest) >= self._log_scales(view.residuals)
        return True

    def fits(self, residuals: Array, first: int, site: float, noise: float) -> bool:
        """Return whether the residuals [rad] of rotors from `first` on allow a wall at `site`."""
        beside = np.abs(np.arange(first, first + len(residuals)) - site)
        core = np.abs(residuals[beside <= _CORE])
        far = np.count_nonzero(core > _FAR * self.gross + _FAR_NOISE * noise)
        return bool(far <= _FAR_SHARE * np.count_nonzero(np.isfinite(core)))

    def _log_scales(self, residuals: Array) -> float:
        if self.scales is None:
            return 0.0
        return float(np.log(self.scales[np.isfinite(residuals)]).sum())


class ReadingScales:
    """Standard deviations of the readings of a frame, relative to a typical standard deviation."""

    def __init__(self, usual: float | None = None) -> None:
        """Start with the typical standard deviation `usual` of a reading [rad].

        If it is None, the first frame with known standard deviations determines it.
        """
        self._usual = usual
        self._squares: Array | None = None

    def set_deviations(self, deviations: Array | None) -> None:
        """Set the standard deviations of readings [rad], (N,); NaN or None for the typical one."""
        self._squares = None
        if deviations is None:
            return
        known = np.isfinite(deviations)
        if not known.any():
            return
        if self._usual is None:
            self._usual = 1 / math.sqrt(float(np.mean(deviations[known] ** -2)))
        self._squares = np.where(known, (deviations / self._usual) ** 2, 1.0)

    def of_frame(self, noise: float, variance: float) -> Array | None:
        """Return the scale of each reading [1], shape (N,); None means that all scales are 1.

        `variance` is the typical variance of the difference between a rotor and the orbit [rad^2].
        It includes `noise`, the typical variance of a reading [rad^2]. Only this part differs from
        reading to reading.
        """
        if self._squares is None:
            return None
        return np.asarray(np.sqrt(1 + (self._squares - 1) * min(noise / variance, 1.0)))


class InnovationGate:
    """Gate that rejects a frame if its outliers contradict the predicted wall."""

    def __init__(
        self, rotors: int, likelihood: FrameLikelihood, settings: EstimationSettings
    ) -> None:
        self._likelihood, self._settings = likelihood, settings.likelihood
        self._frames = settings.tracking.confirming_frames
        self._no_outliers = np.zeros(rotors, dtype=np.bool_)
        self.restart()

    def restart(self) -> None:
        """Discard the outliers of the preceding frames."""
        self._outliers, self._strained = self._no_outliers, 0 * self._no_outliers

    def is_informative(self, view: LinearisedMeasurement) -> bool:
        """Return whether most of the information of a frame remains without its outliers."""
        return view.information >= self._settings.informative_share * view.full_information

    def is_strained(self, view: LinearisedMeasurement) -> bool:
        """Return whether outliers that are smaller than gross errors contradict the prediction.

        The result is False for an informative frame. Otherwise it is True if three adjacent rotors
        are such outliers, or if one rotor is such an outlier in `confirming_frames` successive
        frames.
        """
        if (
            self.is_informative(view)
            or not view.full_information > self._settings.informative_share
        ):
            self._strained = 0 * self._no_outliers
            return False
        off = view.outlying & (np.abs(view.residuals) < self._likelihood.gross)
        self._strained = np.where(off, self._strained + 1, 0)
        adjacent = off[:-2] & off[1:-1] & off[2:]
        return bool(adjacent.any() or (self._strained >= self._frames).any())

    def accepts(self, view: LinearisedMeasurement, largest: float, doubtful: Flags) -> bool:
        """Return whether a frame shows the predicted wall.

        Two conditions must hold. First, `FrameLikelihood.explains` is True, with the variance
        `largest` [rad^2]. Second, at most one rotor has a gross error in both this and the
        preceding frame, because random errors do not repeat; `doubtful` rotors are not counted.
        """
        outliers, repeated = self._no_outliers, 0
        if view.gross:
            outliers = view.outlying & (np.abs(view.residuals) > self._likelihood.gross)
            outliers &= ~doubtful
            repeated = int(np.count_nonzero(outliers & self._outliers))
        self._outliers = outliers
        return repeated <= 1 and self._likelihood.explains(view, largest)
