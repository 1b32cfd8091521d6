# SPDX-License-Identifier: Apache-2.0
"""What a frame looks like from a point of the orbit: how likely it is there, and where to go.

The term of the likelihood that this file computes is that of the noise, a sum over rotors of the
logarithm of p(d); `likelihood_loops` has its density.
"""

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
"""Of a chain of which no rotor is doubtful."""


LEAST_INFORMATION = 1e-6
"""Information below which a frame does not determine the arc [1]."""
LONGEST_STEP = 0.5
"""Longest Gauss-Newton step of the arc [rad]; the linearisation holds over less than a rotor."""
_MOST_STEPS = 20
"""Largest number of Gauss-Newton steps [1]."""


class LinearisedMeasurement(NamedTuple):
    """A frame from a point of the orbit, in the orientation of the orbit."""

    arc: float
    """Arc of the likeliest point of the orbit, to first order in the residuals [rad]."""
    first: int
    """Number of the first rotor about the wall."""
    tangent: Array
    """Change of the angles of the rotors about the wall with the arc, over scales [1], (n,)."""
    residuals: Array
    """Angles less those of that point [rad], shape (N,), NaN where unknown."""
    weights: Array
    """How much each rotor is believed, 0 to 1, shape (N,)."""
    left: Array
    """Residuals of rotors about the wall that are believed, over scales, else 0 [rad], (N,)."""
    information: float
    """Information on the arc in units of that of a noise of 1 rad [1]."""
    information_of_all: float
    """The same if all rotors that are known and not doubtful were believed [1]."""
    squares: float
    """Sum of squares of what is left [rad^2]."""
    degrees_of_freedom: int
    """Number of rotors of which it is left, but one."""
    likelihood: float
    """Logarithm of the likelihood of the frame [1]."""
    known: int
    """Number of rotors that are known."""
    nothing: float
    """The same logarithm if every angle were anything [1]."""
    off: int
    """Number of rotors that are not believed and further off than springs could be."""
    run: int
    """How many of these are side by side at most."""
    unbelieved: int
    """Number of rotors that are not believed."""
    largest: float
    """Largest residual of all rotors [rad], infinite where one is not known."""
    untold: float = 1.0
    """Share of the variance by rotors that are not known that springs leave [1]."""

    @property
    def mean_square(self) -> float:
        """Mean square of what the arc leaves of the rotors about the wall [rad^2]."""
        return self.squares / self.degrees_of_freedom

    @property
    def outlying(self) -> Flags:
        """Rotors that are known but not believed, shape (N,)."""
        return np.asarray((self.weights < 0.5) & np.isfinite(self.residuals))


def search_arc(arc: float, target: Callable[[float], float], close: float) -> float:
    """Return the arc [rad] at which Gauss-Newton steps to their target end, or a step is close.

    The target is the likeliest arc by a frame that is linearised at an arc.
    """
    for _ in range(_MOST_STEPS):
        step = target(arc) - arc
        arc += min(max(step, -LONGEST_STEP), LONGEST_STEP)
        if abs(step) < close:
            break
    return arc


