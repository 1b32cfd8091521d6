# SPDX-License-Identifier: Apache-2.0
"""Lorentz contraction of a moving wall relative to the same wall at rest.

The angle of rotor n depends only on its distance from a wall at X: phi_n = f(X - n). A wall
contracted by gamma has

    phi_n = f(gamma (X - n)),

This is exact for gamma = 1, and in the continuum limit for all gamma. `WallFamily` fits
gamma and X to a frame by least squares, `ContractionMean` averages over frames, and
`WidthReporter` reports w / gamma.
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

_CLEAR = 2
"""Least distance of a fitted wall from an edge, in widths or penetration depths [1]."""
_CLOSE, _CLOSEST = 0.02, 1e-5
"""Step below which a fit has converged [1]: in standard deviations of the result, and absolute for
exact angles."""
_DEGENERATE = 1e-12
"""Smallest determinant of a fit, relative to that of orthogonal derivatives [1]."""
_COARSEST = math.log(1.5)
"""Largest standard deviation of a reported ln(gamma) [1]."""
_LEAST_DEVIATION = 3e-4
"""Error of ln(gamma) due to the assumed shape of a moving wall [1]."""
_PASSAGES, _FEWEST_PASSAGES = 30, 4
"""Largest and smallest number of passages that determine the scatter [1]."""
_SIGNIFICANCE = 2.5
"""Number of standard deviations above which the scatter is significant [1]."""
_WIDEST_LEAN_RATIO = 2.0
"""Lean ratio d above which only spinners have a tanh profile [1]."""


class Contraction(NamedTuple):
    """Contraction of a wall relative to rest; NaN if it is unknown.

    logarithm: logarithm of the contraction gamma [1].
    deviation: standard deviation of the logarithm [1]; infinite if unknown.
    """

    logarithm: float
    deviation: float

    @property
    def factor(self) -> float:
        """Contraction gamma [1]."""
        return math.exp(self.logarithm)


UNKNOWN = Contraction(math.nan, math.inf)


class WallFamily:
    """Walls of a chain as a function of the contraction."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        self.settings = settings
        self._shapes, chain = shapes, shapes.chain
        depth = penetration_depth(chain) / chain.spacing
        self._scale = max(depth, 1.0)
        self._span = settings.span * self._scale + 2
        self._last = chain.number_of_rotors - 1
        self._clear = _CLEAR * max(depth, chain.wall_width / chain.spacing)

    def fit(
        self, angles: Array, site: float, leg: int, noise: float, logarithm: float = 0.0
    ) -> Contraction:
        """Fit the contraction to one frame, near a site and a logarithm of gamma, by Gauss-Newton.

        Angles [rad], shape (N,), NaN if unknown, are in the orientation of the orbit and have
        independent noise [rad]. `leg` is a leg of the orbit. The result is unknown if the wall is
        nearer to an edge than twice its width or decay length, or if the standard deviation of
        ln(gamma) exceeds ln(1.5).
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
        if not determinant > _DEGENERATE * sites * stretches:
            return UNKNOWN
        left = (both * ahead - sites * wider) / (determinant * stretch)
        deviation = noise * math.sqrt(sites / determinant) / stretch
        near = abs(centre - site) < 1 + self._scale
        ends = abs(left) < max(_CLOSE * deviation, _CLOSEST)
        if near and ends and deviation < _COARSEST:
            return Contraction(left - math.log(stretch), deviation)
        return UNKNOWN


class ContractionMean:
    """Mean contraction over the rotors that a wall has passed recently.

    The weight of a frame is its information; the assumed variance includes the deformation of a
    wall between two rotors, so that no single site dominates. Frames are grouped into passages of
    one rotor. From one passage to the next the weights decay by e^(-1/5).
    """

    def __init__(self, family: WallFamily) -> None:
        self._family = family
        self._settings = family.settings
        self._fade = math.exp(-1 / self._settings.memory)
        self._scatter = self._settings.typical_scatter**2
        self.restart()

    def restart(self) -> None:
        """Discard the mean, for example after a kick or a reflection, but keep the scatter."""
        self._leg, self._anchor = -1, math.nan
        self._discard_passages()

    def _discard_passages(self) -> None:
        self._passages: deque[tuple[float, float]] = deque(maxlen=_PASSAGES)
        self._before, self._passage = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def update(self, angles: Array, site: float, leg: int, noise: float) -> Contraction:
        """Return the mean including one more frame; arguments as in `WallFamily.fit`.

        The mean restarts when the leg changes and when a passage contradicts earlier ones. The
        result is unknown if the frame does not determine a contraction.
        """
        if leg != self._leg:
            self.restart()
            self._leg, self._anchor = leg, site
        if abs(site - self._anchor) >= 1:
            self._pass()
            self._anchor = site
        settings = self._settings
        found = self._family.fit(angles, site, leg, noise)
        if found is UNKNOWN:
            return UNKNOWN
        weight = 1 / (found.deviation**2 + settings.typical_scatter**2)
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
        settings, sums = self._settings, self._sums()
        value, variance, self._passage = value / weight, noise / weight**2, (0.0, 0.0, 0.0)
        before = self._current_mean()
        allowed = before.deviation**2 + variance + self._scatter
        if (value - before.logarithm) ** 2 > settings.contradiction**2 * allowed:
            self._discard_passages()
            sums = weight * value, weight, noise, weight**2
        self._passages.append((value, variance))
        if len(self._passages) >= _FEWEST_PASSAGES:
            values, variances = np.array(self._passages).T
            self._scatter = passage_scatter(values, variances)
        fade = self._fade
        self._before = fade * sums[0], fade * sums[1], fade**2 * sums[2], fade**2 * sums[3]


def passage_scatter(values: Array, variances: Array) -> float:
    """Return the variance of passages in excess of their noise, 0 if it is not significant.

    The values and the variances of their noise have shape (M,).
    """
    apart, freedoms = values - np.average(values, weights=1 / variances), len(values) - 1
    by_chance = freedoms + _SIGNIFICANCE * math.sqrt(2 * freedoms)
    if np.sum(apart**2 / variances) < by_chance:
        return 0.0
    return max(float(apart @ apart) / freedoms - float(np.mean(variances)), 0.0)


class WidthReporter:
    """Reporter of the width w of a wall tanh(x / w), frame by frame."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        self._mean = ContractionMean(WallFamily(shapes, settings))
        self._at_rest = TheoryWidth(shapes.chain)(0.0)

    def update(self, angles: Array, site: float, leg: int, noise: float) -> tuple[float, float]:
        """Return the mean width and its deviation [m] with one more frame, NaN if unknown.

        See `WallFamily.fit` for the arguments.
        """
        found = self._mean.update(angles, site, leg, noise)
        width = self._at_rest / found.factor
        return width, width * found.deviation


class TheoryWidth:
    """Width of the walls of a chain by continuum theory; NaN from d = 2 to d_c."""

    def __init__(self, chain: Chain) -> None:
        theory = wall_theory(chain)
        self._speed_of_sound = theory.speed_of_sound
        defined = chain.motion is Motion.SPINNER or chain.lean_ratio < _WIDEST_LEAN_RATIO
        self._at_rest = theory.width() if defined else math.nan

    def __call__(self, velocity: float) -> float:
        """Return the width at a velocity [m], contracted by sqrt(1 - v^2 / c^2); NaN from c on."""
        if velocity == 0:
            return self._at_rest
        if not abs(velocity) < self._speed_of_sound:
            return math.nan
        share = velocity / self._speed_of_sound
        return self._at_rest * math.sqrt((1 - share) * (1 + share))
