# SPDX-License-Identifier: Apache-2.0
"""Estimators of the noise of angles, rates and time stamps, and of the variance of residuals."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import compiled, const_f8_1d, f8, i8
from soliton_linkage.estimation.measurement import LinearisedMeasurement
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings, NoiseSettings
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linkage.chain import Array, Chain

DEVIATION_PER_MEDIAN = 1.4826
"""Standard deviation of normal noise, divided by the median of its absolute values [1]."""
FREEDOMS_OF_MEDIAN = 0.368
"""Relative efficiency of the median [1]. A standard deviation from the median of n absolute values
is as accurate as a standard deviation from the mean square of this number times n values."""

_LARGEST_CHANGE = 12.0
"""`StampJitter` limits a product of second differences to this multiple of the mean absolute value
of recent products, or of their scale without stamp errors, whichever is larger [1]."""
_EDGE_RATIO = 4.0
"""Variance that the deformation of a wall adds to a residual: value at an edge, divided by the
value inside the chain [1]."""
LARGEST_EXCESS = 3.0
"""Upper limit of `FrameNoise.excess`, divided by the mean square of recent residuals [1]."""
_CORRELATION = 35 / 18
"""Variance of a mean of squared second differences of white noise, divided by the variance that it
would have if successive second differences were independent [1]: 1 + 2 ((2/3)^2 + (1/6)^2)."""
_FIELD_RATIO = 3.0
"""Assumed largest squared persistent residual near a wall, divided by `FrameNoise.excess` [1]."""


def median(values: Array) -> float:
    """Return the median of an array without NaN, and reorder the array."""
    half = len(values) // 2
    if len(values) % 2:
        values.partition(half)
        return float(values[half])
    values.partition((half - 1, half))
    return (float(values[half - 1]) + float(values[half])) / 2


def robust_deviation(sizes: Array) -> float:
    """Return the standard deviation of errors, given their absolute values; reorder `sizes`."""
    return DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, const_f8_1d, i8)
def products_in_time(
    oldest: Array, older: Array, latest: Array, tangent: Array, first: int
) -> tuple[float, float, float, float, float, int]:
    """Return the sums of p, t^2 p, f, f^2 and c^2 / 6 over the rotors near a wall, and a count.

    For a rotor, p = x (4 x' - x'') / 3 and f = t^2 (1 - t^2). Here x, x' and x'' are the residuals
    of the rotor in the latest, the older and the oldest frame [rad]. t is the component of the
    rotor in `tangent`, the tangent of the orbit, which contains the rotors from `first` on.

    The mean of p estimates the mean square of persistent residuals (see `FrameNoise`). The fit of
    the arc length reduces the mean square residual of a rotor by the factor 1 - t^2. Therefore,
    the sum of t^2 p divided by the sum of f is a mean square without this reduction.

    c = x - 2 x' + x'' is the second difference in time; the mean of c^2 / 6 is the variance of
    noise that is independent from frame to frame. The sum contains only rotors that are inliers in
    all three frames. The count is the number of the other inliers of the latest frame.
    """
    total, wall, weights, squared, second, lacking = 0.0, 0.0, 0.0, 0.0, 0.0, 0
    for n in range(tangent.size):
        before = older[first + n] * (4 / 3) - oldest[first + n] / 3
        product = latest[first + n] * before
        square = tangent[n] * tangent[n]
        weight = square - square * square
        total += product
        if older[first + n] != 0 and oldest[first + n] != 0 and latest[first + n] != 0:
            second += (latest[first + n] - 2 * older[first + n] + oldest[first + n]) ** 2 / 6
        elif latest[first + n] != 0:
            lacking += 1
        wall += square * product
        weights += weight
        squared += weight * weight
    return total, wall, weights, squared, second, lacking


class FrameNoise:
    """Estimator that separates the noise of the angles from persistent residuals.

    Noise is independent from frame to frame, whereas persistent residuals are correlated. Let c_k
    be the mean product of two residuals of the same rotor that are k frames apart. c_0 includes
    the noise. Therefore the mean square of the persistent residuals is extrapolated from c_1 and
    c_2 as (4 c_1 - c_2) / 3. If it is significant, the variance of the noise is the mean square of
    second differences in time. It has the same expected value as c_0 - (4 c_1 - c_2) / 3, but
    after few frames it is much more accurate. In all means, older frames have less weight.
    """

    def __init__(self, given: float | None, settings: NoiseSettings = DEFAULTS.noise) -> None:
        """Start with the given standard deviation of the noise [rad]; None if it is unknown."""
        self._settings = settings
        self._given = 0.0 if given is None else given**2
        self._recent_fade = math.exp(-1 / settings.recent_frames)
        self._squares = self._freedoms = self._recent_squares = self._recent_freedoms = 0.0
        self._seconds = self._complete = 0.0
        self._products = self._pairs = self._wall = self._weights = self._squared_weights = 0.0
        self._earlier: tuple[LinearisedMeasurement, ...] = ()
        self.variance = self._given
        self._estimate()

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [rad], either given or estimated."""
        return math.sqrt(self.variance)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of `variance`; infinite while it equals the given variance."""
        return math.inf if self.variance == self._given else max(self._known, 1.0)

    def update(self, view: LinearisedMeasurement) -> None:
        """Update the estimates with the residuals of a frame."""
        fade, recent = 1 - 1 / self._settings.memory, self._recent_fade
        self._squares = fade * self._squares + view.squares
        self._freedoms = fade * self._freedoms + view.degrees_of_freedom
        self._recent_squares = recent * self._recent_squares + view.squares
        self._recent_freedoms = recent * self._recent_freedoms + view.degrees_of_freedom
        if len(self._earlier) == 2:
            oldest, older = self._earlier
            total, wall, weights, squared, second, lacking = products_in_time(
                oldest.inlying, older.inlying, view.inlying, view.tangent, view.first
            )
            frames = (oldest, older, view)
            self._seconds = fade * self._seconds + second
            self._complete = fade * self._complete + max(view.degrees_of_freedom - lacking, 0)
            self._products = fade * self._products + total
            self._pairs = fade * self._pairs + min(each.degrees_of_freedom for each in frames)
            self._wall = fade * self._wall + wall
            self._weights = fade * self._weights + weights
            self._squared_weights = fade**2 * self._squared_weights + squared
        self._earlier = *self._earlier[-1:], view
        self._estimate()

    def _estimate(self) -> None:
        significance, freedoms = self._settings.significance, self._freedoms
        recent = self._recent_freedoms
        total = self._squares / freedoms if freedoms else 0.0
        self.scatter = self._recent_squares / recent if recent else 0.0
        """Mean square of the residuals in the recent frames, `NoiseSettings.recent_frames`
        [rad^2]."""
        bound = self._noise_bound(total, self._pairs, 1.0)
        significant = self._products > bound > 0
        self.persistent = self._products / self._pairs if significant else 0.0
        """Mean square of the persistent residuals of all rotors near the wall, with equal weights
        [rad^2]; 0 if not significant."""
        beside = self._wall > self._noise_bound(total, self._squared_weights, 0.25)
        excess = self._wall / self._weights if beside else 0.0
        self.excess = min(excess, LARGEST_EXCESS * self.scatter)
        """Mean square of the persistent residuals in the centre of the wall [rad^2]; 0 if not
        significant. In this mean, a rotor has the weight t^2 (see `products_in_time`)."""
        # The recent residuals contain the noise, so that a larger estimate is out of date.
        most_recent = self.scatter * (1 + significance * math.sqrt(2 / max(recent, 1.0)))
        white, self._known = total, freedoms
        if significant and self._complete:
            white = self._seconds / self._complete
            self._known = self._complete / _CORRELATION
        white = min(white, most_recent)
        white = max(white, self._settings.least_noise**2)
        margin = 1 + significance * math.sqrt(2 / max(self._known, 1.0))
        self.variance = white if white > self._given * margin else self._given
        beyond = self.scatter - self.variance
        self.waves = beyond if most_recent - self.scatter < beyond else 0.0
        """`scatter` minus the variance of the noise [rad^2]; 0 if not significant. It is the mean
        square of residuals due to waves and deformations in the recent frames. `persistent` and
        `excess` are means over many more frames."""
        most = (self._products + bound) / self._pairs if self._pairs else total
        self.least = self.variance if self._given else max(total - most, 0.0)
        """Lower bound of the variance of the noise [rad^2]; 0 while unknown."""

    def _noise_bound(self, square: float, squared_weights: float, largest: float) -> float:
        """Return an upper limit of a weighted sum of products of `products_in_time` [rad^2].

        It is Bernstein's bound if all residuals are noise with the variance `square` [rad^2]. The
        variance of a product is then 17 / 9 square^2. `squared_weights` is the sum of the squared
        weights, and `largest` is the largest weight [1].
        """
        significance = self._settings.significance
        deviation = significance * math.sqrt(17 / 9 * squared_weights)
        return square * (deviation + significance**2 / 2 * largest)


@compiled(const_f8_1d, const_f8_1d, const_f8_1d, f8)
def median_change(first: Array, second: Array, third: Array, ratio: float) -> float:
    """Return the median of |r_1 - (1 + q) r_2 + q r_3| over all rotors with known rates.

    The result is NaN if there is no such rotor. r_1, r_2 and r_3 are the rates of a rotor in three
    frames [rad/s], and q is `ratio`.
    """
    changes, known = np.empty(first.size), 0
    for n in range(first.size):
        change = abs(first[n] - (1 + ratio) * second[n] + ratio * third[n])
        if change < math.inf:
            changes[known] = change
            known += 1
    return float(np.median(changes[:known])) if known else math.nan


class RateNoise:
    """Estimator of the noise of rates, from second differences in time.

    The second difference of three successive rates of a rotor is r_1 - (1 + q) r_2 + q r_3, with
    the ratio q of the first time difference to the second. Two terms contribute to its variance:
    white noise of variance sigma^2 adds (1 + (1 + q)^2 + q^2) sigma^2, and a phonon of frequency w
    adds (w dt)^4 V^2 / 2 if both time differences are dt. V is the amplitude of the rate of the
    rotor in the phonon [rad/s]. Only frames with short time differences are used, so that the
    second term is small.
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
        """Standard deviation of the noise of a rate [rad/s], NaN if unknown."""
        return DEVIATION_PER_MEDIAN * self._median if self._frames else math.nan

    def update(self, time: float, rates: Array) -> None:
        """Add the rates at a time [s]; rates [rad/s] have shape (N,), NaN if unknown."""
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
    """Estimator of the errors of time stamps, from second differences of measured arc lengths.

    If the arc length changes at the rate w, a stamp error e shifts the measured arc length z by w
    e. Let v be the variance of these shifts. Four successive measurements have three time
    differences. Let q be the second time difference divided by the first, and q' the third divided
    by the second. The second differences z_3 - (1 + q) z_2 + q z_1 and z_4 - (1 + q') z_3 + q' z_2
    then have the mean product -v ((1 + q') + (1 + q) q').
    """

    def __init__(self, settings: NoiseSettings = DEFAULTS.noise) -> None:
        self._fade, self._significance = 1 - 1 / settings.memory, settings.significance
        self.restart()

    def restart(self) -> None:
        """Discard all measurements."""
        self._rows: tuple[tuple[float, float, float], ...] = ()
        self._excess = self._weight = self._chance = self._sizes = self._frames = 0.0
        self.variance = 0.0
        """Variance of the error of a stamp [s^2]; 0 if the error is not significant."""

    def update(self, time: float, arc: float, variance: float, rate: float) -> None:
        """Add an arc length [rad] with its stamp [s], variance [rad^2] and rate [rad/s]."""
        self._rows = *self._rows[-3:], (time, arc, variance)
        if len(self._rows) < 4:
            return
        (t1, z1, v1), (t2, z2, v2), (t3, z3, v3), (_, z4, v4) = self._rows
        one, other = (t3 - t2) / (t2 - t1), (time - t3) / (t3 - t2)
        by2, by3 = (1 + one) * other, 1 + other
        unit, square = by2 + by3, rate * rate
        expected = (by2 * v2 + by3 * v3) / unit
        # Scale of a product without stamp errors; for equal variances v at equal intervals, v.
        first, second = v3 + (1 + one) ** 2 * v2 + one**2 * v1, v4 + by3**2 * v3 + other**2 * v2
        size = 2 / 3 * math.sqrt(first * second) / unit
        changes = (z3 - (1 + one) * z2 + one * z1) * (z4 - by3 * z3 + other * z2)
        # Limit the effect of large changes; impulses or wrong readings may be their cause.
        typical = self._sizes / self._frames if self._frames else size
        largest = _LARGEST_CHANGE * max(typical, size)
        found = min(max(-changes / unit, -largest), largest)
        self._sizes = self._fade * self._sizes + min(abs(found), _LARGEST_CHANGE * typical)
        self._frames = self._fade * self._frames + 1
        # Frames that contain little information have less weight.
        weight = square * min(self._sizes / (self._frames * size), 1.0) ** 2
        self._excess = self._fade * self._excess + weight * (found - expected)
        self._weight = self._fade * self._weight + weight * square
        # The factor 6 includes the correlation between the products of successive frames.
        self._chance = self._fade**2 * self._chance + 6 * (weight * size) ** 2
        significant = self._excess > self._significance * math.sqrt(self._chance)
        self.variance = self._excess / self._weight if significant else 0.0


class ResidualVariance:
    """Estimator of the variance of a residual, due to noise, waves and deformations of walls."""

    def __init__(self, swing: float, noise: float | None, settings: EstimationSettings) -> None:
        """Start without frames; `swing` is the `rotor_swing` [rad].

        `noise` is the standard deviation of the noise of an angle [rad]; None if it is unknown.
        """
        given = settings.likelihood
        self._given_noise, self._settings = noise, settings
        self.elastic = (given.elastic_share * swing) ** 2
        """Assumed variance of a residual due to the deformation of walls by springs [rad^2]."""
        self.largest_field = (given.field_share * swing) ** 2
        """Largest variance of a residual due to waves and deformations of walls [rad^2]."""
        self.restart()

    def restart(self) -> None:
        """Discard all frames."""
        self.noise = FrameNoise(self._given_noise, self._settings.noise)
        self.way = math.inf
        """Predicted distance that the wall has moved since the last frame [rotor spacings]."""
        self.frames = 0
        """Number of frames since the current wall was acquired."""
        self.at_edge = False
        """Whether the wall is at an edge."""
        self.excluded = self._shift = 0.0
        """excluded: covariance of an error of the arc length between two successive frames
        [rad^2]. The error arises because rotors that waves deflect count as outliers and have less
        weight. _shift: this error in the latest frame [rad]."""

    def learn(self, view: LinearisedMeasurement) -> None:
        """Update the estimates with the residuals of a frame."""
        self.noise.update(view)
        self.frames += 1

    def learn_outliers(self, view: LinearisedMeasurement) -> None:
        """Update `excluded` with the outliers of a frame that shows exactly one wall."""
        earlier, self._shift = self._shift, 0.0
        if view.outliers and self.field > self.noise.variance:
            near = slice(view.first, view.first + len(view.tangent))
            ignored = np.nan_to_num((1 - view.weights[near]) * view.residuals[near])
            self._shift = float(view.tangent @ ignored)
        share = max(1 - self.noise.variance / max(self.field, 1e-30), 0.0)
        # Waves persist from frame to frame, but wrong readings do not.
        product = share * self._shift * earlier
        self.excluded += (product - self.excluded) / self._settings.noise.recent_frames

    def of_rotor(self) -> float:
        """Return the variance of the difference between a rotor's angle and the orbit [rad^2]."""
        noise = self.noise
        field = noise.waves + _FIELD_RATIO * noise.excess
        exchange = _EDGE_RATIO if self.at_edge else 1.0
        field += self.elastic * exchange * max(min(self.way, 1.0), self._unknown)
        return noise.variance + min(field, self.largest_field)

    @property
    def _unknown(self) -> float:
        return math.exp(-self.frames / self._settings.tracking.settled)

    def persistent_error(self, share: float) -> float:
        """Return the variance of an arc length due to persistent residuals near a wall [rad^2].

        `share` is the standard deviation of the arc length divided by the rms of the residuals
        [1]. The variance is larger in the first frames, when noise and persistent residuals cannot
        be separated.
        """
        bound = min(self.elastic, self.noise.scatter) * self._unknown
        return max(share**2 * self.noise.excess, bound)

    def of_arc(self, view: LinearisedMeasurement) -> float:
        """Return the variance of a measured arc length along the orbit [rad^2].

        The arc length of a chain is the arc length at the nearest point of the orbit. Therefore,
        persistent residuals of all rotors together cause no error of it. If rotors are unseen, the
        residuals of the other rotors do cause an error. This error is equal in all frames during
        which the wall moves by one rotor spacing. Its variance is multiplied by the number of
        these frames, because the filters treat errors of frames as independent.
        """
        known = max(view.full_information, view.information)
        unseen, outliers = max(1 / known - 1, 0.0), 1 / view.information - 1 / known
        noise, frames = self.noise, 1 / max(self.way, 1e-9)
        field = noise.excess + (self.elastic if self.at_edge else 0.0)
        persistent = field * unseen * view.unseen_share
        persistent *= min(max(frames, 1.0), self._settings.noise.memory)
        fleeting = max(noise.waves, field) * outliers
        return noise.variance / view.information + persistent + fleeting

    @property
    def field(self) -> float:
        """Mean square amplitude of waves near the wall [rad^2]."""
        return max(self.noise.waves, self.noise.excess)

    def allow_waves(self, motion: MultipleModelFilter, scale: float, period: float) -> float:
        """Set the acceleration by waves in `motion`; return `calm` for the rate of `motion` [1].

        `scale` is the inverse of the time unit of the chain [1/s], and `period` the period of the
        slowest phonon [s].
        """
        # Waves of amplitude x exert forces of the order x^2 on a wall.
        motion.set_wave_acceleration(self.field * scale**2, period)
        # An unknown rate is no evidence that waves disturb the wall.
        return self.calm(math.hypot(motion.expected_rate, motion.rate_deviation) / scale)

    def calm(self, rate: float) -> float:
        """Return the weight, 0 to 1, of the assumption that waves do not disturb the wall.

        `rate` is the rate of the arc length [rad per time unit of the chain]. In one time unit,
        waves with the amplitude phi [rad] change the rate by about the fraction phi / rate.
        """
        noise, field = self.noise, self.field
        steady = rate**2 * noise.variance
        disturbed = self._settings.tracking.wave_weight * field * (noise.variance + field)
        return steady / (steady + disturbed) if disturbed else 1.0
