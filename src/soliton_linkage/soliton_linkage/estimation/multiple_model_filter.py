# SPDX-License-Identifier: Apache-2.0
"""How a chain goes round its cycle: Kalman filters of the arc s and its rate w.

The rate is constant along the orbit of rigid bars, and nearly so for springs. A measurement z of
the arc has noise, and an error b that lasts while the wall moves on by about a rotor:

    ds = w dt,   dw = sqrt(q) dB,   b' = a b + noise of variance m^2 (1 - a^2),   z = s + b + noise

with a = exp(-|w| dt / (Lambda / 2)) and q = e^2 |w|^3 / Lambda, which changes the rate by the
share e from rotor to rotor. Which e and m hold is not known: filters with many of each run side
by side, and the estimate is their mean, weighted by how likely each made the measurements of
late. One filter more, the steady one, has e = m = 0, so that the whole record counts to it. It is
believed by far until the likelihood of all measurements so far contradicts it, and is then begun
anew, with the odds against it.

Springs give a wall energy and take it at the edges, where e is larger by a few per cent in all
filters but the steady one, which there has to earn its trust again.

A kick changes the rate at once. Of each frame of late, at ages of 1, 2, 4, ... frames, one filter
more holds that the wall was kicked there, to a rate about which little is known. It counts by the
odds of all measurements since, against those for a kick, so that the deviations grow as soon as
innovations do; of a kick that is less likely than 1 % nothing is told. Where the odds are beyond
chance, all filters begin anew with that one.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops.filter_arrays import filter_loops

_SHARES = (0.001, 0.004, 0.016, 0.064, 0.25)
_SHARE_AT_EDGES = 0.03
_ERRORS = (1e-4, 1e-3, 4e-3, 0.016, 0.064)
_WAY_OF_AN_ERROR = 0.5
_WAY_REMEMBERED = 10.0

_TRUST = 6.0
_BEGUN_ANEW = 5.0
_TRUST_AT_EDGES = 2.0
_MOST_TRUST = 9.0

_AGES = 8
_RARE = 9.0
_NO_EVIDENCE = 4.0
_UNLIKELY = 0.01
_BEYOND_CHANCE = 15.0
_KICK_OF_SCALE = 0.1
_SHARE_AFTER_A_KICK = 0.016

_Summary = tuple[float, float, float, float, float]


class MultipleModelFilter:
    """Arc s, rate w and error b of measurement as seen by each filter, the steady one first."""

    def __init__(self, arc: float, variance: float, scale: float, site_arc: float) -> None:
        """Begin at an arc [rad] of a variance, the rate being of the scale [rad/s]."""
        shares, errors = np.meshgrid(_SHARES, _ERRORS, indexing='ij')
        self._inside = np.append(0.0, shares.ravel() ** 2)
        self._at_edges = np.append(0.0, (shares.ravel() + _SHARE_AT_EDGES) ** 2)
        self._errors = np.append(0.0, (site_arc * errors.ravel()) ** 2)
        self._base = len(self._inside)
        after = _SHARE_AFTER_A_KICK**2
        self._inside = np.append(self._inside, np.full(_AGES, after))
        self._at_edges = np.append(self._at_edges, np.full(_AGES, after))
        self._errors = np.append(self._errors, np.zeros(_AGES))
        count = self._base + _AGES
        self._states = np.zeros((3, count))
        self._states[0] = arc
        self._spreads = np.zeros((6, count))
        self._spreads[0], self._spreads[3], self._spreads[5] = variance, scale**2, self._errors
        self._site_arc = site_arc
        self._elapsed = 0.0
        self._loops = filter_loops()
        self._likelihoods = np.zeros(self._base - 1)
        self._weights = np.zeros(count)
        self._least_kick = (_KICK_OF_SCALE * scale) ** 2
        self._odds = np.full(_AGES, -np.inf)
        self._frames = self.kicks = 0
        self._against, self._least_against = -_TRUST, -_MOST_TRUST
        self._known: _Summary | None = None
        self._shares = np.full(self._base - 1, 1 / (self._base - 1))
        self._weigh()
        self._look_ahead()
        self.expected_rate = 0.0
        """Rate of the arc length that was predicted [rad/s]."""

    @property
    def arc(self) -> float:
        """Arc length [rad]."""
        return self.summary[0]

    @property
    def rate(self) -> float:
        """Rate of the arc length [rad/s]."""
        return self.summary[1]

    @property
    def arc_variance(self) -> float:
        """Variance of the arc length [rad^2]."""
        return self.summary[2]

    @property
    def covariance(self) -> float:
        """Covariance of arc and rate [rad^2/s]."""
        return self.summary[3]

    @property
    def rate_variance(self) -> float:
        """Variance of the rate [rad^2/s^2]."""
        return self.summary[4]

    @property
    def arc_deviation(self) -> float:
        """Standard deviation of the arc length [rad]."""
        return math.sqrt(self.arc_variance)

    @property
    def rate_deviation(self) -> float:
        """Standard deviation of the rate [rad/s]."""
        return math.sqrt(self.rate_variance)

    @property
    def steadiness(self) -> float:
        """Probability that the rate has been constant of late."""
        return float(self._weights[0] / self._weights[: self._base].sum())

    def predict(self, elapsed: float, at_edge: bool) -> None:
        """Go on by a time [s], with the wall at an edge of the chain or inside."""
        self._elapsed, self.expected_rate = elapsed, self.rate
        speed = abs(self.expected_rate)
        way = speed * elapsed / self._site_arc
        kept = math.exp(-way / _WAY_OF_AN_ERROR)
        wander = self._at_edges if at_edge else self._inside
        cubed = speed**3 / self._site_arc
        self._known = None
        self.expected, self.expected_variance = self._loops.predict(
            self._states,
            self._spreads,
            self._weights,
            wander,
            self._errors,
            elapsed,
            kept,
            cubed,
        )
        self._likelihoods *= math.exp(-way / _WAY_REMEMBERED)
        self._least_against = -_TRUST_AT_EDGES if at_edge else -_MOST_TRUST

    def change_rate(self, ratio: float) -> None:
        """Let the rate be changed by the orbit, to so many times what it was [1]."""
        self._states[1] *= ratio
        self._spreads[[1, 4]] *= ratio
        self._spreads[3] *= ratio**2
        self.expected_rate *= ratio
        self._look_ahead()

    def correct(self, arc: float, variance: float, freedoms: float = math.inf) -> None:
        """Take in a measurement of the arc [rad] with its variance [rad^2].

        With a variance from few degrees of freedom f a normalised innovation x counts as
        sqrt((f + 1) log(1 + x^2 / f)), by Student's distribution.
        """
        against, odds = self._loops.take_in(
            self._states,
            self._spreads,
            self._weights,
            self._shares,
            self._likelihoods,
            self._odds,
            arc,
            variance,
            freedoms,
        )
        self._against = min(max(self._against + against, self._least_against), _TRUST)
        if self._against >= _TRUST:
            self._begin_steady()
        if odds > _BEYOND_CHANCE:
            self._begin_kicked()
        self._settle()

    def _begin_steady(self) -> None:
        """Let the steady filter begin anew where the others are."""
        self._weights[0], self._weights[1 : self._base] = 0.0, self._shares
        arc, rate, of_arc, both, of_rate = self._mixture(math.inf)
        self._states[:, 0] = arc, rate, 0.0
        self._spreads[:, 0] = of_arc, both, 0.0, of_rate, 0.0, 0.0
        self._against = _BEGUN_ANEW

    def _begin_kicked(self) -> None:
        """Let all filters begin anew where the likeliest kick has led."""
        kicked = self._base + int(self._odds.argmax())
        base = slice(0, self._base)
        self._states[:2, base] = self._states[:2, kicked, None]
        self._states[2, base] = 0.0
        self._spreads[:, base] = self._spreads[:, kicked, None]
        self._spreads[[2, 4], base] = 0.0
        self._spreads[5, base] = self._errors[base]
        self._against = max(self._against, _BEGUN_ANEW)
        self._odds[:] = -np.inf
        self._frames = 0
        self.kicks += 1

    def _settle(self) -> None:
        """Weigh the filters, and let one begin that holds that the wall is kicked now.

        The others of a kick grow older: those of 2^k frames and more move on when the count of
        frames is a multiple of 2^(k + 1).
        """
        self._frames += 1
        older = min((self._frames & -self._frames).bit_length() - 1, _AGES - 1)
        self._known = self._loops.settle(
            self._states,
            self._spreads,
            self._errors,
            self._weights,
            self._shares,
            self._odds,
            self._against,
            _RARE,
            _NO_EVIDENCE,
            older,
            self._elapsed,
            self._least_kick,
            _UNLIKELY,
        )

    def _weigh(self) -> None:
        self._loops.weigh(
            self._weights, self._shares, self._odds, self._against, _RARE, _NO_EVIDENCE
        )

    @property
    def summary(self) -> _Summary:
        """Arc, rate, variance of the arc, covariance, variance of the rate; units as of each."""
        if self._known is None:
            self._known = self._mixture(_UNLIKELY)
        return self._known

    def _mixture(self, least: float) -> _Summary:
        """Mean s and w, variance of s, covariance, variance of w; kicks from a weight on."""
        mixed: _Summary = self._loops.mixture(
            self._weights, self._states, self._spreads, self._base, least
        )
        return mixed

    def _look_ahead(self) -> None:
        """Measurement that is expected, s + b [rad], its variance without noise [rad^2]."""
        self._known = None
        self.expected, self.expected_variance = self._loops.expected_measurement(
            self._states, self._spreads, self._weights
        )
