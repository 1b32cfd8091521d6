# SPDX-License-Identifier: Apache-2.0
"""Noise of angles and rates, told apart from what lasts from frame to frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compiled, const_f8_1d, f8, f8_1d, i8, records
from soliton_linkage.estimation.measurement import LinearisedMeasurement
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import (
    DEFAULTS,
    EstimationSettings,
    NoiseSettings,
    record_dtype,
)
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Array, Chain

DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of normal noise over the median of its absolute values [1]: 1 / 0.67449."""
FREEDOMS_OF_MEDIAN = 0.368
"""Normal errors whose root mean square is as sure as the deviation by the median of one [1]."""


def median(values: Array) -> float:
    """Median of numbers of which none is NaN, whose order is lost: numpy's takes far longer."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


def robust_deviation(sizes: Array) -> float:
    """Root mean square of errors by the median of their sizes, whose order is lost; 0 of none."""
    return DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0


Records = NDArray[np.void]
Estimate = tuple[float, float, float, float, float, float]
"""As `estimate` returns it."""

_SQUARES = ('squares', 'freedoms', 'recent_squares', 'recent_freedoms')
PAIRS = ('products', 'pairs', 'wall', 'wall_share', 'wall_chance')
NOISE = np.dtype([(name, np.float64) for name in (*_SQUARES, *PAIRS)])
"""Fading sums: of squares [rad^2] and their degrees of freedom [1], of all frames and of late; of
products of frames apart [rad^2] and how many they are [1], the same by t^2, the weights of these
and the squares of the weights [1]."""
_SUMS = records(NOISE, writable=True)
_READ_SUMS = records(NOISE)
_NUMBERS = records(record_dtype(NoiseSettings))


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, const_f8_1d, i8, f8_1d)
def products_in_time(
    oldest: Array, older: Array, left: Array, tangent: Array, first: int, found: Array
) -> None:
    """Sums of p = x (4 x' - x'') / 3 of what three frames running left of rotors [rad], (N,).

    They are over those about the wall, from a first one on: sum p, sum t^2 p, sum f and sum
    f^2 with f = t^2 - t^4.
    """
    whole, wall, free, chance = 0.0, 0.0, 0.0, 0.0
    for n in range(tangent.size):
        before = older[first + n] * (4 / 3) - oldest[first + n] / 3
        product = left[first + n] * before
        share = tangent[n] * tangent[n]
        alone = share - share * share
        whole += product
        wall += share * product
        free += alone
        chance += alone * alone
    found[0], found[1], found[2], found[3] = whole, wall, free, chance


@compiled(f8, f8, f8, f8)
def _by_chance(
    square: float, squared_weights: float, largest: float, significance: float
) -> float:
    """Bernstein's bound of a sum of weighted products of noise [rad^2], 17 / 9 as variable."""
    deviation = significance * math.sqrt(17 / 9 * squared_weights)
    return square * (deviation + significance**2 / 2 * largest)


@compiled(_READ_SUMS, _NUMBERS, f8)
def estimate(noise: Records, settings: Records, given: float) -> Estimate:
    """Variance of the noise [rad^2], by the sums so far and by the one that is given.

    Returns it and what of it is noise for sure, what frames have of late with what lasts, what
    lasts of all rotors, and of the wall [rad^2], and the degrees of freedom of the sums [1].
    """
    sums, significance = noise[0], settings[0]['significance']
    freedoms, recent = sums['freedoms'], sums['recent_freedoms']
    whole = sums['squares'] / freedoms if freedoms else 0.0
    scatter = sums['recent_squares'] / recent if recent else 0.0
    chance = _by_chance(whole, sums['pairs'], 1.0, significance)
    sure = sums['products'] > chance and chance > 0
    lasting = sums['products'] / sums['pairs'] if sure else 0.0
    sure = sums['wall'] > _by_chance(whole, sums['wall_chance'], 0.25, significance)
    excess = sums['wall'] / sums['wall_share'] if sure else 0.0
    white = max(whole - lasting, settings[0]['least_noise'] ** 2)
    doubt = 1 + significance * math.sqrt(2 / max(freedoms, 1.0))
    variance = white if white > given * doubt else given
    most = (sums['products'] + chance) / sums['pairs'] if sums['pairs'] else whole
    least = variance if given else max(whole - most, 0.0)
    return variance, least, scatter, lasting, excess, freedoms


@compiled(_SUMS, _NUMBERS, f8, f8, i8, f8, i8, const_f8_1d)
def learn(
    noise: Records,
    settings: Records,
    elapsed: float,
    given: float,
    freedoms: int,
    squares: float,
    pairs: int,
    products: Array,
) -> Estimate:
    """Add the residuals of a frame, a time [s] after the last; return the `estimate`.

    They have so many degrees of freedom and a sum of squares [rad^2]; `products_in_time` has so
    many pairs, 0 without two frames before.
    """
    sums, numbers = noise[0], settings[0]
    fade = 1 - 1 / numbers['memory']
    sums['squares'] = fade * sums['squares'] + squares
    sums['freedoms'] = fade * sums['freedoms'] + freedoms
    recent = math.exp(-min(elapsed / numbers['recent_time'], 1 / numbers['recent_frames']))
    sums['recent_squares'] = recent * sums['recent_squares'] + squares
    sums['recent_freedoms'] = recent * sums['recent_freedoms'] + freedoms
    if pairs:
        whole, wall, free, chance = products[0], products[1], products[2], products[3]
        sums['products'] = fade * sums['products'] + whole
        sums['pairs'] = fade * sums['pairs'] + pairs
        sums['wall'] = fade * sums['wall'] + wall
        sums['wall_share'] = fade * sums['wall_share'] + free
        sums['wall_chance'] = fade**2 * sums['wall_chance'] + chance
    return estimate(noise, settings, given)


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
        self._sums, self._products = np.zeros(1, NOISE), np.zeros(4)
        self._freedoms = 0.0
        self.variance = self._given
        self.least = 0.0
        """Variance that is noise for sure [rad^2]: all that a single frame shows may last."""
        self._earlier: tuple[LinearisedMeasurement, ...] = ()
        self.forget_what_lasted()

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise in use [rad]."""
        return math.sqrt(self.variance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the variance; infinite where it is given."""
        return math.inf if self.variance == self._given else max(self._freedoms, 1.0)

    def update(self, view: LinearisedMeasurement, elapsed: float) -> None:
        """Take in what is left of a frame, a time [s] after the last."""
        pairs = 0
        if len(self._earlier) == 2:
            oldest, older = self._earlier
            pairs = min(each.degrees_of_freedom for each in (oldest, older, view))
            products_in_time(
                oldest.left, older.left, view.left, view.tangent, view.first, self._products
            )
        self._earlier = *self._earlier[-1:], view
        self._take(
            learn(
                self._sums,
                self._settings,
                elapsed,
                self._given,
                view.degrees_of_freedom,
                view.squares,
                pairs,
                self._products,
            )
        )

    def forget_what_lasted(self) -> None:
        """Begin anew with all but the noise, as what encoders add has been found out."""
        self._earlier = ()
        self._sums['squares'] = self.variance * self._freedoms
        for name in PAIRS:
            self._sums[name] = 0.0
        self._take(estimate(self._sums, self._settings, self._given))

    def _take(self, told: Estimate) -> None:
        self.variance, self.least, self.scatter, self.lasting, self.excess, self._freedoms = told


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, f8)
def median_change(first: Array, second: Array, third: Array, ratio: float) -> float:
    """Return the median of |r_1 - (1 + q) r_2 + q r_3| of known rows, NaN of none."""
    changes, known = np.empty(first.size), 0
    for n in range(first.size):
        change = abs(first[n] - (1 + ratio) * second[n] + ratio * third[n])
        if change < math.inf:
            changes[known] = change
            known += 1
    return float(np.median(changes[:known])) if known else math.nan


