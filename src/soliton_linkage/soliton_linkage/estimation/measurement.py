# SPDX-License-Identifier: Apache-2.0
"""Linearised measurement of the arc from one frame, its likelihood, and the innovation gate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.likelihood import DENSITY, frame_likelihood, weigh_frame
from soliton_linkage.estimation.settings import EstimationSettings, LikelihoodSettings
from soliton_linkage.linkage.chain import Array

NO_FLAGS: Flags = np.zeros(0, dtype=np.bool_)
"""Flags of a chain without doubtful rotors."""
LEAST_INFORMATION = 1e-6
"""Information below which a frame does not determine the arc [1]."""
LONGEST_STEP = 0.5
"""Longest Gauss-Newton step of the arc [rad]; the linearisation holds for less than one rotor."""
_MOST_STEPS = 20
"""Largest number of Gauss-Newton steps [1]."""
_LONGEST_RUN = 2
"""Largest number of adjacent rotors that may have gross errors in one frame [1]."""


class LinearisedMeasurement(NamedTuple):
    """Measurement of the arc by a frame, linearised at a point of the orbit."""

    arc: float
    """Most likely arc, to first order in the residuals [rad]."""
    first: int
    """Index of the first rotor near the wall."""
    tangent: Array
    """Derivative of the angles near the wall by the arc, over their scales [1], shape (n,)."""
    residuals: Array
    """Measured angles minus those at `arc` [rad], shape (N,), NaN if unknown."""
    weights: Array
    """Weight of each rotor, 0 to 1, shape (N,)."""
    inlying: Array
    """Residuals of inliers near the wall divided by their scales, else 0 [rad], shape (N,)."""
    information: float
    """Information on the arc for a noise of 1 rad [1]."""
    full_information: float
    """Information if all known rotors except doubtful ones had full weight [1]."""
    squares: float
    """Sum of the squares of the inlying residuals [rad^2]."""
    degrees_of_freedom: int
    """Number of inliers near the wall minus one, at least 1."""
    likelihood: float
    """Log likelihood of the frame [1]."""
    known: int
    """Number of known rotors."""
    random: float
    """Log likelihood of random angles [1]."""
    gross: int
    """Number of outliers with gross differences."""
    run: int
    """Largest number of adjacent rotors with gross differences."""
    outliers: int
    """Number of rotors with less than half a weight."""
    largest: float
    """Largest residual [rad]; infinite if a rotor is unknown."""
    unseen_share: float = 1.0
    """Share of the variance from unseen rotors that the correction for springs leaves [1]."""

    @property
    def mean_square(self) -> float:
        """Mean square of the inlying residuals [rad^2]."""
        return self.squares / self.degrees_of_freedom

    @property
    def outlying(self) -> Flags:
        """Flags of known rotors with less than half a weight, shape (N,)."""
        return np.asarray((self.weights < 0.5) & np.isfinite(self.residuals))


def search_arc(arc: float, target: Callable[[float], float], close: float) -> float:
    """Return the arc [rad] at which Gauss-Newton steps towards a target are shorter than `close`.

    The target function returns the most likely arc of a frame linearised at a given arc.
    """
    for _ in range(_MOST_STEPS):
        step = target(arc) - arc
        arc += min(max(step, -LONGEST_STEP), LONGEST_STEP)
        if abs(step) < close:
            break
    return arc


CORE = 2.5
"""Range of the rotors that show whether a wall still exists [rotor spacings]."""
_FAR, _FAR_NOISE, _FAR_SHARE = 0.75, 2.0, 0.3
"""Smallest excessive difference of a rotor from a wall, relative to a gross error and relative to
the noise [1]; largest share of rotors with such a difference [1]."""


class FrameLikelihood:
    """Likelihood of frames: robust density of the difference between each rotor and the orbit."""

    def __init__(self, swing: float, settings: LikelihoodSettings) -> None:
        """Compute the density for the swing of a rotor during the passage of a wall [rad]."""
        self._settings = settings
        self.gross = settings.gross_share * swing
        """Difference that springs cannot cause [rad]."""
        self._density = np.zeros(1, DENSITY)
        bound, wrong = settings.bound, settings.wrong
        core = math.sqrt(2 * math.pi) * math.erf(bound / math.sqrt(2))
        tails = 2 * bound / (bound**2 - 1) * math.exp(-0.5 * bound**2)
        self._log_wrong = math.log(wrong)
        self._floor = math.log(wrong / (1 - wrong) * (core + tails) / (2 * math.pi))
        self.scales: Array | None = None
        """Scale of each reading, from `ReadingScales` [1], shape (N,); None if all are 1."""

    def floor(self, variance: float) -> float:
        """Return the log density of a reading without information, relative to the peak [1]."""
        return self._floor + 0.5 * math.log(variance)

    def random(self, known: int, variance: float) -> float:
        """Return the log likelihood of `known` random angles [1]."""
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
        """Linearise at an arc [rad], given differences [rad], shape (N,), which are overwritten.

        `variance` is the variance of a rotor, `spread` the variance of the arc [rad^2].
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

        `variance` is the variance of a rotor [rad^2]; NaN has no effect. For random angles the
        ratio exceeds x with a probability of at most exp(-x) (Markov's inequality).
        """
        bound, floor = self._settings.bound, self.floor(variance)
        likelihood = frame_likelihood(residuals, variance, bound, floor)
        return likelihood - self.random(int(np.isfinite(residuals).sum()), variance)

    def explains(self, view: LinearisedMeasurement, largest: float) -> bool:
        """Return whether wrong readings can explain the outliers of a frame.

        At most two adjacent readings may be wrong, and the frame must be likelier than random
        angles, given the largest possible variance of a rotor [rad^2].
        """
        if view.run > _LONGEST_RUN:
            return False
        if view.likelihood < view.random:
            residuals = view.residuals if self.scales is None else view.residuals / self.scales
            return self.over_random(residuals, largest) >= self._log_scales(view.residuals)
        return True

    def fits(self, residuals: Array, first: int, site: float, noise: float) -> bool:
        """Return whether the rotors near a site still form a wall.

        Residuals, from rotor `first` on, and noise are in rad. After a wall has broken up, several
        rotors differ from the nearest wall by more than springs can cause.
        """
        beside = np.abs(np.arange(first, first + len(residuals)) - site)
        core = np.abs(residuals[beside <= CORE])
        far = np.count_nonzero(core > _FAR * self.gross + _FAR_NOISE * noise)
        return bool(far <= _FAR_SHARE * np.count_nonzero(np.isfinite(core)))

    def _log_scales(self, residuals: Array) -> float:
        if self.scales is None:
            return 0.0
        return float(np.log(self.scales[np.isfinite(residuals)]).sum())


class ReadingScales:
    """Standard deviations of the readings of a frame, relative to a typical reading."""

    def __init__(self, usual: float | None = None) -> None:
        """Start with the typical standard deviation [rad], or derive it from the first frame.

        For the first frame it is 1 / sqrt(mean of 1 / sigma^2), which gives the same information.
        """
        self._usual = usual
        self._squares: Array | None = None

    def set_deviations(self, deviations: Array | None) -> None:
        """Set the standard deviations of a frame [rad], shape (N,), NaN or None if typical."""
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
        """Return the scale of each reading [1], shape (N,), None if all are 1.

        Only the noise, a part of the variance of a rotor [rad^2], scales with the reading.
        """
        if self._squares is None:
            return None
        return np.asarray(np.sqrt(1 + (self._squares - 1) * min(noise / variance, 1.0)))


class InnovationGate:
    """Gate that accepts or rejects frames, given the outliers of the preceding frame."""

    def __init__(
        self, rotors: int, likelihood: FrameLikelihood, settings: EstimationSettings
    ) -> None:
        self._likelihood, self._settings = likelihood, settings.likelihood
        self._frames = settings.tracking.confirming_frames
        self._no_outliers = np.zeros(rotors, dtype=np.bool_)
        self.restart()

    def restart(self) -> None:
        """Discard the preceding frame."""
        self._outliers, self._strained = self._no_outliers, 0 * self._no_outliers

    def is_informative(self, view: LinearisedMeasurement) -> bool:
        """Return whether most of the information about the wall remains without outliers."""
        return view.information >= self._settings.informative_share * view.full_information

    def is_strained(self, view: LinearisedMeasurement) -> bool:
        """Return whether the prediction is wrong, for example after an unmodelled impulse.

        Three adjacent rotors are outliers, or one rotor is an outlier in several successive
        frames; no difference is gross, and most of the wall is seen.
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
        """Return whether a frame shows the wall, given the largest variance of a rotor [rad^2].

        Random gross errors occur in single frames; at most one rotor may be grossly wrong in two
        successive frames, unless it is doubtful.
        """
        outliers, repeated = self._no_outliers, 0
        if view.gross:
            outliers = view.outlying & (np.abs(view.residuals) > self._likelihood.gross)
            outliers &= ~doubtful
            repeated = int(np.count_nonzero(outliers & self._outliers))
        self._outliers = outliers
        return repeated <= 1 and self._likelihood.explains(view, largest)
