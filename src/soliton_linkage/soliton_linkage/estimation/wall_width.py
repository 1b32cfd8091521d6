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
from typing import NamedTuple

from soliton_linkage.estimation.loops import wall_loops
from soliton_linkage.estimation.settings import DEFAULTS, WidthSettings
from soliton_linkage.estimation.walls.wall_shapes import WallShapes
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Array, Motion, staggered
from soliton_linkage.solitons.continuum import wall_theory


class Contraction(NamedTuple):
    """How many times narrower a wall is than at rest; NaN where it cannot be told.

    logarithm: of the contraction gamma [1].
    deviation: standard deviation of the logarithm, the relative one of gamma [1]; infinite if
        unknown.
    place: place of the wall that goes with it [rotor spacings].
    """

    logarithm: float
    deviation: float
    place: float

    @property
    def factor(self) -> float:
        """Contraction gamma [1]."""
        return math.exp(self.logarithm)


_Seen = tuple[Array, int, Array, float, float]
"""Staggered angles about a wall, the first of their rotors, and the table of its shape."""

UNTOLD = Contraction(math.nan, math.inf, math.nan)


class Width(NamedTuple):
    """Width w of a wall tanh(x / w); NaN where it cannot be told.

    measured: width at rest in the continuum over the measured contraction [m]; NaN from d = 2 to
        d_c.
    deviation: standard deviation of what is measured [m].
    theory: width of the continuum theory at the wall's speed [m]; NaN from the speed of sound on.
    contraction: how many times narrower than at rest the wall is, gamma [1].
    contraction_deviation: standard deviation of the contraction [1].
    """

    measured: float
    deviation: float
    theory: float
    contraction: float
    contraction_deviation: float


class WallFamily:
    """The walls of a chain, contracted by any gamma."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        """Contract the shapes that walls have at rest."""
        self.settings = settings
        self._shapes, chain = shapes, shapes.chain
        depth = penetration_depth(chain) / chain.spacing
        self._scale = max(depth, 1.0)
        self._last = chain.number_of_rotors - 1
        self._clear = settings.clear * max(depth, chain.wall_width / chain.spacing)

    def fit(
        self, angles: Array, place: float, leg: int, noise: float, logarithm: float = 0.0
    ) -> Contraction:
        """Contraction of the wall of one frame, near a place and a logarithm of gamma.

        Angles [rad] are those of a chain as the orbit has it, shape (N,), NaN where unknown,
        with independent noise [rad]; the leg is that of the orbit. Gauss and Newton's method.
        Nothing is told of a wall that is nearer to an edge than two of its widths or decay
        lengths, nor where the standard deviation would be more than a factor of 1.5.
        """
        settings = self.settings
        if not self._clear <= place <= self._last - self._clear:
            return UNTOLD
        seen = self._seen(angles, place, leg)
        centre, stretch, *_ = wall_loops.fit(
            *seen, place, math.exp(-logarithm), 1.0, math.inf, True
        )
        logarithm = -math.log(stretch)
        step = self._step(seen, centre, stretch)
        deviation = noise * step.deviation
        close = max(settings.close * deviation, settings.closest)
        near = abs(centre - place) < 1 + self._scale and abs(step.contracted) < close
        if near and deviation < settings.coarsest:
            return Contraction(logarithm, deviation, centre)
        return UNTOLD

    def step(self, angles: Array, centre: float, leg: int, logarithm: float) -> ContractionStep:
        """Step of Gauss and Newton's method from X and ln(gamma), arguments as `fit`."""
        if not self._clear <= centre <= self._last - self._clear:
            return _NO_STEP
        return self._step(self._seen(angles, centre, leg), centre, math.exp(-logarithm))

    def _step(self, seen: _Seen, centre: float, stretch: float) -> ContractionStep:
        places, stretches, both, ahead, wider = wall_loops.sums_of_fit(
            *seen, centre, stretch, 1.0, math.inf, True
        )
        determinant = places * stretches - both * both
        if not determinant > self.settings.degenerate * places * stretches:
            return _NO_STEP
        return ContractionStep(
            contracted=(both * ahead - places * wider) / (determinant * stretch),
            deviation=math.sqrt(places / determinant) / stretch,
        )

    def _seen(self, angles: Array, centre: float, leg: int) -> _Seen:
        """Staggered angles about a wall, the first of their rotors, and the table of its shape."""
        span, shapes = self.settings.span * self._scale + 2, self._shapes
        first = max(math.ceil(centre - span), 1)
        theta = staggered(angles)[first : min(math.floor(centre + span) + 1, self._last)]
        return theta, first, shapes.of_leg(leg).table, shapes.points, shapes.reach


class ContractionStep(NamedTuple):
    """Step of Gauss and Newton's method towards the least squares."""

    contracted: float
    """Of the logarithm of gamma [1]."""
    deviation: float
    """Standard deviation of that logarithm for a noise of 1 rad [1/rad]."""


