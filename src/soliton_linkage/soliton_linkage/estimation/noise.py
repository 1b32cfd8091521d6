# SPDX-License-Identifier: Apache-2.0
"""Noise of angles and rates, separated from persistent residuals."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import compiled, const_f8_1d, f8, f8_1d, i8, records
from soliton_linkage.estimation.measurement import LinearisedMeasurement
from soliton_linkage.estimation.settings import (
    DEFAULTS,
    EstimationSettings,
    NoiseSettings,
    record_dtype,
)
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Array, Chain

DEVIATION_PER_MEDIAN = 1.4826
"""Ratio of the standard deviation of normal noise to the median of its absolute values [1]."""
FREEDOMS_OF_MEDIAN = 0.368
"""Efficiency of the median of absolute values as an estimator of the standard deviation [1]."""

_LARGEST_CHANGE = 12.0
"""Limit of the squared second difference of arcs, relative to its variance [1]."""
_EDGE_RATIO = 4.0
"""Ratio of the variance of the deformation of a wall at an edge to that inside the chain [1]."""
_FIELD_RATIO = 3.0
"""Ratio of the largest squared residual near a wall to the mean [1]; waves are not uniform."""


def median(values: Array) -> float:
    """Return the median of numbers without NaN and reorder them; faster than `numpy.median`."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


def robust_deviation(sizes: Array) -> float:
    """Return the standard deviation from the median of absolute errors, and reorder them."""
    return DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0


Records = NDArray[np.void]
Estimate = tuple[float, float, float, float, float, float]
"""Result of `estimate`."""

_SQUARES = ('squares', 'freedoms', 'recent_squares', 'recent_freedoms')
PAIRS = ('products', 'pairs', 'wall', 'wall_weights', 'wall_squared_weights')
NOISE = np.dtype([(name, np.float64) for name in (*_SQUARES, *PAIRS)])
"""Exponentially weighted sums over frames: squares [rad^2] and degrees of freedom [1] of all and
of recent frames; products of successive frames [rad^2] and their number [1]; the same products
weighted by t^2 [rad^2], and sums of their weights and squared weights [1]."""
_SUMS = records(NOISE, writable=True)
_READ_SUMS = records(NOISE)
_NUMBERS = records(record_dtype(NoiseSettings))


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, const_f8_1d, i8, f8_1d)
def products_in_time(
    oldest: Array, older: Array, latest: Array, tangent: Array, first: int, found: Array
) -> None:
    """Set sums of p = x (4 x' - x'') / 3 over the residuals of three frames [rad], (N,).

    The sums over the rotors near the wall, from rotor `first` on, are sum p, sum t^2 p, sum f and
    sum f^2 with f = t^2 - t^4.
    """
    total, wall, weights, squared = 0.0, 0.0, 0.0, 0.0
    for n in range(tangent.size):
        before = older[first + n] * (4 / 3) - oldest[first + n] / 3
        product = latest[first + n] * before
        square = tangent[n] * tangent[n]
        weight = square - square * square
        total += product
        wall += square * product
        weights += weight
        squared += weight * weight
    found[0], found[1], found[2], found[3] = total, wall, weights, squared


@compiled(f8, f8, f8, f8)
def _noise_bound(
    square: float, squared_weights: float, largest: float, significance: float
) -> float:
    """Return Bernstein's bound of a weighted sum of products of variance 17 / 9 [rad^2]."""
    deviation = significance * math.sqrt(17 / 9 * squared_weights)
    return square * (deviation + significance**2 / 2 * largest)


