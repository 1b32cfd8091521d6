# SPDX-License-Identifier: Apache-2.0
"""Motion of a chain along its orbit: Kalman filters of the arc s and its rate w, many at once.

Models that differ in their process noise run side by side (multiple-model filter, Blom and
Bar-Shalom). The state is (s, w, b, d): arc [rad], rate [rad/s], bias of the measurement [rad] and
disturbance [rad/s^2]. A measurement z = s + b + noise has a bias that lasts while the wall moves
on by about a rotor:

    ds = w dt,   dw = sqrt(q) dB,   b' = a b + noise of variance m^2 (1 - a^2),

with a = exp(-|w| dt / (Lambda / 2)) and q = e^2 |w|^3 / Lambda, which changes the rate by the
share e from rotor to rotor. Filters with many e and m run side by side; the estimate is their
mean, weighted by the likelihood of the recent measurements. One more filter, the steady one, has
e = m = 0, so that the whole record counts. Its weight is high until the likelihood of all
measurements contradicts it; then it restarts from the others with the odds against it.

Springs exchange energy with a wall at the edges, where e is larger in all filters but the steady
one, which has to earn its weight again; so it has among waves as strong as the wall's own motion.

An impulse changes the rate at once. For each recent frame, at ages of 1, 2, 4, ... frames, one
filter assumes an impulse there, to a rate about which little is known. It counts by the odds of
all measurements since, against those for an impulse. Beyond chance, all filters restart from it.

With a disturbance, all three wander with the variance r of a measurement times the time step,

    ds = w dt + sqrt(3 r) W dB_1,   dw = (u + d) dt + sqrt(3 r) W^2 dB_2,   dd = sqrt(r) W^3 dB_3,

so that the steady filter has three poles at -W whatever r is (Riccati equation).
"""

from __future__ import annotations

import copy
import math

import numpy as np

from soliton_linkage.estimation.filter_bank import (
    ARC,
    BIAS,
    DISTURBANCE,
    FILTER,
    RATE,
    STATUS,
    Records,
    expected_measurement,
    measure,
    mixture,
    predict,
    set_weights,
)
from soliton_linkage.estimation.settings import DEFAULTS, FilterSettings

_Summary = tuple[float, float, float, float, float]


