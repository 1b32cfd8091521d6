# SPDX-License-Identifier: Apache-2.0
"""Noise of the rates of rotors, told from how they change from frame to frame."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.robust import DEVIATION_PER_MEDIAN
from soliton_linkage.estimation.settings import DEFAULTS, NoiseSettings
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Array, Chain


class RateNoise:
    """Standard deviation of the noise of rates, from second differences in time.

    Of three frames an even time dt apart, white noise leaves r_1 - 2 r_2 + r_3 with the variance
    6 sigma^2, and a phonon of angular frequency w only (w dt)^4 / 2 of its squared amplitude.
    The median over the rotors, which is too large by 1 / (3 N) of itself, leaves out those in a
    wall. Frames further apart than half a radian of the fastest phonon cannot tell noise from
    phonons.
    """

    def __init__(self, chain: Chain, settings: NoiseSettings = DEFAULTS.noise) -> None:
        """Begin without any frame."""
        self._settings = settings
        self._longest = settings.slowest_frames / band_edges(chain)[1]
        self.restart()

    def restart(self) -> None:
        """Forget all frames."""
        self._median, self._frames = 0.0, 0
        self._before: tuple[float, Array] | None = None
        self._last: tuple[float, Array] | None = None

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [rad/s], NaN where it cannot be told."""
        if not self._frames:
            return math.nan
        return DEVIATION_PER_MEDIAN / math.sqrt(6) * self._median

    def update(self, time: float, rates: Array) -> None:
        """Take in the rates [rad/s] of an instant [s], shape (N,), NaN where unknown."""
        row = np.ascontiguousarray(rates, dtype=np.float64)
        before, self._before, self._last = self._before, self._last, (time, row)
        if before is None or self._before is None:
            return
        first, second = self._before[0] - before[0], time - self._before[0]
        uneven = abs(first - second) > self._settings.unevenness * first
        if uneven or max(first, second) > self._longest:
            return
        change = frame_loops.median_change(before[1], self._before[1], row)
        if math.isnan(change):
            return
        self._frames = min(self._frames + 1, self._settings.rate_memory)
        self._median += (change - self._median) / self._frames