_NO_STEP = ContractionStep(0.0, math.inf)
"""Of a frame that tells nothing."""


class ContractionMean:
    """Mean contraction over the last few rotors that a wall has passed.

    Each frame is a step of Gauss and Newton's method from the mean so far, where it is nearly
    linear in the noise, with its information as a weight. Frames are gathered in passages of one
    rotor, of which each counts e^(-1/5) of the next; `PassageScatter` tells what the springs of
    a wall in motion, and waves, add to the noise.
    """

    def __init__(self, family: WallFamily) -> None:
        """Wait for the first frame."""
        self._family = family
        self._settings = family.settings
        self._fade = math.exp(-1 / self._settings.memory)
        self._scatter = PassageScatter(self._settings)
        self.restart()

    def restart(self) -> None:
        """Forget the mean, as after a kick or a reflection; not how much passages differ."""
        self._leg = -1
        self._anchor = math.nan
        self._before = _NOTHING
        self._passage = RotorPassage()
        self._scatter.restart()
        self._mean: Contraction | None = None

    def update(self, angles: Array, place: float, leg: int, noise: float) -> Contraction:
        """Mean with one more frame; arguments as `WallFamily.fit`, the place that of the wall.

        Starts anew on another leg, and where a passage contradicts those before. Nothing is told
        of a wall that is at an edge, and by a frame that shows too little.
        """
        if leg != self._leg:
            self.restart()
            self._leg, self._anchor = leg, place
        if abs(place - self._anchor) >= 1:
            self._pass()
            self._anchor = place
        mean = self.mean
        if mean.deviation > self._settings.rough:
            fit = self._family.fit(angles, place, leg, noise)
            value, deviation = fit.logarithm, fit.deviation
        else:
            step = self._family.step(angles, place, leg, mean.logarithm)
            value, deviation = mean.logarithm + step.contracted, noise * step.deviation
        if not deviation < self._settings.coarsest:
            return UNTOLD
        self._passage.add(value, max(deviation, self._settings.least_deviation))
        self._mean = None
        found = self.mean
        return Contraction(found.logarithm, found.deviation, place)

    @property
    def mean(self) -> Contraction:
        """The mean so far."""
        if self._mean is None:
            self._mean = self._reckoned()
        return self._mean

    def _reckoned(self) -> Contraction:
        sums = self._before
        if self._passage.weight:
            sums = sums.plus(self._passage.mean, self._passage.weight)
        if not sums.weight:
            return UNTOLD
        variance = sums.noise_variance + self._scatter.variance_of_mean(sums.share)
        return Contraction(sums.mean, math.sqrt(variance), math.nan)

    def _pass(self) -> None:
        """Take in the passage that is over, unless it contradicts: then it is a new beginning."""
        done, self._passage = self._passage, RotorPassage()
        if not done.weight:
            return
        self._mean = None
        if self._before.weight:
            noise = 1 / done.weight + self._before.noise_variance
            allowed = noise + (1 + self._before.share) * self._scatter.variance
            if (done.mean - self._before.mean) ** 2 > self._settings.contradiction**2 * allowed:
                self._before = _NOTHING
                self._scatter.restart()
        self._scatter.update(done)
        self._before = self._before.faded(self._fade).plus(done.mean, done.weight)


class RotorPassage:
    """Frames while a wall passes a rotor."""

    def __init__(self) -> None:
        """Begin without frames."""
        self.weight = self._sum = self._plain = self._variances = 0.0
        self._count = 0

    def add(self, value: float, deviation: float) -> None:
        """Take in a frame."""
        weight = 1 / deviation**2
        self._sum += weight * value
        self.weight += weight
        self._plain += value
        self._variances += deviation**2
        self._count += 1

    @property
    def mean(self) -> float:
        """Mean with weights."""
        return self._sum / self.weight

    @property
    def disagreement(self) -> float:
        """Mean without weights less that with them."""
        return self._plain / self._count - self.mean

    @property
    def disagreement_variance(self) -> float:
        """Its variance where there is nothing but noise."""
        return max(self._variances / self._count**2 - 1 / self.weight, 0.0)


class _Sums(NamedTuple):
    """Sums over passages, for a weighted mean and its variance."""

    values: float
    weight: float
    noises: float
    squares: float

    @property
    def mean(self) -> float:
        return self.values / self.weight

    @property
    def noise_variance(self) -> float:
        """Variance of the mean by noise."""
        return self.noises / self.weight**2

    @property
    def share(self) -> float:
        """One over the number of passages that the mean is made of."""
        return self.squares / self.weight**2

    def plus(self, value: float, weight: float) -> _Sums:
        return _Sums(
            self.values + weight * value,
            self.weight + weight,
            self.noises + weight,
            self.squares + weight**2,
        )

    def faded(self, fade: float) -> _Sums:
        return _Sums(
            fade * self.values, fade * self.weight, fade**2 * self.noises, fade**2 * self.squares
        )


