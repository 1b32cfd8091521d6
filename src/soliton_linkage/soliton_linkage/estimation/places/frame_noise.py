# SPDX-License-Identifier: Apache-2.0
"""What a point of the orbit leaves of a frame's angles, and what of that is noise."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops import noise_loops
from soliton_linkage.estimation.loops.noise_loops import NOISE
from soliton_linkage.estimation.places.frame_view import FrameView
from soliton_linkage.estimation.settings import DEFAULTS, NoiseSettings


class FrameNoise:
    """What the orbit leaves of the angles, told apart by what lasts from frame to frame.

    Noise differs from frame to frame, so that the product of what is left of a rotor in two
    frames running has mean 0. What lasts - waves, deviations and offsets - has its square but
    for what it changes meanwhile: the products of frames one and two apart lead back to it,
    c_0 = (4 c_1 - c_2) / 3.
    """

    def __init__(self, given: float | None, settings: NoiseSettings = DEFAULTS.noise) -> None:
        """Begin without frames, with the standard deviation that is given [rad]."""
        self._settings = settings.record
        self._given = 0.0 if given is None else given**2
        self._sums = np.zeros(1, NOISE)
        self._freedoms = 0.0
        self.variance = self._given
        self.least = 0.0
        """Variance that is noise for sure [rad^2]: all that a single frame shows may last."""
        self._earlier: tuple[FrameView, ...] = ()
        self.forget_what_lasted()

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise in use [rad]."""
        return math.sqrt(self.variance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the variance; infinite where it is given."""
        return math.inf if self.variance == self._given else max(self._freedoms, 1.0)

    def update(self, view: FrameView, elapsed: float) -> None:
        """Take in what is left of a frame, a time [s] after the last."""
        third = len(self._earlier) == 2
        oldest, older = self._earlier if third else (view, view)
        self._earlier = *self._earlier[-1:], view
        self._take(
            noise_loops.learn(
                self._sums,
                self._settings,
                elapsed,
                self._given,
                third,
                oldest.left,
                oldest.degrees_of_freedom,
                older.left,
                older.degrees_of_freedom,
                view.left,
                view.degrees_of_freedom,
                view.tangent,
                view.first,
                view.squares,
            )
        )

    def forget_what_lasted(self) -> None:
        """Begin anew with all but the noise, as what encoders add has been found out."""
        self._earlier = ()
        self._sums['squares'] = self.variance * self._freedoms
        for name in noise_loops.PAIRS:
            self._sums[name] = 0.0
        self._take(noise_loops.estimate(self._sums, self._settings, self._given))

    def _take(self, told: noise_loops.Estimate) -> None:
        self.variance, self.least, self.scatter, self.lasting, self.excess, self._freedoms = told
