# SPDX-License-Identifier: Apache-2.0
"""Estimate of the phonon energy from the rates, also valid in chains with unmodelled disorder.

Phonons and noise cause the component of the rates phi_dot that is orthogonal to the tangent t of
the orbit. On average, half of the energy of phonons is kinetic. Therefore this energy is

    E = < I |phi_dot - t (t^T phi_dot)|^2 > - I (N - 1) sigma^2

with the average < > over time, the moment of inertia I of a rotor, the number N of rotors, and the
standard deviation sigma of the noise of a rate. To estimate sigma, third differences of the rates
in successive frames are used; the variance of such a difference is 20 sigma^2.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings

_THIRD_DIFFERENCE = np.array([-1.0, 3.0, -3.0, 1.0])
"""Binomial coefficients of a third difference [1]."""


class PhononEnergyEstimator:
    """Estimator of the phonon energy: a running mean over periods of the slowest phonon."""

    def __init__(self, orbit: Orbit, settings: SteeringSettings = DEFAULTS) -> None:
        self._orbit = orbit
        self._memory = settings.phonon_periods * 2 * math.pi / gap(orbit.chain)
        self._rates: deque[Array] = deque(maxlen=len(_THIRD_DIFFERENCE))
        self._time = -math.inf
        self._sum = 0.0
        self._weight = 0.0

    @property
    def energy(self) -> float:
        """Estimated phonon energy [J], 0 or more; NaN before the fourth frame with rates."""
        return max(self._sum / self._weight, 0.0) if self._weight else math.nan

    def update(self, time: float, rates: Array | None, arc: float) -> None:
        """Add a frame: time [s], rates [rad/s], (N,), and arc length of the wall [rad].

        If the frame is earlier than the previous one by more than the averaging time, the estimate
        restarts with this frame. Other frames that are not later than the previous one are
        ignored.
        """
        if time < self._time - self._memory:
            self._rates.clear()
            self._time, self._sum, self._weight = -math.inf, 0.0, 0.0
        if rates is None or not np.isfinite(rates).all() or time <= self._time:
            return
        elapsed, self._time = time - self._time, time
        self._rates.append(rates)
        if len(self._rates) < len(_THIRD_DIFFERENCE):
            return
        decay = math.exp(-elapsed / self._memory)
        self._sum = decay * self._sum + (1 - decay) * self._frame_energy(rates, arc)
        self._weight = decay * self._weight + (1 - decay)

    def _frame_energy(self, rates: Array, arc: float) -> float:
        about = self._orbit.segment(arc)
        orthogonal = rates.copy()
        orthogonal[about.within] -= about.tangent * float(about.tangent @ rates[about.within])
        difference = _THIRD_DIFFERENCE @ np.array(self._rates)
        square = float(difference @ difference) / float(_THIRD_DIFFERENCE @ _THIRD_DIFFERENCE)
        noise = square * (len(rates) - 1) / len(rates)
        return self._orbit.chain.moment_of_inertia * (float(orthogonal @ orthogonal) - noise)