class RateNoise:
    """Standard deviation of the noise of rates, from second differences in time.

    Of three frames, dt_1 and dt_2 apart, white noise leaves r_1 - (1 + q) r_2 + q r_3 with the
    variance (1 + (1 + q)^2 + q^2) sigma^2, q = dt_1 / dt_2, and a phonon of angular frequency w
    at even times only (w dt)^4 / 2 of its squared amplitude. The median over the rotors, which is
    too large by 1 / (3 N) of itself, excludes those in a wall. Frames more than half a radian of
    the fastest phonon apart do not tell noise from phonons.
    """

    def __init__(self, chain: Chain, settings: NoiseSettings = DEFAULTS.noise) -> None:
        """Start without any frame."""
        self._memory = settings.memory
        self._longest = 0.5 / band_edges(chain)[1]
        self.restart()

    def restart(self) -> None:
        """Forget all frames."""
        self._median, self._frames = 0.0, 0
        self._rows: list[tuple[float, Array]] = []

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [rad/s], NaN where it is unknown."""
        return DEVIATION_PER_MEDIAN * self._median if self._frames else math.nan

    def update(self, time: float, rates: Array) -> None:
        """Add the rates [rad/s] of an instant [s], shape (N,), NaN where unknown."""
        self._rows = [*self._rows[-2:], (time, np.ascontiguousarray(rates, dtype=np.float64))]
        if len(self._rows) < 3:
            return
        (start, first), (middle, second), _ = self._rows
        if max(middle - start, time - middle) > self._longest:
            return
        ratio = (middle - start) / (time - middle)
        change = median_change(first, second, self._rows[2][1], ratio)
        if math.isnan(change):
            return
        change /= math.sqrt(1 + (1 + ratio) ** 2 + ratio**2)
        self._frames = int(min(self._frames + 1, self._memory))
        self._median += (change - self._median) / self._frames


class ResidualVariance:
    """Variance of a rotor from the orbit, and with it that of the arc that a frame shows."""

    def __init__(self, swing: float, noise: float | None, settings: EstimationSettings) -> None:
        """Begin with the swing that a rotor makes as a wall passes [rad] and its noise [rad]."""
        given = settings.likelihood
        self._given_noise, self._settings = noise, settings
        self._tracking = settings.tracking
        self.elastic = (given.elastic_share * swing) ** 2
        """What springs may do to a wall before it is known [rad^2]."""
        self.largest_field = (given.field_share * swing) ** 2
        """Largest variance beside noise that a frame may have [rad^2]."""
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.way = math.inf
        """How far the wall went since the last frame [rotor spacings]."""
        self.frames = 0
        """Frames of which it was learnt."""
        self.at_edge = False
        """Whether springs take up or give back energy."""

    def begin(self, best: LinearisedMeasurement) -> None:
        """Begin anew with the likeliest view of a frame; the way is that of before."""
        self.frames = 0
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.noise.update(best, 0.0)

    def learn(self, view: LinearisedMeasurement, elapsed: float) -> None:
        """Learn from a view of a frame, a time [s] after the last."""
        self.noise.update(view, elapsed)
        self.frames += 1

    def of_rotor(self) -> float:
        """Variance of a rotor from the orbit, by noise and the field beside it [rad^2].

        The field is that of late, and what it may have changed by since the last frame.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, 0.0)
        field += self._tracking.field_ratio * noise.excess
        changed = max(min(self.way, 1.0), math.exp(-self.frames / self._tracking.settled))
        edge_ratio = self._tracking.edge_ratio if self.at_edge else 1.0
        field += self.elastic * changed * edge_ratio
        return noise.variance + min(field, self.largest_field)

    def of_arc(
        self, motion: MultipleModelFilter, view: LinearisedMeasurement, elapsed: float
    ) -> float:
        """Variance of the arc that a frame shows [rad^2], a time [s] after the last.

        Rotors of which some are not seen have another nearest point than all of them, by what
        the frame is beside the orbit and springs do not tell, for as long as the wall takes to
        pass a rotor; those of which some are not believed only in this frame.
        """
        known = max(view.information_of_all, view.information)
        unseen, unbelieved = max(1 / known - 1, 0.0), 1 / view.information - 1 / known
        way = abs(motion.expected_rate) * elapsed
        frames = max(motion.site_arc / max(way, 1e-9), 1.0)
        noise = self.noise
        field = noise.excess + (self.elastic if self.at_edge else 0.0)
        lasting = field * unseen * view.untold * min(frames, self._settings.noise.memory)
        fleeting = max(noise.scatter - noise.variance, field) * unbelieved
        return noise.variance / view.information + lasting + fleeting

    def calm(self, rate: float) -> float:
        """How little the field beside the orbit disturbs a wall of an arc rate [1], from 0 to 1.

        Waves of an angle phi change the rate w of a wall by a share of about phi / w, in units of
        the chain's time; the field tells that there are any by its share of the noise.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, noise.excess, 0.0)
        steady = rate**2 * noise.variance
        disturbed = self._tracking.wave_doubt * field * (noise.variance + field)
        return steady / (steady + disturbed) if disturbed else 1.0
