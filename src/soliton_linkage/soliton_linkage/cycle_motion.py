# SPDX-License-Identifier: Apache-2.0
"""How a chain goes round its cycle: Kalman filters of the arc s and its rate w.

The rate is constant along the orbit of rigid bars, and nearly so for springs. A measurement z of
the arc has noise, and an error b that lasts until the wall has moved on by its width:

    ds = w dt,   dw = sqrt(q) dB,   b' = a b + noise of variance m^2 (1 - a^2),   z = s + b + noise

with a = exp(-|w| dt / reach) and q = e^2 |w|^3 / Lambda, which changes the rate by the share e
from rotor to rotor. Filters with shares from 0 on run side by side; that counts whose
measurements of late are likeliest, and the one of e = 0, to which the whole record counts, unless
another is likelier by far. In each, where the mean of the last normalised innovations is larger
than chance allows, the wall has been kicked, and the variances of s and w grow by what that mean
says of them.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.chain import Array

_BEYOND_CHANCE = 4.5

_SHARES = np.array([0.0, 0.003, 0.01, 0.03, 0.1])
_HORIZONS = 4.0 ** np.arange(7)
_MEMORY = 1000
_BY_FAR = 6.0


class CycleMotion:
    """Arc s, rate w and error b of measurement as seen by each filter."""

    def __init__(self, arc: float, variance: float, scale: float, site_arc: float) -> None:
        """Begin at an arc [rad] of a variance, the rate being of the scale [rad/s]."""
        count = len(_SHARES)
        self._states = np.tile([arc, 0.0, 0.0], (count, 1))
        self._spreads = np.tile(np.diag([variance, scale**2, 0.0]), (count, 1, 1))
        self._means = np.zeros((count, len(_HORIZONS)))
        self._evidence = np.zeros(count)
        self._square_rates = np.zeros(count)
        self._site_arc = site_arc
        self._excess = 0.0
        self._chosen = 0
        self.reach = math.inf

    @property
    def arc(self) -> float:
        """Arc length [rad]."""
        return float(self._states[self._chosen, 0])

    @property
    def rate(self) -> float:
        """Rate of the arc length [rad/s]."""
        return float(self._states[self._chosen, 1])

    @property
    def arc_deviation(self) -> float:
        """Standard deviation of the arc [rad]."""
        return math.sqrt(self._spreads[self._chosen, 0, 0])

    @property
    def rate_deviation(self) -> float:
        """Standard deviation of the rate [rad/s]."""
        return math.sqrt(self._spreads[self._chosen, 1, 1])

    @property
    def covariance(self) -> float:
        """Covariance of arc and rate [rad^2/s]."""
        return float(self._spreads[self._chosen, 0, 1])

    @property
    def expected(self) -> tuple[float, float]:
        """Measurement expected, s + b [rad], and its variance without noise [rad^2]."""
        arcs, spreads = self._expected()
        return float(arcs[self._chosen]), float(spreads[self._chosen])

    def predict(self, elapsed: float, excess: float) -> None:
        """Go on by a time [s], with errors of measurement of a variance m^2 [rad^2]."""
        rates = self._states[:, 1]
        kept = np.exp(-np.abs(rates) * (elapsed / self.reach))
        steps = np.zeros_like(self._spreads)
        steps[:, [0, 1], [0, 1]] = 1.0
        steps[:, 0, 1] = elapsed
        steps[:, 2, 2] = kept
        wander = _SHARES**2 * np.maximum(self._square_rates, rates**2) ** 1.5 / self._site_arc
        self._states = np.einsum('kij,kj->ki', steps, self._states)
        self._spreads = steps @ self._spreads @ steps.transpose(0, 2, 1)
        self._spreads[:, 0, 0] += wander * elapsed**3 / 3
        self._spreads[:, 0, 1] += wander * elapsed**2 / 2
        self._spreads[:, 1, 0] += wander * elapsed**2 / 2
        self._spreads[:, 1, 1] += wander * elapsed
        self._spreads[:, 2, 2] += excess * (1 - kept**2) + max(excess - self._excess, 0.0)
        self._excess = excess

    def surprised(self, arc: float, variance: float, elapsed: float) -> bool:
        """Whether innovations are beyond chance; then the variances grow to explain them.

        Their running mean over a horizon of h frames has the variance 1 / (2 h - 1).
        """
        arcs, spreads = self._expected()
        scales = np.sqrt(spreads + variance)
        surprises = (arc - arcs) / scales
        self._evidence *= 1 - 1 / _MEMORY
        self._evidence -= surprises**2 / 2 + np.log(scales)
        self._means += (surprises[:, None] - self._means) / _HORIZONS
        scores = np.abs(self._means) * np.sqrt(2 * _HORIZONS - 1)
        worst = np.argmax(scores, axis=1)
        beyond = np.flatnonzero(scores.max(axis=1) > _BEYOND_CHANCE)
        errors = self._means[beyond, worst[beyond]] * scales[beyond]
        self._spreads[beyond, 0, 0] += errors**2
        self._spreads[beyond, 1, 1] += (errors / (_HORIZONS[worst[beyond]] * elapsed)) ** 2
        self._means[beyond] = 0
        return self._chosen in beyond

    def correct(self, arc: float, variance: float) -> None:
        """Take in a measurement of the arc [rad] with its variance [rad^2]."""
        arcs, spreads = self._expected()
        shared = self._spreads[:, :, 0] + self._spreads[:, :, 2]
        gains = shared / (spreads + variance)[:, None]
        self._states = self._states + gains * (arc - arcs)[:, None]
        left = self._spreads - gains[:, :, None] * shared[:, None, :]
        self._spreads = (left + left.transpose(0, 2, 1)) / 2
        self._square_rates += (self._states[:, 1] ** 2 - self._square_rates) / _MEMORY
        best = int(np.argmax(self._evidence))
        self._chosen = best if self._evidence[best] > self._evidence[0] + _BY_FAR else 0

    def _expected(self) -> tuple[Array, Array]:
        arcs = self._states[:, 0] + self._states[:, 2]
        spreads = self._spreads[:, 0, 0] + 2 * self._spreads[:, 0, 2] + self._spreads[:, 2, 2]
        return arcs, spreads
