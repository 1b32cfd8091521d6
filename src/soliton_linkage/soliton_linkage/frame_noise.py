# SPDX-License-Identifier: Apache-2.0
"""What a point of the orbit leaves of a frame's angles, and what of that is noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.chain import Array

Flags = NDArray[np.bool_]
BEYOND_CHANCE = 5.0

_MEMORY = 4000
_LEAST_NOISE = 1e-5
_DEVIATION_PER_MEDIAN = 1.4826
_SIGNIFICANT = 4.0
_LEAST_SHARE = 0.2


class FrameView:
    """What a frame looks like from a point of the orbit."""

    def __init__(
        self,
        arc: float,
        first: int,
        tangent: Array,
        residuals: Array,
        limit: float = math.inf,
        spread: float = 0.0,
    ) -> None:
        """Compare; rotors that differ too much do not count.

        Their squared residual is above the limit and what the spread [rad^2] of the arc, its
        variance, may account for.
        """
        about = residuals[first : first + len(tangent)]
        known = np.isfinite(about)
        of_arc = BEYOND_CHANCE**2 * spread * tangent**2
        squares = np.where(np.isfinite(residuals), residuals, 0.0) ** 2
        squares[first : first + len(tangent)] -= of_arc
        self.has_outliers = bool((squares > limit).any())
        outliers = squares[first : first + len(tangent)] > limit
        self.share_of_outliers = float(outliers.sum()) / max(float(known.sum()), 1.0)
        self.used = _without_outliers(known, outliers, tangent)
        self.first = first
        self.tangent = tangent
        self.residuals = residuals
        self.weights = np.where(self.used, tangent, 0.0)
        self.information = float(self.weights @ self.weights)
        seen = np.where(self.used, about, 0.0)
        ahead = float(self.weights @ seen) / self.information if self.information else 0.0
        self.arc = arc + ahead
        self.left = seen - ahead * self.weights

    @property
    def robust_limit(self) -> float:
        """Squared residual beyond chance, by the median of them all [rad^2]."""
        median = float(np.median(np.abs(self.left[self.used])))
        return (BEYOND_CHANCE * _DEVIATION_PER_MEDIAN * median) ** 2

    @property
    def freedoms(self) -> int:
        """Number of residuals that the arc leaves free."""
        return max(int(np.count_nonzero(self.used)) - 1, 1)

    @property
    def mean_square(self) -> float:
        """Mean square of what the arc leaves of the rotors about the wall [rad^2]."""
        return float(self.left @ self.left) / self.freedoms

    @property
    def root_mean_square_of_all(self) -> float:
        """The same of all rotors of the chain that are known, without the arc's share [rad]."""
        return math.sqrt(float(np.nanmean(self.residuals**2)))

    @property
    def concentration(self) -> float:
        """Return sum_n t_n^4, one over the number of rotors that move."""
        return float(np.sum(self.tangent**4))


class FrameNoise:
    """What the orbit leaves of the angles, told apart by what lasts from frame to frame.

    Noise differs from frame to frame, so that the product of what is left of a rotor in two
    frames running has mean 0. What lasts - waves, deviations and offsets - has its square.
    """

    def __init__(self, given: float | None) -> None:
        self._given = 0.0 if given is None else given**2
        self._squares = self._freedoms = 0.0
        self.variance = self._given
        self._last: FrameView | None = None
        self.forget_what_lasted()

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise in use [rad]."""
        return math.sqrt(self.variance)

    def update(self, view: FrameView) -> None:
        """Take in what is left of a frame."""
        fade = 1 - 1 / _MEMORY
        self._squares = fade * self._squares + float(view.left @ view.left)
        self._freedoms = fade * self._freedoms + view.freedoms
        if self._last is not None:
            self._pair(self._last, view, fade)
        self._last = view
        self._estimate()

    def forget_what_lasted(self) -> None:
        """Begin anew with all but the noise, as what encoders add has been found out."""
        self._squares = self.variance * self._freedoms
        self._products = self._pairs = 0.0
        self._wall = self._wall_share = self._wall_chance = 0.0
        self._last = None
        self._estimate()

    def _pair(self, last: FrameView, view: FrameView, fade: float) -> None:
        low = max(last.first, view.first)
        high = max(min(last.first + len(last.left), view.first + len(view.left)), low)
        products = last.left[low - last.first : high - last.first]
        products = products * view.left[low - view.first : high - view.first]
        both = last.used[low - last.first : high - last.first]
        both = both & view.used[low - view.first : high - view.first]
        share = np.where(both, view.tangent[low - view.first : high - view.first] ** 2, 0.0)
        free = share * (1 - share)
        self._products = fade * self._products + float(products.sum())
        self._pairs = fade * self._pairs + np.count_nonzero(both)
        self._wall = fade * self._wall + float(share @ products)
        self._wall_share = fade * self._wall_share + float(free.sum())
        self._wall_chance = fade**2 * self._wall_chance + float(free @ free)

    def _estimate(self) -> None:
        self.scatter = self._squares / self._freedoms if self._freedoms else 0.0
        sure = self._products > self._by_chance(self._pairs, 1.0)
        self.lasting = self._products / self._pairs if sure else 0.0
        sure = self._wall > self._by_chance(self._wall_chance, 0.25)
        self.excess = self._wall / self._wall_share if sure else 0.0
        white = max(self.scatter - self.lasting, _LEAST_NOISE**2)
        doubt = 1 + _SIGNIFICANT * math.sqrt(2 / max(self._freedoms, 1.0))
        self.variance = white if white > self._given * doubt else self._given

    def _by_chance(self, squared_weights: float, largest: float) -> float:
        """Bernstein's bound of a sum of weighted products of noise [rad^2]."""
        deviation = _SIGNIFICANT * math.sqrt(squared_weights)
        return self.scatter * (deviation + _SIGNIFICANT**2 / 2 * largest)


def _without_outliers(used: Flags, outliers: Flags, tangent: Array) -> Flags:
    """Rotors that count: not the outliers, unless they hold nearly all that tells the arc."""
    kept = used & ~outliers
    enough = np.sum(tangent[kept] ** 2) > _LEAST_SHARE * np.sum(tangent[used] ** 2)
    return kept if enough else used


def wrapped(differences: Array) -> Array:
    """Return differences of angles brought into -pi to pi [rad]."""
    return np.asarray(np.remainder(differences + math.pi, 2 * math.pi) - math.pi)
