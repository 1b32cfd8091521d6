# SPDX-License-Identifier: Apache-2.0
"""How much narrower a moving wall is than the same wall at rest.

While a wall passes, rotor n of an even or odd number goes through angles that tell only how far
the wall is from it, phi_n = f(X - n). A wall that its speed has contracted by gamma is

    phi_n = f(gamma (X - n)),

which is exact at gamma = 1 in every chain and is Lorentz contraction in the continuum.
`WallFamily` fits gamma and X to a frame by least squares, `ContractionMean` averages over
frames, and `WidthReporter` says w / gamma, where the continuum theory has a width w at rest.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from soliton_linkage.estimation import wall_loops
from soliton_linkage.estimation.settings import DEFAULTS, WidthSettings
from soliton_linkage.estimation.wall_shapes import WallShapes
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage.solitons.continuum import wall_theory


class Contraction(NamedTuple):
    """How many times narrower a wall is than at rest; NaN where it cannot be told.

    logarithm: of the contraction gamma [1].
    deviation: standard deviation of the logarithm, the relative one of gamma [1]; infinite if
        unknown.
    """

    logarithm: float
    deviation: float

    @property
    def factor(self) -> float:
        """Contraction gamma [1]."""
        return math.exp(self.logarithm)


UNKNOWN = Contraction(math.nan, math.inf)


class WallFamily:
    """The walls of a chain, contracted by any gamma."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        """Contract the shapes that walls have at rest."""
        self.settings = settings
        self._shapes, chain = shapes, shapes.chain
        depth = penetration_depth(chain) / chain.spacing
        self._scale = max(depth, 1.0)
        self._span = settings.span * self._scale + 2
        self._last = chain.number_of_rotors - 1
        self._clear = settings.clear * max(depth, chain.wall_width / chain.spacing)

    def fit(
        self, angles: Array, site: float, leg: int, noise: float, logarithm: float = 0.0
    ) -> Contraction:
        """Contraction of the wall of one frame, near a place and a logarithm of gamma.

        Angles [rad] are those of a chain as the orbit has it, shape (N,), NaN where unknown,
        with independent noise [rad]; the leg is that of the orbit. Gauss and Newton's method.
        Nothing is told of a wall that is nearer to an edge than two of its widths or decay
        lengths, nor where the standard deviation would be more than a factor of 1.5.
        """
        settings = self.settings
        if not self._clear <= site <= self._last - self._clear:
            return UNKNOWN
        centre, stretch, sums = wall_loops.fit_about(
            angles,
            self._span,
            self._last,
            self._shapes.of_leg(leg).table,
            site,
            math.exp(-logarithm),
        )
        places, stretches, both, ahead, wider = sums
        determinant = places * stretches - both * both
        if not determinant > settings.degenerate * places * stretches:
            return UNKNOWN
        left = (both * ahead - places * wider) / (determinant * stretch)
        deviation = noise * math.sqrt(places / determinant) / stretch
        near = abs(centre - site) < 1 + self._scale
        ends = abs(left) < max(settings.close * deviation, settings.closest)
        if near and ends and deviation < settings.coarsest:
            return Contraction(left - math.log(stretch), deviation)
        return UNKNOWN


class ContractionMean:
    """Mean contraction over the last few rotors that a wall has passed.

    Each frame counts by its information, and with what springs do to a wall between two rotors as
    one more noise, so that no place between them counts for all. Frames are gathered in passages
    of one rotor, of which each counts e^(-1/5) of the next; `passage_scatter` tells what the
    springs of a wall in motion, and waves, add to the noise.
    """

    def __init__(self, family: WallFamily) -> None:
        """Wait for the first frame."""
        self._family = family
        self._settings = family.settings
        self._fade = math.exp(-1 / self._settings.memory)
        self._scatter = self._settings.typical_scatter**2
        self.restart()

    def restart(self) -> None:
        """Forget the mean, as after a kick or a reflection; not how much passages differ."""
        self._leg, self._anchor = -1, math.nan
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._passages: deque[tuple[float, float]] = deque(maxlen=self._settings.passages)
        self._before, self._passage = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)

    def update(self, angles: Array, site: float, leg: int, noise: float) -> Contraction:
        """Mean with one more frame; arguments as `WallFamily.fit`, the place that of the wall.

        Starts anew on another leg, and where a passage contradicts those before. Nothing is told
        of a wall that is at an edge, and by a frame that shows too little.
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
        return self._reckoned()

    def _sums(self) -> tuple[float, float, float, float]:
        """Weighted values, weights, variances by noise and squares of weights of all passages."""
        value, weight, noise = self._passage
        values, weights, noises, squares = self._before
        return values + value, weights + weight, noises + noise, squares + weight**2

    def _reckoned(self) -> Contraction:
        """Mean of the passages before and of this one."""
        whole, weights, noises, squares = self._sums()
        if not weights:
            return UNKNOWN
        variance = (noises + squares * self._scatter) / weights**2
        least = self._settings.least_deviation
        return Contraction(whole / weights, math.sqrt(variance + least**2))

    def _pass(self) -> None:
        """Take in the passage that is over, unless it contradicts: then it is a new beginning."""
        value, weight, noise = self._passage
        if not weight:
            return
        settings, sums = self._settings, self._sums()
        value, variance, self._passage = value / weight, noise / weight**2, (0.0, 0.0, 0.0)
        before = self._reckoned()
        allowed = before.deviation**2 + variance + self._scatter
        if (value - before.logarithm) ** 2 > settings.contradiction**2 * allowed:
            self._begin_anew()
            sums = weight * value, weight, noise, weight**2
        self._passages.append((value, variance))
        if len(self._passages) >= settings.fewest_passages:
            values, variances = np.array(self._passages).T
            self._scatter = passage_scatter(values, variances, settings)
        fade = self._fade
        self._before = fade * sums[0], fade * sums[1], fade**2 * sums[2], fade**2 * sums[3]