@compiled(_READ_SUMS, _NUMBERS, f8)
def estimate(noise: Records, settings: Records, given: float) -> Estimate:
    """Return the variance of the noise [rad^2], given the sums and a prior variance.

    Also returns a lower bound of this variance, the recent total variance, the persistent variance
    of all rotors and that near the wall [rad^2], and the degrees of freedom [1].
    """
    sums, significance = noise[0], settings[0]['significance']
    freedoms, recent = sums['freedoms'], sums['recent_freedoms']
    total = sums['squares'] / freedoms if freedoms else 0.0
    scatter = sums['recent_squares'] / recent if recent else 0.0
    bound = _noise_bound(total, sums['pairs'], 1.0, significance)
    significant = sums['products'] > bound and bound > 0
    persistent = sums['products'] / sums['pairs'] if significant else 0.0
    wall_bound = _noise_bound(total, sums['wall_squared_weights'], 0.25, significance)
    excess = sums['wall'] / sums['wall_weights'] if sums['wall'] > wall_bound else 0.0
    white = max(total - persistent, settings[0]['least_noise'] ** 2)
    margin = 1 + significance * math.sqrt(2 / max(freedoms, 1.0))
    variance = white if white > given * margin else given
    most = (sums['products'] + bound) / sums['pairs'] if sums['pairs'] else total
    least = variance if given else max(total - most, 0.0)
    return variance, least, scatter, persistent, excess, freedoms


@compiled(_SUMS, _NUMBERS, f8, i8, f8, i8, const_f8_1d)
def learn(
    noise: Records,
    settings: Records,
    given: float,
    freedoms: int,
    squares: float,
    pairs: int,
    products: Array,
) -> Estimate:
    """Add the residuals of a frame to the sums; return the `estimate`.

    The residuals have a number of degrees of freedom and a sum of squares [rad^2]. `pairs` is the
    number of rotors in `products_in_time`, 0 in the first two frames.
    """
    sums, numbers = noise[0], settings[0]
    fade = 1 - 1 / numbers['memory']
    sums['squares'] = fade * sums['squares'] + squares
    sums['freedoms'] = fade * sums['freedoms'] + freedoms
    recent = math.exp(-1 / numbers['recent_frames'])
    sums['recent_squares'] = recent * sums['recent_squares'] + squares
    sums['recent_freedoms'] = recent * sums['recent_freedoms'] + freedoms
    if pairs:
        total, wall, weights, squared = products[0], products[1], products[2], products[3]
        sums['products'] = fade * sums['products'] + total
        sums['pairs'] = fade * sums['pairs'] + pairs
        sums['wall'] = fade * sums['wall'] + wall
        sums['wall_weights'] = fade * sums['wall_weights'] + weights
        sums['wall_squared_weights'] = fade**2 * sums['wall_squared_weights'] + squared
    return estimate(noise, settings, given)


class FrameNoise:
    """Noise of the angles, separated from persistent residuals.

    Noise is independent from frame to frame, so that the product of the residuals of a rotor in
    two frames has mean 0. Waves, deviations and offsets persist: their mean square is c_0 = (4 c_1
    - c_2) / 3, extrapolated from the products of frames one and two apart.
    """

    def __init__(self, given: float | None, settings: NoiseSettings = DEFAULTS.noise) -> None:
        """Start without frames, with a given standard deviation [rad] or None."""
        self._settings = settings.record
        self._given = 0.0 if given is None else given**2
        self._sums, self._products = np.zeros(1, NOISE), np.zeros(4)
        self._freedoms = 0.0
        self.variance = self._given
        self.least = 0.0
        """Lower bound of the variance of the noise [rad^2]; 0 after the first frame."""
        self._earlier: tuple[LinearisedMeasurement, ...] = ()
        self.discard_persistence()

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise in use [rad]."""
        return math.sqrt(self.variance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the variance; infinite if it is given."""
        return math.inf if self.variance == self._given else max(self._freedoms, 1.0)

    def update(self, view: LinearisedMeasurement) -> None:
        """Update with the residuals of a frame."""
        pairs = 0
        if len(self._earlier) == 2:
            oldest, older = self._earlier
            pairs = min(each.degrees_of_freedom for each in (oldest, older, view))
            products_in_time(
                oldest.inlying,
                older.inlying,
                view.inlying,
                view.tangent,
                view.first,
                self._products,
            )
        self._earlier = *self._earlier[-1:], view
        self._set(
            learn(
                self._sums,
                self._settings,
                self._given,
                view.degrees_of_freedom,
                view.squares,
                pairs,
                self._products,
            )
        )

    def discard_persistence(self) -> None:
        """Discard the products but keep the noise, for example after finding an offset."""
        self._earlier = ()
        self._sums['squares'] = self.variance * self._freedoms
        for name in PAIRS:
            self._sums[name] = 0.0
        self._set(estimate(self._sums, self._settings, self._given))

    def _set(self, found: Estimate) -> None:
        self.variance, self.least, self.scatter, self.persistent, self.excess, self._freedoms = (
            found
        )


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, f8)
def median_change(first: Array, second: Array, third: Array, ratio: float) -> float:
    """Return the median of |r_1 - (1 + q) r_2 + q r_3| over known rotors, NaN without any."""
    changes, known = np.empty(first.size), 0
    for n in range(first.size):
        change = abs(first[n] - (1 + ratio) * second[n] + ratio * third[n])
        if change < math.inf:
            changes[known] = change
            known += 1
    return float(np.median(changes[:known])) if known else math.nan


