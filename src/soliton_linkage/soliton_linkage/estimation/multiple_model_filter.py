# SPDX-License-Identifier: Apache-2.0
"""Multiple-model filter of the motion along the orbit (Blom and Bar-Shalom).

The state of each Kalman filter is (s, w, b, d): arc length s along the orbit [rad], its rate w
[rad/s], bias b of the measurement [rad] and disturbance d. A measurement is z = s + b + noise. The
correlation of the bias decays to 1/e while the wall moves by half a rotor spacing, or in the time
tau if the wall is at rest. Let u be the modelled acceleration. If `FilterSettings.disturbance` is
0, the changes in a time step dt are

    ds = w dt,   dw = (u + d w) dt + sqrt(q) dB,   b' = a b + noise of variance m^2 (1 - a^2),

with a = exp(-|w| dt / (Lambda / 2) - dt / tau) and q = e^2 (|w|^3 / Lambda + Q). The normal noise
dB has the variance dt. Lambda is the arc length per rotor spacing, e the random relative change of
the rate per rotor spacing, and m the standard deviation of the bias. Q is the process noise due to
waves, which also move a wall at rest. If the rate has a part that is periodic in the site (a
ripple), m^2 is increased to account for it. The disturbance d is a constant [1/s] that describes
unmodelled damping; it is negative if the motion is damped. At the start, d is 0 in all filters,
and uncertain only in the filters with the smallest e above 0.

Filters with different e and m are weighted by the likelihood of recent measurements. The steady
filter has e = m = 0, so that old measurements affect its estimate as much as recent ones. If the
measurements contradict the steady filter, it restarts with a low weight from the mean of the other
filters. While the wall is at an edge, e is larger, because springs exchange energy with the wall.
The weight of the steady filter has an upper limit, which is lower in strong waves and at edges.

Each of the remaining filters assumes one impulse, after which the rate is almost unknown. The
first of these filters assumes the impulse in the last time step, and the others assume it about 1,
2, 4, ... frames earlier. The weight of such a filter is the prior probability of an impulse times
the likelihood ratio of the measurements since the impulse. If this ratio exceeds a limit, all
filters restart from the state of this filter.

If `FilterSettings.disturbance` is above 0, d is instead an unmodelled acceleration [rad/s^2], and
the arc length, the rate and d of all filters have additional noise. Without the noise sqrt(q) dB,
which the steady filter does not have,

    ds = w dt + sqrt(3 r) W dB_1,   dw = (u + d) dt + sqrt(3 r) W^2 dB_2,   dd = sqrt(r) W^3 dB_3,

where dB_1, dB_2 and dB_3 are independent normal noises like dB, r is the variance of a measurement
times the time step, and W is the bandwidth of the disturbance. The steady filter then has three
poles at -W for any r (Riccati equation).
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
_LEAST_IMPULSE = 0.1
"""Assumed standard deviation of the rate change by an impulse to a wall at rest, relative to the
typical rate [1]."""


def slope_variance(ratio: float, frequency: float) -> float:
    """Return the variance of a rate due to an oscillation of the arc length of variance 1 [1/s^2].

    `ratio` is the variance of the rate divided by the variance of the arc length [1/s^2], and
    `frequency` the angular frequency of the oscillation [rad/s]. The slope of a line that is
    fitted over a time T has the bandwidth sqrt(`ratio`) = sqrt(3) / T. Compared with a constant
    error, an oscillation of the frequency w changes the slope by the fraction 4 / (w T).
    """
    relative = math.sqrt(ratio) / frequency
    return ratio * min(4 * relative, 1.0, 1 / relative) ** 2


class MultipleModelFilter:
    """Bank of Kalman filters for arc length along the orbit, rate, bias and disturbance."""

    def __init__(
        self,
        arc: float,
        variance: float,
        scale: float,
        site_arc: float,
        settings: FilterSettings = DEFAULTS.filter,
    ) -> None:
        """Start at an arc length [rad] with its variance [rad^2].

        `scale` is the typical rate [rad/s], and `site_arc` the arc length per rotor spacing [rad].
        """
        self._settings = settings
        self.site_arc = site_arc
        self._base = 1 + len(settings.rate_changes) * len(settings.biases)
        self.filters = self._models()
        """Records of type `FILTER`, shape (F,)."""
        self.filters['state'][:, ARC] = arc
        covariances = self.filters['covariance']
        covariances[:, ARC, ARC] = variance
        covariances[:, RATE, RATE] = scale**2
        covariances[:, BIAS, BIAS] = self.filters['bias_variance']
        if settings.disturbance:
            covariances[:, DISTURBANCE, DISTURBANCE] = (settings.disturbance * scale**2) ** 2
        else:
            # Only the models with the smallest change of the rate include unmodelled damping.
            damped = slice(1, 1 + len(settings.biases))
            covariances[damped, DISTURBANCE, DISTURBANCE] = (settings.damping * scale) ** 2
        self._status = np.zeros(1, STATUS)
        odds, least_impulse = -settings.restart_odds, (_LEAST_IMPULSE * scale) ** 2
        decay = scale / settings.bias_time
        constants = self._base, site_arc, least_impulse, decay
        self._status[0] = *constants, variance, 0, 0, odds, 0, 0, 0, 0
        self._known: _Summary | None = None
        set_weights(self.filters, settings.record, self._base, odds)
        self._refresh()
        self.expected_rate, self._at_edge = 0.0, False

    def _models(self) -> Records:
        settings, base = self._settings, self._base
        models = np.zeros(base + settings.impulse_ages, FILTER)
        changes, biases = np.meshgrid(settings.rate_changes, settings.biases, indexing='ij')
        models['rate_noise'][1:base] = changes.ravel() ** 2
        models['bias_variance'][1:base] = (self.site_arc * biases.ravel()) ** 2
        if settings.impulse_ages:
            # After an impulse, use the process noise of the middle model.
            middle = settings.rate_changes[len(settings.rate_changes) // 2]
            models['rate_noise'][base:] = middle**2
        models['prior'][1:base] = 0.5 / max(base - 2, 1)
        models['prior'][1:2] = 0.5 if base > 2 else 1.0
        models['probability'][1:base] = models['prior'][1:base]
        models['odds'][base:] = -np.inf
        return models

    def mirrored(self, arc: float) -> MultipleModelFilter:
        """Return a copy of the filter at another arc length [rad], with the opposite rate."""
        other = copy.copy(self)
        other.filters, other._status = self.filters.copy(), self._status.copy()
        other.filters['state'] *= -1
        other.filters['state'][:, ARC] += arc + self.arc
        other.expected_rate = -self.expected_rate
        other._refresh()
        return other

    @property
    def arc(self) -> float:
        """Mean arc length along the orbit [rad]."""
        return self.summary[0]

    @property
    def rate(self) -> float:
        """Mean rate of the arc length [rad/s]."""
        return self.summary[1]

    @property
    def arc_deviation(self) -> float:
        """Standard deviation of the arc length [rad]."""
        return math.sqrt(self.summary[2])

    @property
    def rate_deviation(self) -> float:
        """Standard deviation of the rate of the arc length [rad/s]."""
        return math.sqrt(self.summary[4])

    @property
    def disturbance(self) -> float:
        """Estimated unmodelled acceleration [rad/s^2]; 0 if the settings exclude it."""
        if not self._settings.disturbance:
            return 0.0
        return float(self.filters['weight'] @ self.filters['state'][:, DISTURBANCE])

    def predict(
        self,
        elapsed: float,
        exchange: float = 0.0,
        ratio: float = 1.0,
        acceleration: float = 0.0,
        bandwidth: float = 0.0,
        ripple: float = 0.0,
    ) -> None:
        """Predict all filters over the time `elapsed` [s].

        `exchange` is the random relative change of the rate per rotor spacing by which springs
        exchange energy with the wall at an edge [1]. `ratio` is the factor by which the rate
        changes in the time `elapsed` without external forces [1], `acceleration` the acceleration
        by modelled forces [rad/s^2], and `bandwidth` the bandwidth of the disturbance [rad/s].
        `ripple` is added to the stationary variance of each bias because of a ripple of the rate
        [rad^2].
        """
        self._status['ripple'] = ripple
        # Over the four rotor spacings of a reflection, the changes add up to twice the change per
        # spacing. They have no effect if they are smaller than the deviation of the rate.
        self._at_edge = 2 * exchange * abs(self.rate) > self.rate_deviation
        rate, gained = self.rate, (acceleration + self.disturbance) * elapsed
        self._known = None
        self.expected, self.expected_variance = predict(
            self.filters,
            self._status,
            self._settings.record,
            elapsed,
            exchange if self._at_edge else 0.0,
            ratio,
            acceleration,
            bandwidth,
        )
        self.expected_rate = ratio * (rate + gained)

    def apply_impulse(
        self, change: float, rate_variance: float = 0.0, arc_variance: float = 0.0
    ) -> None:
        """Add the rate change by an impulse [rad/s] to all filters.

        `rate_variance` [rad^2/s^2] is added to the variance of each rate, and `arc_variance`
        [rad^2] to the variance of each arc length.
        """
        self.filters['state'][:, RATE] += change
        self.filters['covariance'][:, RATE, RATE] += rate_variance
        self.filters['covariance'][:, ARC, ARC] += arc_variance
        self.expected_rate += change
        self._refresh()

    def shift_arc(self, shift: float) -> None:
        """Add `shift` [rad] to the arc length of all filters."""
        self.filters['state'][:, ARC] += shift
        self._refresh()

    def set_rate(self, rate: float, deviation: float) -> None:
        """Set the rate of all filters [rad/s] and its standard deviation [rad/s]."""
        self.filters['state'][:, RATE] = rate
        self.filters['covariance'][:, RATE, RATE] = deviation**2
        self._refresh()

    def add_rate_noise(self, variance: float, elapsed: float) -> None:
        """Add a random rate change of `variance` [rad^2/s^2] during the last `elapsed` [s]."""
        covariances = self.filters['covariance']
        covariances[:, RATE, RATE] += variance
        covariances[:, ARC, ARC] += variance * elapsed**2 / 3
        covariances[:, ARC, RATE] += variance * elapsed / 2
        covariances[:, RATE, ARC] += variance * elapsed / 2
        self._refresh()

    def set_wave_acceleration(self, acceleration: float, duration: float) -> None:
        """Set the rms acceleration by waves [rad/s^2] and the time for which it is constant [s].

        The filters with the largest random change e of the rate use this acceleration. The other
        filters use a smaller one, in proportion to their e.
        """
        largest = max(self._settings.rate_changes, default=0.0)
        if largest:
            self._status['wave_noise'] = (acceleration / largest) ** 2 * duration

    def update(
        self, arc: float, variance: float, degrees_of_freedom: float = math.inf, calm: float = 1.0
    ) -> None:
        """Update all filters with a measured arc length [rad] and its variance [rad^2].

        The likelihood of an innovation is computed from Student's distribution with the degrees of
        freedom of `variance`. `calm`, from 0 in strong waves to 1 without waves, limits the weight
        of the steady filter.
        """
        self._known = measure(
            self.filters,
            self._status,
            self._settings.record,
            arc,
            variance,
            degrees_of_freedom,
            0.0 if self._at_edge else calm,
        )

    @property
    def impulses(self) -> int:
        """Number of impulses that the filter has detected."""
        return int(self._status['impulses'][0])

    @property
    def summary(self) -> _Summary:
        """Mixture moments: arc length s [rad], rate w [rad/s], var(s), cov(s, w), var(w)."""
        if self._known is None:
            self._known = mixture(self.filters, len(self.filters))
        return self._known

    def _refresh(self) -> None:
        self._known = None
        self._status['rate'] = self.rate
        self.expected, self.expected_variance = expected_measurement(self.filters)
