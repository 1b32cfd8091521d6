# SPDX-License-Identifier: Apache-2.0
"""Energy of the phonons beside a wall, from the rates of a chain that may be other than thought.

Springs of unknown lengths hide what energy they hold, but not how rotors move: off the orbit's
tangent t they move with phonons alone, whose energy is kinetic for half of the time,

    E = < I |phi_dot - t (t . phi_dot)|^2 > - I (N - 1) sigma^2.

The noise sigma of the rates is told by their third differences from frame to frame, in which
phonons, slow beside the frames, are next to nothing: sum (1, 3, 3, 1)^2 = 20 sigma^2 a rotor.
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
    """Running mean of the phonons' energy over the last few periods of the slowest."""

    def __init__(self, orbit: Orbit, settings: SteeringSettings = DEFAULTS) -> None:
        """Know of no frame yet."""
        self._orbit = orbit
        self._memory = settings.phonon_periods * 2 * math.pi / gap(orbit.chain)
        self._rates: deque[Array] = deque(maxlen=len(_THIRD_DIFFERENCE))
        self._time = -math.inf
        self._sum = 0.0
        self._weight = 0.0

    @property
    def energy(self) -> float:
        """Energy of the phonons [J], 0 or more; NaN before the fourth frame with rates."""
        return max(self._sum / self._weight, 0.0) if self._weight else math.nan

    def update(self, time: float, rates: Array | None, arc: float) -> None:
        """Take in a frame [s] with its rates [rad/s], shape (N,), and the wall's arc [rad].

        Frames that come late or twice change nothing; a clock that goes back far begins anew.
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
        kept = math.exp(-elapsed / self._memory)
        self._sum = kept * self._sum + (1 - kept) * self._frame_energy(rates, arc)
        self._weight = kept * self._weight + (1 - kept)

    def _frame_energy(self, rates: Array, arc: float) -> float:
        about = self._orbit.segment(arc)
        within = slice(about.first, about.first + len(about.tangent))
        off = rates.copy()
        off[within] -= about.tangent * float(about.tangent @ rates[within])
        difference = _THIRD_DIFFERENCE @ np.array(self._rates)
        square = float(difference @ difference) / float(_THIRD_DIFFERENCE @ _THIRD_DIFFERENCE)
        noise = square * (len(rates) - 1) / len(rates)
        return self._orbit.chain.moment_of_inertia * (float(off @ off) - noise)
