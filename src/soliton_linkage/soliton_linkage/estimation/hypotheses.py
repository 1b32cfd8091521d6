# SPDX-License-Identifier: Apache-2.0
"""Places that compete over time, until frames decide: the mixture of which a wall is told.

Each place is followed by filters of its own, and counts by the logarithm of the likelihood of all
frames so far. Two legs that differ in an edge rotor which is not seen, or the wrong turn of a
spinner, are such places; what is told of the wall is their mean and their covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.measurement import LinearisedMeasurement
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.orbit.orbit import Orbit

_LEAD = 3.0
"""Log odds at which another hypothesis leads [1]: 95 %, so that the reported leg is steady."""


@dataclass
class Hypothesis:
    """One of the places that compete: where the chain may be, and how it goes round."""

    motion: MultipleModelFilter
    upside_down: bool
    view: LinearisedMeasurement
    evidence: float
    """Logarithm of the likelihood of all frames so far, over that of the likeliest place."""


class MixtureMoments(NamedTuple):
    """Place and rate of a wall, over all places that compete."""

    site: float
    """Mean place [rotor spacings]."""
    site_deviation: float
    """Standard deviation of the place [rotor spacings]."""
    site_rate: float
    """Mean rate [rotor spacings / s]."""
    site_rate_deviation: float
    """Standard deviation of that rate [rotor spacings / s]."""


class Hypotheses:
    """The places that compete, of which the first leads: arc, rate and leg are told of it."""

    def __init__(self, orbit: Orbit, settings: EstimationSettings) -> None:
        """Begin without any."""
        self._orbit, self._settings, self._tracking = orbit, settings, settings.tracking
        self.all: list[Hypothesis] = []

    @property
    def leader(self) -> Hypothesis:
        """The one that is told."""
        return self.all[0]

    def weigh(self, likelihoods: list[float]) -> None:
        """Count a frame of which each makes so much likely [log]; forget those that are out."""
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
            out = each is leader or each.evidence < top - self._tracking.decisive_odds
            if not out and not any(self._same(each, other) for other in kept):
                kept.append(each)
        for each in kept:
            each.evidence -= top
        self.all = kept

    def suppose_toggled(self) -> None:
        """Let another leg compete where an edge rotor is not where the leading one has it."""
        orbit, leader = self._orbit, self.leader
        view = leader.view
        if orbit.number_of_legs < 4 or not view.unbelieved:
            return
        arc = leader.motion.arc
        leg, last = orbit.leg(arc), len(view.residuals) - 1
        turn = math.floor(arc / orbit.length) * orbit.length
        for rotor, other in ((0, 3 - leg), (last, leg ^ 1)):
            seen = view.weights[rotor] > 0.5 or not math.isfinite(view.residuals[rotor])
            if seen or any(orbit.leg(each.motion.arc) == other for each in self.all):
                continue
            motion = leader.motion.mirrored(orbit.arc_at(orbit.site(arc), other) + turn)
            rarity = self._settings.filter.kick_rarity
            self.all.append(Hypothesis(motion, leader.upside_down, view, leader.evidence - rarity))

    def leg_is_known(self) -> bool:
        """Whether it can hardly be on another leg than that of the leading one."""
        if len(self.all) == 1:
            return True
        leg = self._orbit.leg(self.leader.motion.arc)
        shares = [math.exp(each.evidence) for each in self.all]
        legs = [self._orbit.leg(each.motion.arc) for each in self.all]
        others = sum(share for share, each in zip(shares, legs, strict=True) if each != leg)
        return others < self._settings.likelihood.false_alarms * sum(shares)

    def wall(self, arc_beside: float, rate_beside: float) -> MixtureMoments:
        """Place and rate of the wall, with variances that are beside those of the filters.

        They are of the arc [rad^2] and of its rate [rad^2/s^2].
        """
        if len(self.all) == 1:
            site, site_information, rate, of_rate = self._row(self.all[0], arc_beside, rate_beside)
            return MixtureMoments(site, math.sqrt(site_information), rate, math.sqrt(of_rate))
        rows = [self._row(each, arc_beside, rate_beside) for each in self.all]
        shares = np.exp([each.evidence for each in self.all])
        shares /= shares.sum()
        places, place_variances, rates, rate_variances = np.array(rows).T
        site, rate = float(shares @ places), float(shares @ rates)
        site_information = float(shares @ (place_variances + (places - site) ** 2))
        of_rate = float(shares @ (rate_variances + (rates - rate) ** 2))
        return MixtureMoments(site, math.sqrt(site_information), rate, math.sqrt(of_rate))

    def _row(
        self, each: Hypothesis, arc_beside: float, rate_beside: float
    ) -> tuple[float, float, float, float]:
        """Place, its variance, rate of the place, 0 while it waits at an edge, its variance."""
        orbit = self._orbit
        arc, rate, of_arc, _, of_rate = each.motion.summary
        site, scale = orbit.site(arc), orbit.site_arc_at(arc)
        inside = 0 < site < orbit.chain.number_of_rotors - 1
        direction = (1 - 2 * (orbit.leg(arc) % 2)) if inside else 0
        squared = scale * scale
        return (
            site,
            (of_arc + arc_beside) / squared,
            direction * rate / scale,
            (of_rate + rate_beside) / squared,
        )

    def _same(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Whether two have come to be of the same place, at the same rate."""
        gate, motion = self._tracking.gate, one.motion
        apart = abs(math.remainder(motion.arc - other.motion.arc, self._orbit.length))
        faster = abs(motion.rate - other.motion.rate)
        close = min(
            gate * motion.arc_deviation,
            self._settings.scan.near * self._orbit.site_arc,
        )
        return (
            one.upside_down == other.upside_down
            and apart < close
            and faster < gate * motion.rate_deviation
        )
