# SPDX-License-Identifier: Apache-2.0
"""What a point of the orbit leaves of a frame's angles, and what of that is noise."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.loops import frame_loops
from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.estimation.robust import robust_deviation
from soliton_linkage.estimation.settings import DEFAULTS, NoiseSettings
from soliton_linkage.linkage.chain import Array

_NO_FLAGS: Flags = np.zeros(0, dtype=np.bool_)
"""Of a chain of which no rotor is doubtful."""


class FrameView:
    """What a frame looks like from a point of the orbit, in the orientation of the orbit."""

    arc: float
    """Arc of the nearest point of the orbit, to first order in the residuals [rad]."""
    first: int
    """Number of the first rotor about the wall."""
    tangent: Array
    """Change of the angles of the rotors about the wall with the arc [1], shape (n,)."""
    residuals: Array
    """Angles less those of that point [rad], shape (N,), NaN where unknown."""
    used: Flags
    """Rotors about the wall that tell the arc, shape (n,)."""
    left: Array
    """Their residuals, 0 for those that do not count [rad], shape (n,)."""
    information: float
    """Information on the arc in units of that of a noise of 1 rad [1]."""
    squares: float
    """Sum of squares of what is left of them [rad^2]."""
    any_outlying: bool
    """Whether any rotor of the chain is outlying."""
    largest: float
    """Largest residual of all rotors of the chain [rad], infinite where one is not known."""

    def __init__(
        self,
        arc: float,
        first: int,
        tangent: Array,
        differences: Array,
        limit: float = math.inf,
        spread: float = 0.0,
        doubtful: Flags | None = None,
        settings: NoiseSettings = DEFAULTS.noise,
    ) -> None:
        """Compare; rotors that differ too much or are doubtful, shape (N,), do not count.

        Differences are from the orbit at the arc [rad], shape (N,). They are too much where
        their square is above the limit and what the spread [rad^2] of the arc, its variance, may
        account for.
        """
        self.first, self.end = first, first + len(tangent)
        self.tangent, self.residuals = tangent, differences
        self.outlying: Flags = np.empty(len(differences), dtype=np.bool_)
        self.used = np.empty(len(tangent), dtype=np.bool_)
        self.left = np.empty(len(tangent))
        self._beyond_chance = settings.beyond_chance
        counts, self.any_outlying, sums, self.largest = frame_loops.find_arc(
            differences=differences,
            first=first,
            tangent=tangent,
            limit=limit,
            spread=settings.beyond_chance**2 * spread,
            least_share=settings.least_share,
            doubtful=_NO_FLAGS if doubtful is None else doubtful,
            outlying=self.outlying,
            used=self.used,
            left=self.left,
        )
        known, excluded, used = counts
        self.information, ahead, self.squares = sums
        self.share_of_outliers = excluded / max(known, 1)
        self.degrees_of_freedom = max(used - 1, 1)
        self.arc = arc + ahead

    @property
    def robust_limit(self) -> float:
        """Squared residual beyond chance, by the median of them all [rad^2]."""
        if not self.used.any():
            return math.inf
        return (self._beyond_chance * robust_deviation(np.abs(self.left[self.used]))) ** 2

    @property
    def mean_square(self) -> float:
        """Mean square of what the arc leaves of the rotors about the wall [rad^2]."""
        return float(self.squares / self.degrees_of_freedom)

    @property
    def mean_square_of_all(self) -> float:
        """The same of all rotors of the chain that are known, outliers too [rad^2]."""
        return float(np.nanmean(self.residuals**2))


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
        of_each = [each.degrees_of_freedom for each in (oldest, older, view)]
        freedoms = min(high - low - 1, *of_each)
        self._pairs = fade * self._pairs + max(freedoms, 0)
        self._wall = fade * self._wall + wall
        self._wall_share = fade * self._wall_share + free
        self._wall_chance = fade**2 * self._wall_chance + chance

    def _estimate(self) -> None:
        whole = self._squares / self._freedoms if self._freedoms else 0.0
        recent = self._recent_freedoms
        self.scatter = self._recent_squares / recent if recent else 0.0
        sure = self._products > self._by_chance(whole, self._pairs, 1.0) > 0
        self.lasting = self._products / self._pairs if sure else 0.0
        sure = self._wall > self._by_chance(whole, self._wall_chance, 0.25)
        self.excess = self._wall / self._wall_share if sure else 0.0
        white = max(whole - self.lasting, self._settings.least_noise**2)
        doubt = 1 + self._settings.significance * math.sqrt(2 / max(self._freedoms, 1.0))
        self.variance = white if white > self._given * doubt else self._given

    def _by_chance(self, square: float, squared_weights: float, largest: float) -> float:
        """Bernstein's bound of a sum of weighted products of noise [rad^2], 17 / 9 as variable."""
        significance = self._settings.significance
        deviation = significance * math.sqrt(17 / 9 * squared_weights)
        return square * (deviation + significance**2 / 2 * largest)