class FrameLikelihood:
    """The density of a difference, of a deviation that changes with the frames."""

    def __init__(self, swing: float, settings: LikelihoodSettings) -> None:
        """Begin with the swing that a rotor makes as a wall passes [rad]."""
        self._settings = settings
        self.gross = settings.gross_share * swing
        """Difference that no springs make [rad]."""
        self._density = np.zeros(1, DENSITY)
        self._limits = self.gross, settings.least_share
        bound, wrong = settings.bound, settings.wrong
        core = math.sqrt(2 * math.pi) * math.erf(bound / math.sqrt(2))
        tails = 2 * bound / (bound**2 - 1) * math.exp(-0.5 * bound**2)
        self._log_wrong = math.log(wrong)
        self._floor = math.log(wrong / (1 - wrong) * (core + tails) / (2 * math.pi))
        self.scales: Array | None = None
        """Deviations of the readings of the frame that is seen, in usual ones [1], shape (N,);
        None where all are 1."""

    def floor(self, variance: float) -> float:
        """Logarithm of the density of what tells nothing, over that of the core's top [1].

        Of e / 2 pi over (1 - e) C / sqrt(V), where C is one over the integral of exp(-rho).
        """
        return self._floor + 0.5 * math.log(variance)

    def nothing(self, known: int, variance: float) -> float:
        """Logarithm of the likelihood of so many angles at random, as floors are [1]."""
        return known * (self.floor(variance) - self._log_wrong)

    def view(
        self,
        arc: float,
        first: int,
        tangent: Array,
        differences: Array,
        variance: float,
        spread: float = 0.0,
        doubtful: Flags = NO_FLAGS,
    ) -> LinearisedMeasurement:
        """View of differences from the orbit at an arc [rad], shape (N,), which it takes over.

        The variance [rad^2] is that of a rotor, the spread [rad^2] that of the arc.
        """
        rows = np.empty((2, len(differences)))
        self._density[0] = (
            variance,
            spread,
            self._settings.bound,
            self.floor(variance),
            self.gross,
            self._settings.least_share,
        )
        if self.scales is not None:
            tangent = tangent / self.scales[first : first + len(tangent)]
            differences /= self.scales
        (information, ahead, whole), counts, sums = weigh_frame(
            differences, first, tangent, self._density, doubtful, rows
        )
        used, known, off, run, unbelieved = counts
        squares, likelihood, largest = sums
        nothing = self.nothing(known, variance)
        if self.scales is not None:
            differences *= self.scales
            largest = float(np.abs(differences).max()) if math.isfinite(largest) else largest
            nothing += self._log_scales(differences)
        return LinearisedMeasurement(
            arc + ahead,
            first,
            tangent,
            differences,
            rows[0],
            rows[1],
            information,
            whole,
            squares,
            max(used - 1, 1),
            likelihood,
            known,
            nothing,
            off,
            run,
            unbelieved,
            largest,
        )

    def over_nothing(self, residuals: Array, variance: float) -> float:
        """Logarithm of the likelihood of residuals [rad], shape (n,), over that of any angles.

        With a variance of a rotor [rad^2]; NaN tells nothing. Of angles at random it is above x
        with a probability of no more than exp(-x) (Markov's inequality).
        """
        likelihood = frame_likelihood(
            residuals, variance, self._settings.bound, self.floor(variance)
        )
        return likelihood - self.nothing(int(np.isfinite(residuals).sum()), variance)

    def explains(self, view: LinearisedMeasurement, largest: float) -> bool:
        """Whether what it does not believe of a frame may be readings that are wrong.

        The frame must be likelier than random angles, with the largest variance of a rotor that
        is possible [rad^2].
        """
        if view.run > self._settings.longest_run:
            return False
        if view.likelihood < view.nothing:
            residuals = view.residuals if self.scales is None else view.residuals / self.scales
            if self.over_nothing(residuals, largest) < self._log_scales(view.residuals):
                return False
        return True

    def _log_scales(self, residuals: Array) -> float:
        """Logarithm of the product of the scales of what is known: densities are over these."""
        if self.scales is None:
            return 0.0
        return float(np.log(self.scales[np.isfinite(residuals)]).sum())


class ReadingScales:
    """Deviations of the readings of a frame from the orbit, in units of a usual one."""

    def __init__(self, usual: float | None = None) -> None:
        """Take this for the usual deviation [rad], or that of the first frame that tells any.

        Of a frame it is that with which all of its readings would tell as much, by the mean of
        1 / sigma^2.
        """
        self._usual = usual
        self._squares: Array | None = None

    def take(self, deviations: Array | None) -> None:
        """Take the deviations of a frame [rad], shape (N,), NaN of usual readings, None of all."""
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
        """Scale of each reading [1], shape (N,), None where all are 1.

        The variance of a usual one from the orbit [rad^2] is that of its noise and of what is
        beside the orbit, which does not change with the reading.
        """
        if self._squares is None:
            return None
        return np.asarray(np.sqrt(1 + (self._squares - 1) * min(noise / variance, 1.0)))


class InnovationGate:
    """Tells frames of a wall from others, by how rotors were off before."""

    def __init__(
        self, rotors: int, likelihood: FrameLikelihood, settings: EstimationSettings
    ) -> None:
        """Begin with none off."""
        self._likelihood = likelihood
        self._settings, self._frames = settings.likelihood, settings.tracking.confirming_frames
        self._none_off = np.zeros(rotors, dtype=np.bool_)
        self._never = np.zeros(rotors, dtype=np.int64)
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self._off, self._strained = self._none_off, self._never

    def is_believed(self, view: LinearisedMeasurement) -> bool:
        """Whether most of what the rotors about the wall tell is believed."""
        return view.information >= self._settings.believed * view.information_of_all

    def is_strained(self, view: LinearisedMeasurement) -> bool:
        """Whether a wall is off as by a push: several rotors side by side, or one for a while.

        They are no further off than springs could have them, and most of the wall is seen.
        """
        if self.is_believed(view) or not view.information_of_all > self._settings.believed:
            self._strained = self._never
            return False
        off = view.outlying & (np.abs(view.residuals) < self._likelihood.gross)
        self._strained = np.where(off, self._strained + 1, 0)
        run = off[:-2] & off[1:-1] & off[2:]
        return bool(run.any() or (self._strained >= self._frames).any())

    def is_explained(self, view: LinearisedMeasurement, largest: float, doubtful: Flags) -> bool:
        """Whether a frame is that of a wall, with the largest variance of a rotor [rad^2].

        Readings that are wrong at random are so in one frame; rotors that are far off in two
        running are elsewhere, unless they are doubtful.
        """
        off, staying = self._none_off, 0
        if view.off:
            off = view.outlying & (np.abs(view.residuals) > self._likelihood.gross) & ~doubtful
            staying = int(np.count_nonzero(off & self._off))
        self._off = off
        return staying <= 1 and self._likelihood.explains(view, largest)
