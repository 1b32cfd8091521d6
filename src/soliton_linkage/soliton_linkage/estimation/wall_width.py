# SPDX-License-Identifier: Apache-2.0
"""Lorentz contraction of a moving wall, whose width is w / gamma for the width w at rest.

The angle of rotor n is phi_n = f(gamma (X - n)), with the shape f of the wall at rest, its site X
and the contraction gamma. This profile is exact for gamma = 1, and in the continuum limit for any
gamma.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation.settings import DEFAULTS, WidthSettings
from soliton_linkage.estimation.wall_shapes import WallShapes, fit_about
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.continuum import wall_theory
from soliton_linkage.solitons.tanh_fit import WIDEST_LEAN_RATIO

_CLEAR = 2
"""The contraction is known only if the distance of the wall from both edges is at least this
multiple of the wall width and of the penetration depth [1]."""
_CLOSE, _CLOSEST = 0.02, 1e-5
"""A fit has converged if the next step of ln(gamma) would be smaller than `_CLOSE` times the
standard deviation of ln(gamma), or smaller than `_CLOSEST` [1]."""
_COARSEST = math.log(1.5)
"""The contraction is unknown if the standard deviation of ln(gamma) is at least this [1]."""
_LEAST_DEVIATION = 3e-4
"""Assumed error of ln(gamma), because the profile of a moving wall is approximate [1]."""
_PASSAGES, _FEWEST_PASSAGES = 30, 4
"""The variance of ln(gamma) between passages is estimated from the last `_PASSAGES` passages if
there are at least `_FEWEST_PASSAGES` [1]. In a passage, the wall moves by one rotor spacing."""
_SIGNIFICANCE = 4.0
"""The variance between passages counts as 0 unless chi-squared exceeds its expectation for pure
noise by this number of standard deviations. The mean over passages restarts if a passage differs
from it by more than this number of standard deviations [1]."""


class Contraction(NamedTuple):
    """Contraction gamma of a wall: its width at rest divided by its width.

    logarithm: natural logarithm of gamma [1]; NaN if unknown.
    deviation: standard deviation of the logarithm [1]; infinite if unknown.
    """

    logarithm: float
    deviation: float

    @property
    def factor(self) -> float:
        """Contraction gamma [1]; NaN if unknown."""
        return math.exp(self.logarithm)


UNKNOWN = Contraction(math.nan, math.inf)


class ContractionEstimator:
    """Estimator of the contraction of a wall from one frame, or from its last passages.

    In a passage, the wall moves by one rotor spacing.
    """

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        self._shapes, self._settings, chain = shapes, settings, shapes.chain
        depth = penetration_depth(chain) / chain.spacing
        self._scale = max(depth, 1.0)
        self._span = settings.span * self._scale + 2
        self._last = chain.number_of_rotors - 1
        self._clear = _CLEAR * max(depth, chain.wall_width / chain.spacing)
        self._fade = math.exp(-1 / settings.memory)
        self._scatter = settings.typical_scatter**2
        self.restart()

    def fit(
        self, angles: Array, site: float, leg: int, noise: float, logarithm: float = 0.0
    ) -> Contraction:
        """Fit the contraction to angles [rad], shape (N,), in the orientation of the orbit.

        The fit starts at `site` [rotor spacings] and ln(gamma) = `logarithm` [1]. `noise` is the
        standard deviation of the angles [rad]. The contraction is unknown near an edge, or if the
        standard deviation of ln(gamma) exceeds ln(1.5).
        """
        if not self._clear <= site <= self._last - self._clear:
            return UNKNOWN
        centre, stretch, sums = fit_about(
            angles,
            self._span,
            self._last,
            self._shapes.of_leg(leg).table,
            site,
            math.exp(-logarithm),
        )
        sites, stretches, both, ahead, wider = sums
        determinant = sites * stretches - both * both
        if not determinant > 0:
            return UNKNOWN
        left = (both * ahead - sites * wider) / (determinant * stretch)
        deviation = noise * math.sqrt(sites / determinant) / stretch
        near = abs(centre - site) < 1 + self._scale
        ends = abs(left) < max(_CLOSE * deviation, _CLOSEST)
        if near and ends and deviation < _COARSEST:
            return Contraction(left - math.log(stretch), deviation)
        return UNKNOWN

    def restart(self) -> None:
        """Discard the mean, but keep the estimated variance between passages."""
        self._leg, self._anchor = -1, math.nan
        self._discard_passages()

    def _discard_passages(self) -> None:
        self._passages: deque[tuple[float, float]] = deque(maxlen=_PASSAGES)
        self._before, self._passage = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def update(self, angles: Array, site: float, leg: int, noise: float) -> Contraction:
        """Fit a frame, and return the mean over recent passages; `UNKNOWN` if the fit fails."""
        if leg != self._leg:
            self.restart()
            self._leg, self._anchor = leg, site
        if abs(site - self._anchor) >= 1:
            self._pass()
            self._anchor = site
        found = self.fit(angles, site, leg, noise)
        if found is UNKNOWN:
            return UNKNOWN
        weight = 1 / (found.deviation**2 + self._settings.typical_scatter**2)
        value, before, noise = self._passage
        noise += (weight * found.deviation) ** 2
        self._passage = value + weight * found.logarithm, before + weight, noise
        return self._current_mean()

    def _sums(self) -> tuple[float, float, float, float]:
        value, weight, noise = self._passage
        values, weights, noises, squares = self._before
        return values + value, weights + weight, noises + noise, squares + weight**2

    def _current_mean(self) -> Contraction:
        whole, weights, noises, squares = self._sums()
        if not weights:
            return UNKNOWN
        variance = (noises + squares * self._scatter) / weights**2
        return Contraction(whole / weights, math.sqrt(variance + _LEAST_DEVIATION**2))

    def _pass(self) -> None:
        value, weight, noise = self._passage
        if not weight:
            return
        sums = self._sums()
        value, variance, self._passage = value / weight, noise / weight**2, (0.0, 0.0, 0.0)
        before = self._current_mean()
        allowed = before.deviation**2 + variance + self._scatter
        if (value - before.logarithm) ** 2 > _SIGNIFICANCE**2 * allowed:
            self._discard_passages()
            sums = weight * value, weight, noise, weight**2
        self._passages.append((value, variance))
        if len(self._passages) >= _FEWEST_PASSAGES:
            values, variances = np.array(self._passages).T
            self._scatter = passage_scatter(values, variances)
        fade = self._fade
        self._before = fade * sums[0], fade * sums[1], fade**2 * sums[2], fade**2 * sums[3]


def passage_scatter(values: Array, variances: Array) -> float:
    """Return the variance of ln(gamma) between passages that is not due to noise.

    The result is 0 if the variance is not significant. `values` are the means of ln(gamma) in the
    passages, and `variances` are the variances of these means due to noise.
    """
    apart, freedoms = values - np.average(values, weights=1 / variances), len(values) - 1
    by_chance = freedoms + _SIGNIFICANCE * math.sqrt(2 * freedoms)
    if np.sum(apart**2 / variances) < by_chance:
        return 0.0
    return max(float(apart @ apart) / freedoms - float(np.mean(variances)), 0.0)


class TheoryWidth:
    """Width of walls in continuum theory.

    It is NaN for flippers with a lean ratio d = 2 r sin(theta_bar) / a of 2 or more, because their
    walls do not have the profile tanh(x / w) that defines the width w.
    """

    def __init__(self, chain: Chain) -> None:
        theory = wall_theory(chain)
        self._speed_of_sound = theory.speed_of_sound
        defined = chain.motion is Motion.SPINNER or chain.lean_ratio < WIDEST_LEAN_RATIO
        self._at_rest = theory.width() if defined else math.nan

    def __call__(self, velocity: float) -> float:
        """Return the width [m] at a velocity [m/s]; NaN at the speed of sound and above."""
        if velocity == 0:
            return self._at_rest
        if not abs(velocity) < self._speed_of_sound:
            return math.nan
        share = velocity / self._speed_of_sound
        return self._at_rest * math.sqrt((1 - share) * (1 + share))