_NOTHING = _Sums(0.0, 0.0, 0.0, 0.0)
"""Of no passage."""


class PassageScatter:
    """How much passages differ beyond what noise gives them, and for how long.

    Their differences from the mean of the last 30 have a variance tau^2 beside the noise, and a
    correlation rho from one to the next, with which a mean of M passages has

        min(1, (1 + rho) / ((1 - rho) M)) tau^2.

    What repeats with every rotor, and so in every passage, makes means with and without weights
    disagree. Either counts where it is more than chance; until three passages are over tau is
    taken for a typical one.
    """

    def __init__(self, settings: WidthSettings = DEFAULTS.width) -> None:
        """Begin without passages."""
        self._settings = settings
        self._fade = math.exp(-1 / settings.long_memory)
        self._excess = self._product = self._shares = self._ratio = self._count = 0.0
        self._disagreement = self._disagreement_variance = self._passages = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin a new mean; what is known of the differences stays."""
        self._slow = _NOTHING
        self._last = 0.0
        self._summarise()

    def update(self, done: RotorPassage) -> None:
        """Take in a passage."""
        if self._slow.weight:
            apart = done.mean - self._slow.mean
            noise = 1 / done.weight + self._slow.noise_variance
            self._excess = self._fade * self._excess + apart**2 - noise
            self._product = self._fade * self._product + apart * self._last
            self._shares = self._fade * self._shares + 1 + self._slow.share
            self._ratio = self._fade * self._ratio + apart**2 / noise
            self._count = self._fade * self._count + 1
            self._last = apart
        self._disagreement = self._fade * self._disagreement + done.disagreement
        self._disagreement_variance = (
            self._fade**2 * self._disagreement_variance + done.disagreement_variance
        )
        self._passages = self._fade * self._passages + 1
        self._slow = self._slow.faded(self._fade).plus(done.mean, done.weight)
        self._summarise()

    def variance_of_mean(self, share: float) -> float:
        """What is added to the variance of a mean of 1 / share passages [1]."""
        return self._repeated + min(share * self._lasting, 1.0) * self.variance

    def _summarise(self) -> None:
        """Work out what the next frames have in common."""
        self.variance = self._variance()
        """tau^2 [1]; 0 where the noise alone may have done it."""
        self._lasting = self._together()
        self._repeated = self._in_all()

    def _variance(self) -> float:
        settings = self._settings
        if self._count < settings.fewest_passages:
            return settings.typical_scatter**2
        if self._ratio < self._count + settings.significance * math.sqrt(2 * self._count):
            return 0.0
        return max(self._excess / self._shares, 0.0)

    def _together(self) -> float:
        """Number of passages that go together, (1 + rho) / (1 - rho)."""
        if self._count < self._settings.fewest_passages or self._product <= 0:
            return 1.0
        rho = self._product / max(self._excess, self._product)
        rho = min(rho, self._settings.most_alike)
        return (1 + rho) / (1 - rho)

    def _in_all(self) -> float:
        """Square of the disagreement of means with and without weights, beyond chance."""
        by_chance = self._settings.significance**2 * self._disagreement_variance
        if self._disagreement**2 <= by_chance:
            return 0.0
        return (self._disagreement / self._passages) ** 2


class WidthReporter:
    """Reports the width of the wall of a chain, frame by frame, beside that of the theory."""

    def __init__(self, shapes: WallShapes, settings: WidthSettings = DEFAULTS.width) -> None:
        """Begin without any frame of the chain of the shapes."""
        chain = shapes.chain
        theory = wall_theory(chain)
        self._speed_of_sound = theory.speed_of_sound
        self._mean = ContractionMean(WallFamily(shapes, settings))
        undefined = chain.motion is not Motion.SPINNER
        undefined &= chain.lean_ratio >= settings.widest_lean_ratio
        self._at_rest = math.nan if undefined else theory.width()

    def restart(self) -> None:
        """Forget the frames so far, as after a kick."""
        self._mean.restart()

    def update(
        self, angles: Array, place: float, leg: int, velocity: float, noise: float
    ) -> Width:
        """Width with one more frame; the velocity [m/s], all else as `ContractionMean.update`."""
        found = self._mean.update(angles, place, leg, noise)
        width, factor = self._at_rest * math.exp(-found.logarithm), found.factor
        known = math.isfinite(found.logarithm)
        return Width(
            measured=width,
            deviation=width * found.deviation if known else math.nan,
            theory=self._at_rest * self._theory_ratio(velocity),
            contraction=factor,
            contraction_deviation=factor * found.deviation if known else math.nan,
        )

    def _theory_ratio(self, velocity: float) -> float:
        """Width at a velocity [m/s] over that at rest, sqrt(1 - v^2 / c^2); NaN from c on."""
        if velocity == 0:
            return 1.0
        if not abs(velocity) < self._speed_of_sound:
            return math.nan
        share = velocity / self._speed_of_sound
        return math.sqrt((1 - share) * (1 + share))
