# SPDX-License-Identifier: Apache-2.0
"""Hypotheses about the position of a chain on its orbit, weighted by their likelihoods."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.measurement import SAME_SITE, LinearisedMeasurement
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.orbit.orbit import Orbit

_LEAD = 3.0
"""A hypothesis replaces the leader if its log likelihood exceeds that of the leader by more than
this [1]."""
_STEP = 1e-3
"""Step for the numerical derivative of 1 / `Orbit.site_arc_at` [rotor spacings]."""


@dataclass
class Hypothesis:
    """Hypothesis about the position and the motion of a chain on its orbit."""

    motion: MultipleModelFilter
    upside_down: bool
    view: LinearisedMeasurement
    evidence: float
    """Log likelihood of all frames, relative to the likeliest hypothesis [1]."""
    rate_shift: float = 0.0
    """Mean of `LinearisedMeasurement.rate_shift` over the recent frames [s^2/rad]."""
    information: float = 0.0
    """Sum of the inverse variances of the arc lengths from the recent frames [1/rad^2]."""

    def update_rate_shift(self, way: float, variance: float) -> None:
        """Shift the arc length after a frame has changed the estimated rate.

        Inertial forces, which are proportional to the square of the rate, deform a moving wall. A
        frame shows the deflections of seen rotors only. `OrbitMeasurementModel` computes the
        deflections of unseen rotors from the estimated rate, and corrects the arc length from each
        frame for them. If the estimated rate changes, so does the correction. Without this shift,
        the filter would interpret that change as motion of the wall.

        `variance` is the variance of the arc length from the latest frame [rad^2], and `way` the
        distance that the wall has moved since the frame before [rotor spacings].
        """
        self.information = math.exp(-way) * self.information + 1 / variance
        gain = 1 / (self.information * variance)
        self.rate_shift += gain * (self.view.rate_shift - self.rate_shift)
        if self.rate_shift:
            change = self.motion.rate**2 - self.motion.expected_rate**2
            self.motion.shift_arc(self.rate_shift * change)


class MixtureMoments(NamedTuple):
    """Site and rate of a wall, averaged over all hypotheses."""

    site: float
    """Mean site [rotor spacings]."""
    site_deviation: float
    """Standard deviation of the site [rotor spacings]."""
    site_rate: float
    """Mean rate of change of the site [rotor spacings / s]."""
    site_rate_deviation: float
    """Standard deviation of the rate of the site [rotor spacings / s]."""


class Hypotheses:
    """Competing hypotheses about the position of a chain; the first one is the leader."""

    def __init__(self, orbit: Orbit, settings: EstimationSettings) -> None:
        self._orbit, self._settings = orbit, settings
        self.all: list[Hypothesis] = []

    @property
    def leader(self) -> Hypothesis:
        """Hypothesis whose arc length, rate and leg of the orbit are reported."""
        return self.all[0]

    def drop_unknown(self, limit: float) -> None:
        """Drop hypotheses whose expected arc length has a variance above `limit` [rad^2].

        Such a hypothesis fits any frame, and its rate may grow without limit. The leader is kept.
        """
        self.all = [
            each
            for each in self.all
            if each is self.leader or each.motion.expected_variance <= limit
        ]

    def weigh(self, likelihoods: list[float]) -> None:
        """Add the log likelihoods of a frame; drop unlikely and duplicate hypotheses."""
        if len(self.all) == 1:
            return
        for each, likelihood in zip(self.all, likelihoods, strict=True):
            each.evidence += likelihood
        ranked = sorted(self.all, key=lambda each: -each.evidence)
        leader, top = self.leader, ranked[0].evidence
        if top > leader.evidence + _LEAD:
            leader = ranked[0]
        kept = [leader]
        for each in ranked:
            refuted = each.evidence < top - self._settings.filter.decisive_odds
            if not (refuted or any(self._same(each, other) for other in kept)):
                kept.append(each)
        for each in kept:
            each.evidence -= top
        self.all = kept

    def add_toggled(self) -> None:
        """Add a hypothesis for each edge rotor that may have swung to its other rest angle.

        Only flippers have such edge rotors. The new hypothesis has the same site as the leader,
        but the opposite rate and another leg of the orbit.
        """
        orbit, leader = self._orbit, self.leader
        view = leader.view
        if orbit.number_of_legs < 4 or not view.outliers:
            return
        arc = leader.motion.arc
        leg, last = orbit.leg(arc), len(view.residuals) - 1
        turn = math.floor(arc / orbit.length) * orbit.length
        for rotor, other in ((0, 3 - leg), (last, leg ^ 1)):
            agrees = view.weights[rotor] > 0.5 or not math.isfinite(view.residuals[rotor])
            if agrees or any(orbit.leg(each.motion.arc) == other for each in self.all):
                continue
            motion = leader.motion.mirrored(orbit.arc_at(orbit.site(arc), other) + turn)
            evidence = leader.evidence - self._settings.filter.impulse_rarity
            self.all.append(Hypothesis(motion, leader.upside_down, view, evidence))

    def leg_is_known(self) -> bool:
        """Return whether the frames exclude all legs of the orbit except the leg of the leader."""
        if len(self.all) == 1:
            return True
        legs = np.array([self._orbit.leg(each.motion.arc) for each in self.all])
        weights = np.exp([each.evidence for each in self.all])
        others = weights[legs != legs[0]].sum()
        return bool(others < self._settings.likelihood.false_alarms * weights.sum())

    def mixture(self, arc_variance: float, rate_variance: float) -> MixtureMoments:
        """Return means and standard deviations, over all hypotheses, of the site and of its rate.

        `arc_variance` [rad^2] and `rate_variance` [rad^2/s^2] are added to the variances of the
        arc length and of its rate in each hypothesis.
        """
        if len(self.all) == 1:
            site, site_var, rate, rate_var = self._row(self.all[0], arc_variance, rate_variance)
            return MixtureMoments(site, math.sqrt(site_var), rate, math.sqrt(rate_var))
        rows = [self._row(each, arc_variance, rate_variance) for each in self.all]
        weights = np.exp([each.evidence for each in self.all])
        weights /= weights.sum()
        sites, site_variances, rates, rate_variances = np.array(rows).T
        site, rate = float(weights @ sites), float(weights @ rates)
        site_var = float(weights @ (site_variances + (sites - site) ** 2))
        rate_var = float(weights @ (rate_variances + (rates - rate) ** 2))
        return MixtureMoments(site, math.sqrt(site_var), rate, math.sqrt(rate_var))

    def _row(
        self, each: Hypothesis, arc_variance: float, rate_variance: float
    ) -> tuple[float, float, float, float]:
        orbit = self._orbit
        arc, rate, of_arc, both, of_rate = each.motion.summary
        site, slope = orbit.site(arc), 1 / orbit.site_arc_at(arc)
        inside = 0 < site < orbit.chain.number_of_rotors - 1
        direction = (1 - 2 * (orbit.leg(arc) % 2)) if inside else 0
        # Near an edge the rate of the site also depends on the arc length along the orbit.
        step = _STEP * orbit.site_arc
        change = rate * (1 / orbit.site_arc_at(arc + step) - slope) / step
        by_arc = change * (change * (of_arc + arc_variance) + 2 * slope * both)
        return (
            site,
            (of_arc + arc_variance) * slope * slope,
            direction * rate * slope,
            max((of_rate + rate_variance) * slope * slope + by_arc, 0.0),
        )

    def _same(self, one: Hypothesis, other: Hypothesis) -> bool:
        gate, motion = self._settings.noise.significance, one.motion
        apart = abs(math.remainder(motion.arc - other.motion.arc, self._orbit.length))
        faster = abs(motion.rate - other.motion.rate)
        return (
            one.upside_down == other.upside_down
            and apart < min(gate * motion.arc_deviation, SAME_SITE * self._orbit.site_arc)
            and faster < gate * motion.rate_deviation
        )