def passage_scatter(
    values: Array, variances: Array, settings: WidthSettings = DEFAULTS.width
) -> float:
    """Variance by which passages differ beyond what noise gives them, 0 where that is chance.

    It is that of values, shape (M,), less the mean of the variances of their noise, shape (M,).
    """
    apart, freedoms = values - np.average(values, weights=1 / variances), len(values) - 1
    by_chance = freedoms + settings.significance * math.sqrt(2 * freedoms)
    if np.sum(apart**2 / variances) < by_chance:
        return 0.0
    return max(float(apart @ apart) / freedoms - float(np.mean(variances)), 0.0)


class WidthReporter:
    """Reports the width w of the wall tanh(x / w) of a chain, frame by frame."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        """Begin without any frame of the chain of the shapes."""
        self._mean = ContractionMean(WallFamily(shapes, settings))
        self._at_rest = TheoryWidth(shapes.chain, settings)(0.0)

    def update(self, angles: Array, site: float, leg: int, noise: float) -> tuple[float, float]:
        """Width and its standard deviation [m] with one more frame, NaN where they are not told.

        Arguments as `ContractionMean.update`.
        """
        found = self._mean.update(angles, site, leg, noise)
        width = self._at_rest / found.factor
        return width, width * found.deviation


class TheoryWidth:
    """Width that the continuum theory gives walls of a chain; NaN from d = 2 to d_c."""

    def __init__(self, chain: Chain, settings: WidthSettings = DEFAULTS.width) -> None:
        """Work out what all speeds have in common."""
        theory = wall_theory(chain)
        self._speed_of_sound = theory.speed_of_sound
        defined = chain.motion is Motion.SPINNER or chain.lean_ratio < settings.widest_lean_ratio
        self._at_rest = theory.width() if defined else math.nan

    def __call__(self, velocity: float) -> float:
        """Width at a velocity [m], sqrt(1 - v^2 / c^2) of that at rest; NaN from c on."""
        if velocity == 0:
            return self._at_rest
        if not abs(velocity) < self._speed_of_sound:
            return math.nan
        share = velocity / self._speed_of_sound
        return self._at_rest * math.sqrt((1 - share) * (1 + share))