class MultipleModelFilter:
    """Arc, rate, bias and disturbance by many Kalman filters."""

    def __init__(
        self,
        arc: float,
        variance: float,
        scale: float,
        site_arc: float,
        settings: FilterSettings = DEFAULTS.filter,
    ) -> None:
        """Start at an arc [rad] of a variance [rad^2], with rates of the scale [rad/s].

        The site arc [rad] is that from one rotor to the next.
        """
        self._settings = settings
        self.site_arc = site_arc
        """Arc from one rotor to the next [rad]."""
        self._base = 1 + len(settings.rate_changes) * len(settings.biases)
        self.filters = self._models()
        """Records of `FILTER`, shape (F,)."""
        self.filters['state'][:, ARC] = arc
        covariances = self.filters['covariance']
        covariances[:, ARC, ARC] = variance
        covariances[:, RATE, RATE] = scale**2
        covariances[:, BIAS, BIAS] = self.filters['bias_variance']
        covariances[:, DISTURBANCE, DISTURBANCE] = (settings.disturbance * scale**2) ** 2
        self._status = np.zeros(1, STATUS)
        against, least_kick = -settings.odds_of_doubt, (settings.least_kick * scale) ** 2
        self._status[0] = self._base, site_arc, least_kick, variance, 0, 0, 0, against, 0, 0
        self._known: _Summary | None = None
        set_weights(self.filters, settings.record, self._base, against)
        self._look_ahead()
        self.expected_rate = 0.0
        """Predicted rate of the arc length [rad/s]."""

    def _models(self) -> Records:
        settings, base = self._settings, self._base
        models = np.zeros(base + settings.kick_ages, FILTER)
        changes, biases = np.meshgrid(settings.rate_changes, settings.biases, indexing='ij')
        models['wander'][1:base] = changes.ravel() ** 2
        models['wander_at_edges'][1:base] = (changes.ravel() + settings.change_at_edges) ** 2
        models['bias_variance'][1:base] = (self.site_arc * biases.ravel()) ** 2
        if settings.kick_ages:
            # After an impulse the rate changes as in the middle model.
            middle = settings.rate_changes[len(settings.rate_changes) // 2]
            models['wander'][base:] = models['wander_at_edges'][base:] = middle**2
        models['share'][1:base] = 1 / max(base - 1, 1)
        models['odds'][base:] = -np.inf
        return models

    def mirrored(self, arc: float) -> MultipleModelFilter:
        """Return the same motion in the opposite direction, which is at an arc [rad] now."""
        other = copy.copy(self)
        other.filters, other._status = self.filters.copy(), self._status.copy()
        other.filters['state'] *= -1
        other.filters['state'][:, ARC] += arc + self.arc
        other.expected_rate = -self.expected_rate
        other._look_ahead()
        return other

    @property
    def arc(self) -> float:
        """Arc length [rad]."""
        return self.summary[0]

    @property
    def rate(self) -> float:
        """Rate of the arc length [rad/s]."""
        return self.summary[1]

    @property
    def arc_deviation(self) -> float:
        """Standard deviation of the arc length [rad]."""
        return math.sqrt(self.summary[2])

    @property
    def rate_deviation(self) -> float:
        """Standard deviation of the rate [rad/s]."""
        return math.sqrt(self.summary[4])

    @property
    def disturbance(self) -> float:
        """Acceleration that no torque explains [rad/s^2], 0 without a model of it."""
        if not self._settings.disturbance:
            return 0.0
        return float(self.filters['weight'] @ self.filters['state'][:, DISTURBANCE])

    def predict(
        self,
        elapsed: float,
        at_edge: bool,
        ratio: float = 1.0,
        acceleration: float = 0.0,
        bandwidth: float = 0.0,
    ) -> None:
        """Predict over a time [s], with the wall at an edge of the chain or inside.

        The ratio is the factor by which the orbit changes the rate [1]; torques give an
        acceleration [rad/s^2]; a disturbance is followed with a bandwidth [rad/s].
        """
        rate, gained = self.rate, (acceleration + self.disturbance) * elapsed
        self._known = None
        self.expected, self.expected_variance = predict(
            self.filters,
            self._status,
            self._settings.record,
            elapsed,
            at_edge,
            ratio,
            acceleration,
            bandwidth,
        )
        self.expected_rate = ratio * (rate + gained)

    def apply_impulse(self, change: float, of_rate: float = 0.0, of_arc: float = 0.0) -> None:
        """Apply an impulse: a change of the rate [rad/s], and what it adds to the variances.

        They are those of the rate [rad^2/s^2] and of the arc [rad^2].
        """
        self.filters['state'][:, RATE] += change
        self.filters['covariance'][:, RATE, RATE] += of_rate
        self.filters['covariance'][:, ARC, ARC] += of_arc
        self.expected_rate += change
        self._look_ahead()

    def update(
        self,
        arc: float,
        variance: float,
        degrees_of_freedom: float = math.inf,
        calm: float = 1.0,
    ) -> None:
        """Update with a measurement of the arc [rad] and its variance [rad^2].

        With a variance from f degrees of freedom a normalised innovation x counts as
        sqrt((f + 1) log(1 + x^2 / f)), by Student's distribution. The odds for the steady filter
        are limited in proportion to the calm of the chain, from 0 to 1.
        """
        self._known = measure(
            self.filters,
            self._status,
            self._settings.record,
            arc,
            variance,
            degrees_of_freedom,
            calm,
        )

    @property
    def kicks(self) -> int:
        """Number of impulses that were detected."""
        return int(self._status['kicks'][0])

    @property
    def summary(self) -> _Summary:
        """Arc, rate, variance of the arc, covariance, variance of the rate; units as of each."""
        if self._known is None:
            self._known = mixture(self.filters, len(self.filters))
        return self._known

    def _look_ahead(self) -> None:
        """Set the measurement that is expected, s + b [rad], and its variance [rad^2]."""
        self._known = None
        self._status['rate'] = self.rate
        self.expected, self.expected_variance = expected_measurement(self.filters)
