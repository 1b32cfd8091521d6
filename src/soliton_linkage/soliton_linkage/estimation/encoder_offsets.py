# SPDX-License-Identifier: Apache-2.0
"""Constant offsets of single encoders, estimated from the residuals of rotors far from the wall.

Far from the wall the residual of a rotor is x = o + side * delta + noise, with the offset o of its
encoder and the error delta of its rest angle. The side is +1 before the wall and -1 beyond it, so
that offset and rest angle are separable only after the wall has passed the rotor.
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.noise import (
    DEVIATION_PER_MEDIAN,
    FREEDOMS_OF_MEDIAN,
    median,
    robust_deviation,
)
from soliton_linkage.estimation.settings import DEFAULTS, OffsetSettings
from soliton_linkage.linear.bands import penetration_depth, tail_ratio
from soliton_linkage.linkage.chain import Array, Chain

_DEPTHS_BESIDE = 3.0
"""Least distance of far rotors from the wall [penetration depths]; tails there are below 5 %."""
_FEWEST_MEANS = 5
"""Number of block means that must confirm an offset [1]."""
_FEWEST_ROTORS = 5
"""Rotors that must confirm a common error of the rest angles [1]."""
_WAVE_TIME = 10.0
"""Correlation time of waves [time units of the chain]."""
_EVENNESS = 4e-3
"""Persistent residual of a chain without deviations, due to the motion of its wall [rad]."""
_LEAST_DISTANCE = 0.01
"""Least distance of a doubtful rotor from the orbit [rad]."""
_LEAST_ERROR = 3e-4
"""Least persistent error of a residual [rad]; smaller offsets may be rounding errors."""
_FROM_EDGE = 2.0
"""Least distance of a wall from an edge for estimates of offsets [rotor spacings]."""
_STUCK, _MOST_STUCK = 1e-5, 0.2
"""Largest change of the reading of a rotor at rest [rad]; share of such rotors above which the
chain is at rest [1]."""


class EncoderOffsets:
    """Maximum-a-posteriori encoder offsets, with normal priors of offsets and rest angles."""

    def __init__(self, number_of_rotors: int, settings: OffsetSettings = DEFAULTS.offsets) -> None:
        self.settings = settings
        rotors = number_of_rotors
        self.means = np.zeros(rotors)
        """Number of block means of each rotor [1], shape (N,)."""
        self.weights, self.sums = np.zeros((2, rotors)), np.zeros((2, rotors))
        """Weights [1/rad^2] and weighted sums [1/rad] before and beyond the wall, (2, N) each."""
        self.update(np.full(rotors, np.nan), np.zeros(rotors), 1.0)

    def update(
        self, residuals: Array, sides: Array, variance: float, persistent: float = 0.0
    ) -> None:
        """Update with the residuals of readings from the orbit [rad], shape (N,), NaN if unknown.

        Sides [1] are +1 before the wall, -1 beyond it and 0 near it, shape (N,). `variance`
        belongs to the noise, `persistent` to the error common to all frames [rad^2].
        """
        given = self.settings
        known = np.isfinite(residuals)
        self.means += known & (sides != 0)
        seen = np.array([known & (sides > 0), known & (sides < 0)])
        self.weights += seen * (1 / variance)
        self.sums += np.where(seen, residuals / variance, 0.0)
        (before, beyond), (one, other) = self.weights, self.sums
        # Priors: an offset is uniform on the circle, with the variance pi^2 / 3.
        of_offset = before + beyond + 3 / math.pi**2
        of_rest = before + beyond + given.rest_angle_deviation**-2
        mixed, total, apart = before - beyond, one + other, one - other
        determinant = of_offset * of_rest - mixed * mixed
        self.values: Array = (of_rest * total - mixed * apart) / determinant
        """Offset of each encoder [rad], shape (N,)."""
        self.rest_angles: Array = (of_offset * apart - mixed * total) / determinant
        """Error of each rest angle [rad], shape (N,)."""
        self._covariance = of_rest / determinant, -mixed / determinant, of_offset / determinant
        self.deviations: Array = np.sqrt(self._covariance[0] + persistent)
        """Standard deviation of each offset [rad], shape (N,)."""
        significant = np.abs(self.values) > given.significance * self.deviations
        confirmed = significant & (self.means >= _FEWEST_MEANS)
        self.corrections: Array = np.where(confirmed, self.values, 0.0)
        """Offset to subtract from each angle [rad], shape (N,), 0 unless significant."""

    def predict(self, sides: Array) -> tuple[Array, Array]:
        """Return the expected mean residuals on given sides [rad] and their variances [rad^2]."""
        of_offset, mixed, of_rest = self._covariance
        expected = self.values + sides * self.rest_angles
        return expected, of_offset + sides * (2 * mixed + sides * of_rest)

    @property
    def rest_angle_error(self) -> float:
        """Common error of the rest angles [rad], 0 unless significant.

        It is the median over the rotors of both sides, because offsets have no common sign there.
        """
        signs = np.where(np.arange(len(self.means)) % 2, -1.0, 1.0) * np.array([[1.0], [-1.0]])
        seen = self.weights > 0
        errors = (signs * self.sums)[seen] / self.weights[seen]
        if len(errors) < _FEWEST_ROTORS:
            return 0.0
        error = float(np.median(errors))
        chance = robust_deviation(np.abs(errors - error)) / math.sqrt(len(errors))
        return error if abs(error) > self.settings.significance * chance else 0.0

    def retest(self, rotors: Flags) -> None:
        """Require another block mean of the flagged rotors, shape (N,), before a correction."""
        self.means[rotors] = np.minimum(self.means[rotors], _FEWEST_MEANS) - 1


class FarFieldResiduals:
    """Block means of the residuals of rotors far from the wall.

    Residuals that contradict earlier blocks are excluded: the encoder may be stuck, or another
    wall near.
    """

    def __init__(self, offsets: EncoderOffsets, chain: Chain, strong: float) -> None:
        """Start without frames; blocks with a mean square above `strong` [rad^2] are ignored."""
        self._offsets, self._settings = offsets, offsets.settings
        self._margin = 1 + _DEPTHS_BESIDE * penetration_depth(chain) / chain.spacing
        self._tail, self._time_unit, self._strong = tail_ratio(chain), chain.time_unit, strong
        rotors = chain.number_of_rotors
        self._sums, self._apart, self._beside = np.zeros((3, rotors))
        self._read, self._means, self._residuals = np.full((3, rotors), np.nan)
        self._uneven, self._first = False, True
        self.disorder = 0.0
        """Standard deviation of far rotors due to unmodelled deviations [rad]. It includes all
        persistent residuals until the first block ends, or the second if the first is ignored.
        """
        self.stuck = np.zeros(rotors, dtype=np.bool_)
        self.doubtful = np.zeros(rotors, dtype=np.bool_)
        self._outlying: Flags | None = None
        self.restart()

    def restart(self) -> None:
        """Start a new block."""
        self._sums[:] = 0
        self._frames, self._time = 0, 0.0
        self._lowest, self._highest = math.inf, -math.inf

    def add(
        self,
        residuals: Array,
        outlying: Flags | None,
        site: float,
        elapsed: float,
        variance: float,
    ) -> bool:
        """Add the residuals of a frame [rad], shape (N,); return whether the block is full.

        A rotor that is an outlier for the first time, or by a different amount, counts with its
        mean so far. `elapsed` is the time since the last frame [s], `site` the position of the
        wall [rotor spacings], and `variance` a lower limit of the noise variance [rad^2].
        """
        self._sums += residuals
        if outlying is not None:
            once = outlying
            if self._outlying is not None:
                alike = np.abs(residuals - self._residuals) < 2 * math.sqrt(self._strong)
                once = outlying & ~(self._outlying & alike)
            before = self._sums[once] - residuals[once]
            self._sums[once] = before * (1 + 1 / max(self._frames, 1))
        self._outlying, self._residuals = outlying, residuals
        self._lowest, self._highest = min(self._lowest, site), max(self._highest, site)
        self._time += elapsed
        self._frames += 1
        if self._first:
            self.disorder = self._block_disorder(variance)
        return self._frames == self._settings.block

    def learn(self, sign: int, variance: float) -> None:
        """Update the offsets with the block and start a new block.

        Residuals belong to corrected angles. The sign is -1 if the chain is upside down.
        `variance` is the variance of the noise of an angle [rad^2].
        """
        offsets, given = self._offsets, self._settings
        sides = self._sides()
        expected, variances = offsets.predict(sides)
        means = sign / self._frames * self._sums + offsets.corrections
        innovations = np.where(sides != 0, means - expected, np.nan)
        predicted = np.sqrt(variances)
        known = np.isfinite(innovations)
        noise = variance / self._frames
        strong = self._strong + 4 * noise
        speed = (self._highest - self._lowest) * self._time_unit / max(self._time, 1e-12)
        # Springs exchange energy with a wall at an edge, and deform a fast wall.
        inside = self._lowest > _FROM_EDGE and self._highest < len(sides) - 1 - _FROM_EDGE
        self._beside = np.where(inside & (sides == 0), np.abs(means) - speed**2, 0.0)
        changed, self._means = means - self._means, means.copy()
        changed[np.isnan(innovations)] = np.nan
        first, self._first = self._first, False
        if _trimmed_mean(innovations[known] ** 2) > strong:
            both = changed[np.isfinite(changed)]
            # Waves change from block to block; deviations of the chain do not.
            if not len(both) or _trimmed_mean(both**2) >= strong:
                if not first:
                    self.disorder = self._persistent_disorder()
                self.restart()
                return
            self._uneven = True
        excess = np.maximum(np.abs(innovations[known]) - predicted[known], 0.0)
        waves = max(robust_deviation(excess) ** 2 - noise, 0.0)
        noise += waves * max(_WAVE_TIME * self._time_unit / self._time, 1.0)
        # If most rotors seem to have an offset, rotors and springs deviate.
        passed = (offsets.weights > 0).all(axis=0)
        persistent = _LEAST_ERROR**2 + robust_deviation(np.abs(offsets.values[passed])) ** 2
        strange = np.abs(innovations) > given.significance * (predicted + math.sqrt(noise))
        means[strange] = np.nan
        offsets.update(means, sides, noise, persistent)
        if self._uneven:
            offsets.corrections[:] = 0.0
        offsets.retest(strange)
        expected, variances = offsets.predict(sides)
        apart = np.abs(expected) - given.significance * np.sqrt(variances + persistent)
        self._apart = np.where(sides != 0, np.maximum(apart, 0.0), self._apart)
        self.disorder = self._persistent_disorder()
        self.restart()

    def find_doubtful(self, read: Array, outlying: Flags) -> None:
        """Find doubtful rotors from their readings [rad], shape (N,).

        A rotor is stuck if it repeats its reading of the previous block; if many rotors do, only
        outliers are stuck. A rotor much further from the orbit than most has an offset, which is
        unknown until the wall has passed.
        """
        still = np.count_nonzero(np.abs(read - self._read) <= _STUCK)
        at_rest = still > _MOST_STUCK * np.count_nonzero(np.isfinite(read))
        trusted = at_rest & ~(outlying | self.stuck)
        self.stuck = (read == self._read) & ~trusted
        self._read = read.copy()
        limit = self._settings.significance * DEVIATION_PER_MEDIAN * median(self._apart.copy())
        unknown = (self._apart > limit + _LEAST_DISTANCE) & (self._offsets.corrections == 0)
        # An offset near the wall also shifts the residuals of its neighbours, so exclude one at a
        # time.
        known = np.abs(self._means[np.isfinite(self._means)])
        typical = self._settings.significance * robust_deviation(known)
        beside = np.where(self._offsets.corrections == 0, self._beside, 0.0)
        found = beside > typical + _LEAST_DISTANCE
        found &= self.doubtful | (beside == beside.max())
        self.doubtful = self.stuck | ((unknown | found) & (not self._uneven))

    def _sides(self) -> Array:
        rotors = np.arange(len(self._sums))
        before = rotors < self._lowest - self._margin
        beyond = ~before & (rotors > self._highest + self._margin)
        return before.astype(np.float64) - beyond

    def _block_disorder(self, variance: float) -> float:
        """Return the disorder in the mean residuals of the current block [rad]."""
        sides, means = self._sides(), self._sums / self._frames
        rows = np.array([np.where(sides == side, means, np.nan) for side in (1, -1)])
        return self._disorder(rows, math.sqrt(variance / self._frames))

    def _persistent_disorder(self) -> float:
        """Return the disorder in the mean residuals of all blocks [rad]."""
        weights = self._offsets.weights
        chances = 1 / np.sqrt(weights[weights > 0])
        with np.errstate(invalid='ignore'):
            rows = self._offsets.sums / weights
        return self._disorder(rows, median(chances) if len(chances) else 0.0)

    def _disorder(self, means: Array, noise: float) -> float:
        """Return the disorder in mean residuals beyond tails [rad], by Student's distribution.

        It is a standard deviation, 0 unless it exceeds the noise of a mean [rad] significantly.
        Residuals before and beyond the wall have shape (2, N), NaN if unknown.
        """
        (before, beyond), tail = means, self._tail
        added = np.concatenate([before[:-1] - tail * before[1:], beyond[1:] - tail * beyond[:-1]])
        sizes = np.abs(added[np.isfinite(added)])
        freedoms = max(FREEDOMS_OF_MEDIAN * len(sizes), 3.0)
        by_noise = (1 + tail**2) * noise**2
        excess = robust_deviation(sizes) ** 2 - by_noise - _EVENNESS**2
        if excess <= self._settings.significance * math.sqrt(2 / freedoms) * by_noise:
            return 0.0
        return math.sqrt(excess * freedoms / (freedoms - 2))


def _trimmed_mean(squares: Array) -> float:
    """Return the mean [rad^2] without the two largest squares, which offsets may cause."""
    count = len(squares) - 2
    if count <= 0:
        return 0.0
    squares.partition(count)
    return float(squares[:count].mean())