class RateNoise:
    """Standard deviation of the noise of rates, from second differences in time.

    Let three frames be dt_1 and dt_2 apart, and q = dt_1 / dt_2. White noise of the rates r causes
    a variance (1 + (1 + q)^2 + q^2) sigma^2 of r_1 - (1 + q) r_2 + q r_3. A phonon of angular
    frequency w contributes only (w dt)^4 / 2 of its squared amplitude at equal intervals. The
    median over the rotors, with a bias of 1 / (3 N), excludes the rotors in a wall. Frames further
    apart than 0.5 / w of the fastest phonon cannot separate noise from phonons.
    """

    def __init__(self, chain: Chain, settings: NoiseSettings = DEFAULTS.noise) -> None:
        self._memory = settings.memory
        self._longest = 0.5 / band_edges(chain)[1]
        self.restart()

    def restart(self) -> None:
        """Discard all frames."""
        self._median, self._frames = 0.0, 0
        self._rows: list[tuple[float, Array]] = []

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [rad/s], NaN if unknown."""
        return DEVIATION_PER_MEDIAN * self._median if self._frames else math.nan

    def update(self, time: float, rates: Array) -> None:
        """Add the rates [rad/s] of an instant [s], shape (N,), NaN if unknown."""
        self._rows = [*self._rows[-2:], (time, np.ascontiguousarray(rates, dtype=np.float64))]
        if len(self._rows) < 3:
            return
        (start, first), (middle, second), (_, third) = self._rows
        if max(middle - start, time - middle) > self._longest:
            return
        ratio = (middle - start) / (time - middle)
        change = median_change(first, second, third, ratio)
        if math.isnan(change):
            return
        change /= math.sqrt(1 + (1 + ratio) ** 2 + ratio**2)
        self._frames = int(min(self._frames + 1, self._memory))
        self._median += (change - self._median) / self._frames


class StampJitter:
    """Variance of the error of stamps, from second differences of measured arcs.

    A stamp error e shifts a wall of rate w by w e. Let three measurements be dt_1 and dt_2 apart,
    and q = dt_2 / dt_1. White errors of variance v cause a variance v_3 + (1 + q)^2 v_2 + q^2 v_1
    of z_3 - (1 + q) z_2 + q z_1. The excess over this variance, weighted by w^2, is the jitter.
    """

    def __init__(self, settings: NoiseSettings = DEFAULTS.noise) -> None:
        self._fade, self._significance = 1 - 1 / settings.memory, settings.significance
        self.restart()

    def restart(self) -> None:
        """Discard all frames."""
        self._rows: tuple[tuple[float, float, float], ...] = ()
        self._excess = self._weight = self._chance = 0.0
        self.variance = 0.0
        """Variance of the error of a stamp [s^2]; 0 if it is not significant."""

    def update(self, time: float, arc: float, variance: float, rate: float) -> None:
        """Add an arc [rad] measured at a stamp [s], its variance [rad^2] and the rate [rad/s]."""
        self._rows = *self._rows[-2:], (time, arc, variance)
        if len(self._rows) < 3:
            return
        (start, first, v1), (middle, second, v2), (_, third, v3) = self._rows
        ratio = (time - middle) / (middle - start)
        unit, square = 1 + (1 + ratio) ** 2 + ratio**2, rate * rate
        expected = (v3 + (1 + ratio) ** 2 * v2 + ratio**2 * v1) / unit
        change = (third - (1 + ratio) * second + ratio * first) ** 2 / unit
        known = expected + square * self.variance
        # Limit the effect of impulses and wrong readings, because they are no stamp errors.
        change = min(change, _LARGEST_CHANGE * known)
        self._excess = self._fade * self._excess + square * (change - expected)
        self._weight = self._fade * self._weight + square * square
        # Second differences of successive frames are correlated.
        self._chance = self._fade * self._chance + 6 * (square * expected) ** 2
        significant = self._excess > self._significance * math.sqrt(self._chance)
        self.variance = self._excess / self._weight if significant else 0.0


class ResidualVariance:
    """Variance of the deviation of a rotor from the orbit due to noise, waves and springs."""

    def __init__(self, swing: float, noise: float | None, settings: EstimationSettings) -> None:
        """Start with the swing of a rotor in a wall [rad] and the noise [rad], None if unknown."""
        given = settings.likelihood
        self._given_noise, self._settings = noise, settings
        self.elastic = (given.elastic_share * swing) ** 2
        """Prior variance from the deformation of a wall by its springs [rad^2]."""
        self.largest_field = (given.field_share * swing) ** 2
        """Largest variance without the noise [rad^2]."""
        self.restart()

    def restart(self) -> None:
        """Discard all frames."""
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.way = math.inf
        """Displacement of the wall since the last frame [rotor spacings]."""
        self.frames = 0
        """Number of frames of the current wall."""
        self.at_edge = False
        """Whether springs exchange energy with the wall at an edge."""

    def start(self, view: LinearisedMeasurement) -> None:
        """Restart with the first frame of a wall; the displacement is kept."""
        self.frames = 0
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.noise.update(view)

    def learn(self, view: LinearisedMeasurement) -> None:
        """Update with a frame."""
        self.noise.update(view)
        self.frames += 1

    def of_rotor(self) -> float:
        """Return the variance of a rotor about the orbit [rad^2]: noise, waves and springs.

        The deformation by springs depends on the displacement since the last frame.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, 0.0) + _FIELD_RATIO * noise.excess
        unknown = math.exp(-self.frames / self._settings.tracking.settled)
        exchange = _EDGE_RATIO if self.at_edge else 1.0
        field += self.elastic * exchange * max(min(self.way, 1.0), unknown)
        return noise.variance + min(field, self.largest_field)

    def of_arc(self, view: LinearisedMeasurement) -> float:
        """Return the variance of a measured arc [rad^2].

        If rotors are unseen, persistent residuals shift the nearest point until the wall has
        passed a rotor; rotors without weight shift it in this frame only.
        """
        known = max(view.full_information, view.information)
        unseen, outliers = max(1 / known - 1, 0.0), 1 / view.information - 1 / known
        noise, frames = self.noise, 1 / max(self.way, 1e-9)
        field = noise.excess + (self.elastic if self.at_edge else 0.0)
        persistent = field * unseen * view.unseen_share
        persistent *= min(max(frames, 1.0), self._settings.noise.memory)
        fleeting = max(noise.scatter - noise.variance, field) * outliers
        return noise.variance / view.information + persistent + fleeting

    def calm(self, rate: float) -> float:
        """Return the confidence, from 0 to 1, that waves do not disturb a wall with this arc rate.

        Waves of amplitude phi change the rate w of a wall by about phi / w relative to it, in the
        time unit of the chain. A large ratio to the noise means that the waves are certain.
        """
        noise = self.noise
        field = max(noise.scatter - noise.variance, noise.excess, 0.0)
        steady = rate**2 * noise.variance
        disturbed = self._settings.tracking.wave_weight * field * (noise.variance + field)
        return steady / (steady + disturbed) if disturbed else 1.0
