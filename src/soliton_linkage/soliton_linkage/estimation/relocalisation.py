# SPDX-License-Identifier: Apache-2.0
"""Relocalisation: search of the whole orbit for the positions that are compatible with one frame.

A scan computes the log likelihood L of the frame at samples of the orbit. The scan assumes a
standard deviation of the angles well above the noise, so that it misses no maximum. Gauss-Newton
steps refine each maximum. The weight of a maximum is the integral of exp(L) over the arc length
near the maximum. The weight of all other positions is the integral over the rest of the orbit.
Near a maximum the integral is exp(L) sqrt(2 pi V / I), with the variance V of a residual and the
information I on the arc length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation import likelihood
from soliton_linkage.estimation.frames import rotor_swing
from soliton_linkage.estimation.measurement import (
    LEAST_INFORMATION,
    LONGEST_STEP,
    SAME_SITE,
    FrameLikelihood,
    LinearisedMeasurement,
    OrbitComparison,
    search_arc,
)
from soliton_linkage.estimation.noise import robust_deviation
from soliton_linkage.estimation.settings import (
    DEFAULTS,
    EstimationSettings,
    LikelihoodSettings,
    TrackingSettings,
)
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, check_shape
from soliton_linkage.orbit.orbit import Orbit, OrbitSegment

_CLOSE = 1e-8
"""A search ends when a step along the orbit is shorter than this [rad]."""
SCAN_DEVIATION = 0.1
"""Standard deviation of the angles that a scan assumes, divided by the swing of a rotor [1]. The
step of a scan along the orbit is half of this standard deviation."""
_MOST_PLACES = 12
"""Largest number of maxima that are refined [1]."""
_STEPS_OF_TABLE = 32
"""Number of points of the likelihood table per standard deviation [1]. The interpolation error is
1e-4 of the peak."""
_MOST_SAMPLES = 500
"""Largest number of samples per leg if the orbit is too long to be sampled fully [1]."""


class Candidate(NamedTuple):
    """Local maximum of the likelihood of a frame along the orbit."""

    arc: float
    """Arc length at the maximum [rad], from 0 to the length of the orbit."""
    upside_down: bool
    """Whether the chain is upside down, so that pi - phi is compared with the orbit."""
    view: LinearisedMeasurement
    """Measurement of the frame, linearised at the maximum."""
    variance: float
    """Variance of a residual that was assumed for `view` [rad^2]."""
    evidence: float
    """Logarithm of the integral of the likelihood over the arc length near the maximum [1]."""


class CandidateSet(NamedTuple):
    """Candidates for the position of the chain in a frame, and weight of other positions."""

    candidates: list[Candidate]
    elsewhere: float
    """Logarithm of the integral of the likelihood over the orbit outside all candidates [1]."""

    @property
    def probability(self) -> float:
        """Probability that the chain is at the position of one of the candidates [1]."""
        if not self.candidates:
            return 0.0
        top = max(self.candidates[0].evidence, self.elsewhere)
        found = sum(math.exp(each.evidence - top) for each in self.candidates)
        return found / (found + math.exp(self.elsewhere - top))


def samples_of(orbit: Orbit, arcs: Array) -> likelihood.SampledWalls:
    """Return samples of an orbit at given arc lengths [rad], shape (S,)."""
    about = [orbit.segment(arc) for arc in arcs.tolist()]
    counts = np.array([len(each.angles) for each in about], dtype=np.int64)
    return likelihood.SampledWalls(
        arcs,
        np.array([orbit.site(arc) for arc in arcs.tolist()]),
        np.array([orbit.leg(arc) for arc in arcs.tolist()], dtype=np.int64),
        np.array([each.first for each in about], dtype=np.int64),
        np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts)]),
        np.concatenate([each.angles for each in about]),
    )


class Relocaliser:
    """Search of an orbit and of its mirror image for the position of the chain in one frame."""

    def __init__(
        self, orbit: Orbit, likelihood: LikelihoodSettings, most_angles: int = 2_000_000
    ) -> None:
        """Sample the whole orbit once, unless the samples would have `most_angles` angles or more.

        For such a long orbit, each search samples only sites at which the frame may have a border
        between two uniform states.
        """
        self._orbit, self._given = orbit, likelihood
        chain = orbit.chain
        self._comparison = OrbitComparison(orbit)
        self._corrections = np.zeros(chain.number_of_rotors)
        swing = rotor_swing(chain)
        self._likelihood = FrameLikelihood(swing, likelihood)
        self._elastic = (likelihood.elastic_share * swing) ** 2
        self._coarse = (SCAN_DEVIATION * swing) ** 2
        self._largest = min(likelihood.field_share * swing, likelihood.largest_noise) ** 2
        depth = penetration_depth(chain) / chain.spacing
        self._step = min(SCAN_DEVIATION / 2 * swing, max(depth, 1.0) * orbit.site_arc)
        self._core = math.ceil(2 + 2 * max(chain.wall_width / chain.spacing, depth))
        count = orbit.length / self._step
        self._all = None
        if count * min(chain.number_of_rotors, 30 * depth + 12) < most_angles:
            self._all = samples_of(orbit, np.arange(0.0, orbit.length, self._step))

    def find(
        self, angles: Array, noise: float, upside_down: tuple[bool, ...] = (False, True)
    ) -> CandidateSet:
        """Return the candidates for the position of the chain in a frame.

        Angles [rad] have shape (N,); `noise` is their standard deviation [rad], 0 if unknown.
        `upside_down` lists the orientations of the chain that are searched.
        """
        images = {each: math.pi - angles if each else angles for each in upside_down}
        wide = max(self._coarse, (4.0 * noise) ** 2)
        peaks: list[tuple[float, float, bool]] = []
        scans: list[tuple[bool, likelihood.SampledWalls]] = []
        for turned, image in images.items():
            samples = self._samples(image, wide)
            found = self._scanned(image, samples, wide)
            scans.append((turned, samples))
            tops = (found >= np.roll(found, 1)) & (found >= np.roll(found, -1))
            peaks += [
                (float(found[index]), float(samples.arcs[index]), turned)
                for index in np.flatnonzero(tops).tolist()
            ]
        peaks.sort(reverse=True)
        known = int(np.count_nonzero(np.isfinite(angles)))
        if not known or not peaks:
            return CandidateSet([], math.inf)
        likely = peaks[:_MOST_PLACES]
        variance = self._variance(images[likely[0][2]], likely[0][1], wide, noise)
        candidates: list[Candidate] = []
        same_arc = SAME_SITE * self._orbit.site_arc
        for _, arc, turned in likely:
            candidate = self._refined(images[turned], arc, turned, wide, variance)
            same = any(
                each.upside_down == turned
                and abs(math.remainder(each.arc - candidate.arc, self._orbit.length)) < same_arc
                for each in candidates
            )
            if candidate.view.information > 0 and not same:
                candidates.append(candidate)
        candidates.sort(key=lambda each: -each.evidence)
        return CandidateSet(candidates, self._elsewhere(images, scans, candidates, variance))

    def _variance(self, image: Array, arc: float, wide: float, noise: float) -> float:
        candidate = self._refined(image, arc, False, wide, max(wide / 4, noise**2))
        left = np.abs(candidate.view.residuals[np.isfinite(candidate.view.residuals)])
        seen = robust_deviation(left) ** 2 if len(left) > 3 else noise**2
        if noise:
            return noise**2 + min(max(seen - noise**2, self._elastic), self._largest)
        return min(seen + self._elastic, max(self._largest, self._given.largest_noise**2))

    def _refined(
        self, image: Array, arc: float, turned: bool, wide: float, variance: float
    ) -> Candidate:
        seen_with = max(wide, variance) / 2
        while seen_with > variance:
            ahead = self._view(image, arc, seen_with).arc - arc
            arc += min(max(ahead, -LONGEST_STEP), LONGEST_STEP)
            seen_with /= 2
        arc = search_arc(arc, lambda at: self._view(image, at, variance).arc, _CLOSE)
        view = self._view(image, arc, variance)
        spread = min(variance / max(view.information, 1e-12), self._orbit.site_arc**2)
        evidence = view.likelihood + 0.5 * math.log(2 * math.pi * spread)
        return Candidate(arc % self._orbit.length, turned, view, variance, evidence)

    def _view(self, image: Array, arc: float, variance: float) -> LinearisedMeasurement:
        about, differences = self._comparison.at(arc, image, self._corrections, False)
        return self._likelihood.linearise(arc, about.first, about.tangent, differences, variance)

    def _elsewhere(
        self,
        images: dict[bool, Array],
        scans: list[tuple[bool, likelihood.SampledWalls]],
        candidates: list[Candidate],
        variance: float,
    ) -> float:
        between = (self._step / 4) ** 2
        terms = []
        for turned, samples in scans:
            found = self._scanned(images[turned], samples, variance, between)
            for candidate in candidates:
                if candidate.upside_down == turned:
                    apart = np.abs(samples.sites - self._orbit.site(candidate.arc))
                    found[apart < SAME_SITE] = -math.inf
            terms.append(found)
        joined = np.concatenate(terms)
        top = float(joined.max())
        if top == -math.inf:
            return -math.inf
        return top + math.log(float(np.exp(joined - top).sum()) * self._step)

    def _scanned(
        self, image: Array, samples: likelihood.SampledWalls, variance: float, between: float = 0.0
    ) -> Array:
        sums, found = self._sums(image, variance), np.empty(len(samples.arcs))
        variance += between
        step = math.sqrt(variance) / _STEPS_OF_TABLE
        table = np.empty(2 + math.ceil(math.pi / step))
        floor = self._likelihood.floor(variance)
        likelihood.tabulate(variance, self._given.bound, floor, table)
        likelihood.scan(image, sums[0], sums[1], samples, table, found)
        return found

    def _sums(self, image: Array, variance: float) -> Array:
        bound, floor = self._given.bound, self._likelihood.floor(variance)
        both = self._comparison.before, self._comparison.beyond
        sums = np.empty((2, self._orbit.number_of_legs, len(image) + 1))
        for row, states in zip(sums, both, strict=True):
            likelihood.sum_likelihoods(image, states, variance, bound, floor, row)
        return sums

    def _samples(self, image: Array, variance: float) -> likelihood.SampledWalls:
        if self._all is not None:
            return self._all
        orbit, sums = self._orbit, self._sums(image, variance)
        split = sums[0] + sums[1][:, -1:] - sums[1]
        least = split.max() + self._likelihood.floor(variance) * self._core
        likely = split.max(axis=0) >= least
        sites = np.flatnonzero(likely) - 0.5
        low, high = float(sites.min()) - self._core, float(sites.max()) + self._core
        arcs = []
        for leg in range(orbit.number_of_legs):
            begin, end = orbit.leg_arcs(leg)
            ends = sorted((orbit.arc_at(low, leg), orbit.arc_at(high, leg)))
            swing = orbit.wall_extent if high > len(image) - 1 or low < 0 else 0.0
            first, last = max(begin, ends[0] - swing), min(end, ends[1] + swing)
            count = min(math.ceil((last - first) / self._step), _MOST_SAMPLES)
            arcs.append(np.linspace(first, last, max(count, 2)))
        return samples_of(orbit, np.concatenate(arcs))


class ScanBudget:
    """Limit of the number of searches per second of recorded time, because searches are slow."""

    def __init__(self, settings: TrackingSettings) -> None:
        self._rate, self._burst = settings.scan_rate, float(settings.confirming_frames)
        self.restart()

    def restart(self) -> None:
        """Allow the next `confirming_frames` searches without a pause."""
        self._left, self._last = self._burst, math.nan

    def spend(self, time: float) -> bool:
        """Count a search at the given time [s]; return False if the limit does not allow it."""
        if not math.isnan(self._last):
            gained = (time - self._last) * self._rate
            self._left = min(self._left + gained, self._burst)
        self._last = time
        if self._left < 1:
            return False
        self._left -= 1
        return True


@dataclass(frozen=True)
class NearestPoint:
    """Nearest point of the orbit to a frame.

    arc: arc length from the start of the orbit [rad]; NaN if `fit_anywhere` found no position.
    information: information I on the arc length [1]; 1 if all rotors are seen. If the noise of an
        angle has the standard deviation sigma [rad], the standard deviation of the arc length is
        sigma / sqrt(I) [rad]. For I below 1e-6, the search stops at the current arc length.
    misfit: sqrt(S / (n - 1)) [rad], with the sum S of the squared residuals of the n known rotors
        near the wall; NaN for n < 2.
    """

    arc: float
    information: float
    misfit: float


def fit_near(orbit: Orbit, angles: Array, arc: float) -> NearestPoint:
    """Return the point of the orbit nearest to a frame; the search starts at `arc` [rad].

    Angles phi [rad] have shape (N,), NaN if unknown. The search takes Gauss-Newton steps t . (phi
    - Phi) / (t . t) with the tangent t of the orbit Phi. It may end in another cycle of the orbit
    than the cycle of `arc`. Raises ValueError for infinite values and for another shape.
    """
    if not math.isfinite(arc):
        raise ValueError(
            f'arc = {arc} rad must be a finite number; get a starting arc from fit_anywhere'
        )
    return _fit_near(orbit, _checked(orbit, angles), arc)


def fit_anywhere(
    orbit: Orbit, angles: Array, settings: EstimationSettings = DEFAULTS
) -> NearestPoint:
    """Return the point of one cycle of the orbit that is nearest to a frame.

    Angles [rad] have shape (N,), NaN if unknown. If all angles are unknown, the arc length is NaN.
    Raises ValueError for infinite angles and for another shape.
    """
    frame = _checked(orbit, angles)
    found = _search(orbit, settings).find(frame, 0.0, (False,)).candidates
    if not found:
        return NearestPoint(math.nan, 0.0, math.nan)
    nearest = _fit_near(orbit, frame, found[0].arc)
    return replace(nearest, arc=nearest.arc % orbit.length)


@lru_cache(maxsize=1)
def _search(orbit: Orbit, settings: EstimationSettings) -> Relocaliser:
    return Relocaliser(orbit, settings.likelihood)


def _fit_near(orbit: Orbit, frame: Array, arc: float) -> NearestPoint:
    information = 0.0
    difference = tangent = np.empty(0)

    def nearest(arc: float) -> float:
        nonlocal information, difference, tangent
        difference, tangent = _compared(frame, orbit.segment(arc))
        information = float(tangent @ tangent)
        if information < LEAST_INFORMATION:
            return arc
        return arc + float(tangent @ difference) / information

    arc = search_arc(arc, nearest, _CLOSE)
    squares, known = float(difference @ difference), len(difference)
    return NearestPoint(
        arc, information, math.sqrt(squares / (known - 1)) if known > 1 else math.nan
    )


def _compared(frame: Array, about: OrbitSegment) -> tuple[Array, Array]:
    difference = frame[about.first : about.first + len(about.angles)] - about.angles
    difference -= 2 * math.pi * np.rint(difference * (0.5 / math.pi))
    known = np.isfinite(difference)
    return difference[known], about.tangent[known]


def _checked(orbit: Orbit, angles: Array) -> Array:
    frame = np.asarray(angles, dtype=np.float64)
    check_shape(frame, orbit.chain.number_of_rotors)
    infinite = np.isinf(frame)
    if infinite.any():
        rotor = int(np.argmax(infinite))
        raise ValueError(
            f'angle of rotor {rotor} = {frame[rotor]} must be a finite number; give NaN for an '
            f'unknown angle'
        )
    return frame
