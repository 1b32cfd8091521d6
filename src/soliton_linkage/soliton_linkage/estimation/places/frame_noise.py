# SPDX-License-Identifier: Apache-2.0
"""What a point of the orbit leaves of a frame's angles, and what of that is noise."""

from __future__ import annotations

import math

from soliton_linkage.estimation.loops import frame_loops
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
        self._settings = settings
        self._given = 0.0 if given is None else given**2
        self._squares = self._freedoms = 0.0
        self._recent_squares = self._recent_freedoms = 0.0
        self.variance = self._given
        self.least = 0.0
        """Variance that is noise for sure [rad^2]: all that a single frame shows may last."""
        self._earlier: list[FrameView] = []
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
        squares, settings = view.squares, self._settings
        fade = 1 - 1 / settings.memory
        self._squares = fade * self._squares + squares
        self._freedoms = fade * self._freedoms + view.degrees_of_freedom
        recent = math.exp(-min(elapsed / settings.recent_time, 1 / settings.recent_frames))
        self._recent_squares = recent * self._recent_squares + squares
        self._recent_freedoms = recent * self._recent_freedoms + view.degrees_of_freedom
        if len(self._earlier) == 2:
            self._pair(self._earlier[0], self._earlier[1], view, fade)
        self._earlier = [*self._earlier[-1:], view]
        self._estimate()

    def forget_what_lasted(self) -> None:
        """Begin anew with all but the noise, as what encoders add has been found out."""
        self._squares = self.variance * self._freedoms
        self._products = self._pairs = 0.0
        self._wall = self._wall_share = self._wall_chance = 0.0
        self._earlier = []
        self._estimate()

    def _pair(self, oldest: FrameView, older: FrameView, view: FrameView, fade: float) -> None:
        low = max(oldest.first, older.first, view.first)
        high = max(min(oldest.end, older.end, view.end), low)
        whole, wall, free, chance = frame_loops.products_in_time(
            oldest=oldest.left,
            older=older.left,
            left=view.left,
            tangent=view.tangent,
            in_oldest=low - oldest.first,
            in_older=low - older.first,
            begin=low - view.first,
            count=high - low,
        )
        self._products = fade * self._products + whole
        freedoms = min(
            high - low - 1,
            oldest.degrees_of_freedom,
            older.degrees_of_freedom,
            view.degrees_of_freedom,
        )
        self._pairs = fade * self._pairs + max(freedoms, 0)
        self._wall = fade * self._wall + wall
        self._wall_share = fade * self._wall_share + free
        self._wall_chance = fade**2 * self._wall_chance + chance

    def _estimate(self) -> None:
        whole = self._squares / self._freedoms if self._freedoms else 0.0
        recent = self._recent_freedoms
        self.scatter = self._recent_squares / recent if recent else 0.0
        chance = self._by_chance(whole, self._pairs, 1.0)
        sure = self._products > chance > 0
        self.lasting = self._products / self._pairs if sure else 0.0
        sure = self._wall > self._by_chance(whole, self._wall_chance, 0.25)
        self.excess = self._wall / self._wall_share if sure else 0.0
        white = max(whole - self.lasting, self._settings.least_noise**2)
        doubt = 1 + self._settings.significance * math.sqrt(2 / max(self._freedoms, 1.0))
        self.variance = white if white > self._given * doubt else self._given
        lasting = (self._products + chance) / self._pairs if self._pairs else whole
        self.least = self.variance if self._given else max(whole - lasting, 0.0)

    def _by_chance(self, square: float, squared_weights: float, largest: float) -> float:
        """Bernstein's bound of a sum of weighted products of noise [rad^2], 17 / 9 as variable."""
        significance = self._settings.significance
        deviation = significance * math.sqrt(17 / 9 * squared_weights)
        return square * (deviation + significance**2 / 2 * largest)
