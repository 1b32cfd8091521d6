# SPDX-License-Identifier: Apache-2.0
"""How a chain goes round its orbit: Kalman filters of the arc s and its rate w, many at once.

Models that differ in their noise run side by side, as in the multiple-model filters of Blom and
Bar-Shalom. The rate is constant along the orbit of rigid bars, and nearly so for springs. A
measurement z of the arc has noise, and a bias b that lasts while the wall moves on by about a
rotor:

    ds = w dt,   dw = sqrt(q) dB,   b' = a b + noise of variance m^2 (1 - a^2),   z = s + b + noise

with a = exp(-|w| dt / (Lambda / 2)) and q = e^2 |w|^3 / Lambda, which changes the rate by the
share e from rotor to rotor. Which e and m hold is not known: filters with many of each run side
by side, and the estimate is their mean, weighted by how likely each made the measurements of
late. One filter more, the steady one, has e = m = 0, so that the whole record counts to it. It is
believed by far until the likelihood of all measurements so far contradicts it, and is then begun
anew, with the odds against it.

Where the settings look for a force that lasts, the rate has a disturbance d beside what known
torques give it, u, and all three wander,

    ds = w dt + sqrt(3 r) W dB_1,   dw = (u + d) dt + sqrt(3 r) W^2 dB_2,   dd = sqrt(r) W^3 dB_3,

with the variance r of a measurement times the time between two. By the Riccati equation the
steady filter then has the poles p of r (W^2 - p^2)^3 = 0: all three are -W, whatever r is.

Springs give a wall energy and take it at the edges, where e is larger by a few per cent in all
filters but the steady one, which there has to earn its trust again. So it has to where waves are
as strong as the wall's own motion: what they do to it comes back after a long time.

A kick changes the rate at once. Of each frame of late, at ages of 1, 2, 4, ... frames, one filter
more holds that the wall was kicked there, to a rate about which little is known. It counts by the
odds of all measurements since, against those for a kick, so that the deviations grow as soon as
innovations do, but for odds that chance makes often, or that rest on one measurement. Where they
are beyond chance, all filters begin anew with that one.
"""

from __future__ import annotations

import copy
import math

import numpy as np

from soliton_linkage.estimation import filter_loops
from soliton_linkage.estimation.filter_loops import FILTER, Records
from soliton_linkage.estimation.settings import DEFAULTS, FilterSettings

_Summary = tuple[float, float, float, float, float]


class MultipleModelFilter:
    """Arc s, rate w and bias b of the measurement by many Kalman filters, the steady one first."""

    def __init__(
        self,
        arc: float,
        variance: float,
        scale: float,
        site_arc: float,
        settings: FilterSettings = DEFAULTS.filter,
    ) -> None:
        """Begin at an arc [rad] of a variance [rad^2], the rate being of the scale [rad/s].

        The arc from one rotor to the next is the site arc [rad].
        """
        self._settings = settings
        self.site_arc = site_arc
        """Arc from one rotor to the next [rad]."""
        self._base = 1 + len(settings.rate_changes) * len(settings.biases)
        self.filters = self._models()
        """State, covariance, model and weight of each, records of shape (F,); see `FILTER`."""
        self.filters['arc'] = arc
        self.filters['arc_arc'] = variance
        self.filters['rate_rate'] = scale**2
        self.filters['bias_bias'] = self.filters['bias_variance']
        self.filters['disturbance_disturbance'] = (settings.disturbance * scale**2) ** 2
        self.filters['share'][1 : self._base] = 1 / max(self._base - 1, 1)
        self.filters['odds'][self._base :] = -np.inf
        self._elapsed, self._at_edge = 0.0, False
        self._least_kick = (settings.least_kick * scale) ** 2
        self._frames = self.kicks = 0
        self._against = settings.first_odds
        self._known: _Summary | None = None
        self._variance = variance
        filter_loops.set_weights(self.filters, settings.record, self._base, self._against)
        self._look_ahead()
        self.expected_rate = 0.0
        """Rate of the arc length that was predicted [rad/s]."""

    def _models(self) -> Records:
        """The steady filter, those with each change of rate and bias, those of a kick."""
        settings, base = self._settings, self._base
        filters = np.zeros(base + settings.kick_ages, FILTER)
        changes, biases = np.meshgrid(settings.rate_changes, settings.biases, indexing='ij')
        filters['wander'][1:base] = changes.ravel() ** 2
        filters['wander_at_edges'][1:base] = (changes.ravel() + settings.change_at_edges) ** 2
        filters['bias_variance'][1:base] = (self.site_arc * biases.ravel()) ** 2
        filters['wander'][base:] = settings.change_after_kick**2
        filters['wander_at_edges'][base:] = settings.change_after_kick**2
        return filters

    def mirrored(self, arc: float) -> MultipleModelFilter:
        """The same motion the other way, which is at an arc [rad] now."""
        other = copy.copy(self)
        other.filters = self.filters.copy()
        other.filters['arc'] = arc - (self.filters['arc'] - self.arc)
        for name in ('rate', 'bias', 'disturbance'):
            other.filters[name] *= -1
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
        """Acceleration that no torque explains [rad/s^2], 0 where none is looked for."""
        if not self._settings.disturbance:
            return 0.0
        return float(self.filters['weight'] @ self.filters['disturbance'])

    def predict(
        self,
        elapsed: float,
        at_edge: bool,
        ratio: float = 1.0,
        acceleration: float = 0.0,
        bandwidth: float = 0.0,
    ) -> None:
        """Go on by a time [s], with the wall at an edge of the chain or inside.

        Torques give an acceleration [rad/s^2] and the orbit changes the rate to so many times what
        it was [1] on the way; what is unknown beside is followed with a bandwidth [rad/s].
        """
        settings = self._settings
        self._elapsed, self._at_edge, self.expected_rate = elapsed, at_edge, self.rate
        gained = (acceleration + self.disturbance) * elapsed
        speed = abs(self.expected_rate)
        way = speed * elapsed / self.site_arc
        kept = math.exp(-way / settings.bias_way)
        remembered = math.exp(-way / settings.way_remembered)
        self._known = None
        self.expected, self.expected_variance = filter_loops.predict(
            self.filters,
            elapsed,
            kept,
            speed**3 / self.site_arc,
            remembered,
            at_edge,
            ratio,
            acceleration,
            bandwidth,
            (bandwidth * elapsed) ** 2 * self._variance,
        )
        self.expected_rate = ratio * (self.expected_rate + gained)

    def push(self, change: float, of_rate: float = 0.0, of_arc: float = 0.0) -> None:
        """Let a push change the rate [rad/s], with what it adds to the variances.

        They are those of the rate [rad^2/s^2] and of the arc [rad^2].
        """
        self.filters['rate'] += change
        self.filters['rate_rate'] += of_rate
        self.filters['arc_arc'] += of_arc
        self.expected_rate += change
        self._look_ahead()

    def update(
        self,
        arc: float,
        variance: float,
        degrees_of_freedom: float = math.inf,
        calm: float = 1.0,
    ) -> None:
        """Update by a measurement of the arc [rad] with its variance [rad^2].

        With a variance from few degrees of freedom f a normalised innovation x counts as
        sqrt((f + 1) log(1 + x^2 / f)), by Student's distribution. The steady filter is believed
        as far as the chain is calm, from 0 to 1.
        """
        self._variance = variance
        (self._against, frames), self._known = filter_loops.measure(
            self.filters,
            self._settings.record,
            self._base,
            arc,
            variance,
            degrees_of_freedom,
            self._against,
            self._at_edge,
            self._frames,
            self._elapsed,
            self._least_kick,
            calm,
        )
        self.kicks += frames <= self._frames
        self._frames = frames

    @property
    def summary(self) -> _Summary:
        """Arc, rate, variance of the arc, covariance, variance of the rate; units as of each."""
        if self._known is None:
            self._known = filter_loops.mixture(self.filters, len(self.filters))
        return self._known

    def _look_ahead(self) -> None:
        """Measurement that is expected, s + b [rad], its variance without noise [rad^2]."""
        self._known = None
        self.expected, self.expected_variance = filter_loops.expected_measurement(self.filters)
