# SPDX-License-Identifier: Apache-2.0
"""Constant offsets of encoders, estimated from the residuals of rotors far from the wall.

The residual of a rotor is its reading minus its angle on the orbit. Far from the wall it is
assumed to be x = o + side * delta + noise, where o is the offset of the encoder. The side is +1
for rotors before the wall (from rotor 0 to the wall) and -1 for rotors beyond the wall. Therefore,
o and delta of a rotor can be estimated separately only after the wall has passed this rotor.

An error of the rest angle causes delta: if the true rest angle of an upright flipper exceeds the
specified one by D, delta is D for rotors 0, 2, ... and -D for the others. If the flipper is upside
down, the signs are opposite. In a spinner, an error of the rest angle shifts a rotor equally on
both sides of the wall, and cannot be separated from o.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.noise import (
    DEVIATION_PER_MEDIAN,
    FREEDOMS_OF_MEDIAN,
    median,
    robust_deviation,
)
from soliton_linkage.estimation.settings import DEFAULTS, LEAST_NOISE, OffsetSettings
from soliton_linkage.linear.bands import penetration_depth, tail_ratio
from soliton_linkage.linkage.chain import Array, Chain

_DEPTHS_BESIDE = 3.0
"""A rotor counts as far from the wall if its distance is above one rotor spacing plus this number
of penetration depths [1]."""
_FEWEST_MEANS = 5
"""Least number of mean residuals, one per block of frames, that are required to correct an
encoder offset or to estimate the common error of the rest angles [1]."""
_WAVE_TIME = 10.0
"""Assumed correlation time of waves [time units of the chain]."""
_LEAST_DISTANCE = 0.01
"""An encoder is doubtful if the absolute mean residual of its rotor exceeds a limit by more than
this [rad]. The limit is `OffsetSettings.significance` times a robust standard deviation of the
mean residuals of all rotors."""
_CONTRADICTION = 0.3
"""The correction of a rotor near the wall counts as wrong if the corrected residual has the
opposite sign of the correction and exceeds this fraction of the correction [1]. Margins for noise
and for the speed of the wall are added to this limit."""
EDGE_ROTORS = 2.0
"""A wall whose distance from an edge is below this may have another shape than on the orbit [rotor
spacings], because its reflection at the edge extends springs."""
_MOST_STUCK = 0.2
"""The chain counts as at rest if more than this share of the readings differs by at most
`LEAST_NOISE` from the reading of the same encoder one block earlier [1]."""


class EncoderOffsets:
    """Maximum-a-posteriori estimator of o and delta of each rotor, with normal priors.

    The module docstring defines the offset o of an encoder, and delta.
    """

    def __init__(self, number_of_rotors: int, settings: OffsetSettings = DEFAULTS.offsets) -> None:
        self.settings = settings
        rotors = number_of_rotors
        self.means = np.zeros(rotors)
        """Number of blocks from which each offset is estimated [1], shape (N,)."""
        self.weights, self.sums = np.zeros((2, rotors)), np.zeros((2, rotors))
        """Sums of the weights [1/rad^2] and of the weighted residuals [1/rad] of each rotor, shape
        (2, N) each. Row 0 is for blocks in which the rotor was before the wall, and row 1 for
        blocks in which it was beyond the wall."""
        self.update(np.full(rotors, np.nan), np.zeros(rotors), 1.0)

    def update(
        self,
        residuals: Array,
        sides: Array,
        variance: float | Array,
        persistent: float | Array = 0.0,
    ) -> None:
        """Update the offsets with the residuals of a block [rad], shape (N,), NaN if unknown.

        `sides` [1], shape (N,), is +1 for a rotor before the wall, -1 for a rotor beyond the wall,
        and 0 for a rotor near the wall, whose residual is ignored. `variance` is the variance of a
        residual due to noise and waves, and `persistent` the variance due to errors that are equal
        in all blocks [rad^2]; each is a number or has shape (N,).
        """
        given = self.settings
        known = np.isfinite(residuals)
        self.means += known & (sides != 0)
        seen = np.array([known & (sides > 0), known & (sides < 0)])
        self.weights += seen * (1 / variance)
        self.sums += np.where(seen, residuals / variance, 0.0)
        (before, beyond), (one, other) = self.weights, self.sums
        # The prior of an offset has the variance pi^2 / 3 of a uniform distribution on the circle.
        of_offset = before + beyond + 3 / math.pi**2
        of_rest = before + beyond + given.rest_angle_deviation**-2
        mixed, total, apart = before - beyond, one + other, one - other
        determinant = of_offset * of_rest - mixed * mixed
        self.values: Array = (of_rest * total - mixed * apart) / determinant
        """Estimated offset of each encoder [rad], shape (N,)."""
        self.rest_angles: Array = (of_offset * apart - mixed * total) / determinant
        """Estimated delta of each rotor [rad], shape (N,)."""
        self._covariance = of_rest / determinant, -mixed / determinant, of_offset / determinant
        self.deviations: Array = np.sqrt(self._covariance[0] + persistent)
        """Standard deviation of each estimated offset [rad], shape (N,)."""
        significant = np.abs(self.values) > given.significance * self.deviations
        confirmed = significant & (self.means >= _FEWEST_MEANS)
        self.corrections: Array = np.where(confirmed, self.values, 0.0)
        """Offset to subtract from each angle [rad], shape (N,); 0 if not significant."""

    def predict(self, sides: Array) -> tuple[Array, Array]:
        """Return the predicted mean [rad] and variance [rad^2] of each residual, shape (N,) each.

        `sides` are as in `update`.
        """
        of_offset, mixed, of_rest = self._covariance
        expected = self.values + sides * self.rest_angles
        return expected, of_offset + sides * (2 * mixed + sides * of_rest)

    @property
    def rest_angle_error(self) -> float:
        """Estimate of D, the common error of the rest angles [rad]; 0 if insignificant.

        The module docstring defines D. In a chain that is upside down, the result is -D.
        """
        signs = np.where(np.arange(len(self.means)) % 2, -1.0, 1.0) * np.array([[1.0], [-1.0]])
        seen = self.weights > 0
        errors = (signs * self.sums)[seen] / self.weights[seen]
        if len(errors) < _FEWEST_MEANS:
            return 0.0
        error = float(np.median(errors))
        chance = robust_deviation(np.abs(errors - error)) / math.sqrt(len(errors))
        return error if abs(error) > self.settings.significance * chance else 0.0

    def limit_weights(self, variances: Array) -> None:
        """Reduce the weights of all earlier blocks of a rotor by the same factor.

        The mean weight of these blocks is then at most 1 / `variances` [1/rad^2]. `variances`
        [rad^2] have shape (N,).
        """
        kept = 1 / np.maximum(self.weights * variances / np.maximum(self.means, 1), 1.0)
        self.weights *= kept
        self.sums *= kept

    def retest(self, rotors: Flags, errors: Array) -> None:
        """Reduce the weights of all earlier residuals of the rotors that are flagged in `rotors`.

        The weights decrease more if the errors are larger. `errors` [rad], shape (N,), are the
        latest residuals minus the predicted residuals.
        """
        self.means[rotors] = np.minimum(self.means[rotors], _FEWEST_MEANS) - 1
        kept = 1 / np.maximum(self.weights[:, rotors] * errors[rotors] ** 2, 1.0)
        self.weights[:, rotors] *= kept
        self.sums[:, rotors] *= kept


class FarFieldResiduals:
    """Mean residuals, over blocks of frames, of the rotors far from the wall."""

    def __init__(self, offsets: EncoderOffsets, chain: Chain, strong: float) -> None:
        """Start without frames.

        In waves, the residuals differ strongly from the predicted residuals, and also from those
        of the preceding block. A block is ignored if both mean squared differences are above
        `strong` [rad^2].
        """
        self._offsets, self._settings = offsets, offsets.settings
        self._margin = 1 + _DEPTHS_BESIDE * penetration_depth(chain) / chain.spacing
        self._tail, self._time_unit, self._strong = tail_ratio(chain), chain.time_unit, strong
        rotors = chain.number_of_rotors
        self._sums, self._apart, self._beside = np.zeros((3, rotors))
        self._read, self._means, self._residuals = np.full((3, rotors), np.nan)
        self._uneven, self._first = False, True
        self._unsteady, self._changes = np.zeros((2, rotors))
        self._far = np.zeros(rotors, dtype=np.bool_)
        self.disorder = 0.0
        """Standard deviation of the angles due to unmodelled disorder of the chain [rad]."""
        self.stuck = np.zeros(rotors, dtype=np.bool_)
        self.doubtful = np.zeros(rotors, dtype=np.bool_)
        self._outlying: Flags | None = None
        self.restart()

    def restart(self) -> None:
        """Discard the current block of frames and start a new one."""
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
        """Add the residuals of a frame [rad], shape (N,), and return whether the block is full.

        `site` is the site of the wall [rotor spacings], `elapsed` the time since the last frame
        [s], and `variance` a lower limit of the noise variance [rad^2]. A residual that is flagged
        in `outlying` is replaced by the mean residual of the same rotor in the current block,
        unless this rotor had a similar outlier in the preceding frame.
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

    def learn(self, sign: int, variance: float) -> Iterator[None]:
        """Update the offsets with the mean residuals of the full block, and start a new block.

        `sign` is -1 if the chain is upside down, else 1; `variance` is the noise variance [rad^2].
        The work is divided into three steps, so that no frame takes all of it. The first step
        updates the offsets.
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
        # Springs deform a wall if the wall is at an edge or fast; test other walls only.
        inside = self._lowest > EDGE_ROTORS and self._highest < len(sides) - 1 - EDGE_ROTORS
        changed, self._means = means - self._means, means.copy()
        far, self._far = (sides != 0) & self._far, sides != 0
        seen_twice = far & np.isfinite(changed)
        self._changes += seen_twice
        squares = np.where(seen_twice, changed**2 / 2, self._unsteady)
        self._unsteady += (squares - self._unsteady) / np.minimum(
            np.maximum(self._changes, 1), _FEWEST_MEANS
        )
        # The residual of an oscillating rotor changes from block to block; an offset does not.
        unsteady = np.maximum(self._unsteady - 4 * noise, 0.0)
        beside = np.abs(means) - speed**2 if inside else self._beside
        self._beside = np.where(sides == 0, beside, 0.0)
        changed[np.isnan(innovations)] = np.nan
        first, self._first = self._first, False
        correlated = max(_WAVE_TIME * self._time_unit / self._time, 1.0)
        self.restart()
        if _trimmed_mean(innovations[known] ** 2) > strong:
            both = changed[np.isfinite(changed)]
            # Waves change from block to block; residuals due to deviating rotors do not.
            if not len(both) or _trimmed_mean(both**2) >= strong:
                if not first:
                    self.disorder = self._persistent_disorder()
                return
            self._uneven = True
        excess = np.maximum(np.abs(innovations[known]) - predicted[known], 0.0)
        waves = max(robust_deviation(excess) ** 2 - noise, 0.0)
        noise += waves * correlated
        # If most rotors seem to have an offset, deviations of rotors and springs are the cause.
        passed = offsets.weights[0] * offsets.weights[1] > 0
        typical = robust_deviation(np.abs(offsets.values[passed]))
        persistent = typical**2
        strange = np.abs(innovations) > given.significance * (predicted + math.sqrt(noise))
        means[strange] = np.nan
        offsets.limit_weights(unsteady * correlated)
        offsets.update(means, sides, noise + unsteady * correlated, persistent)
        if self._uneven:
            offsets.corrections[:] = 0.0
        yield
        # A wrong correction of a rotor near a slow wall shows as a residual of opposite sign.
        left, size = means - offsets.corrections, np.abs(offsets.corrections)
        against = (sides == 0) & inside & (left * offsets.corrections < 0)
        chance = given.significance * math.sqrt(noise)
        against &= np.abs(left) > _CONTRADICTION * size + speed**2 + chance
        offsets.retest(strange | against, np.where(against, left, innovations))
        expected, variances = offsets.predict(sides)
        apart = np.abs(expected) - given.significance * np.sqrt(variances + persistent)
        self._apart = np.where(sides != 0, np.maximum(apart, 0.0), self._apart * ~against)
        yield
        self.disorder = self._persistent_disorder()

    def find_doubtful(self, read: Array, outlying: Flags) -> None:
        """Update `stuck` and `doubtful` from readings [rad], shape (N,), and flags of outliers.

        `stuck` flags encoders whose readings do not change while the chain moves. `doubtful` flags
        the stuck encoders, and encoders that may have an unknown offset.
        """
        still = np.count_nonzero(np.abs(read - self._read) <= LEAST_NOISE)
        at_rest = still > _MOST_STUCK * np.count_nonzero(np.isfinite(read))
        wrong = outlying & (self._offsets.corrections == 0)
        trusted = at_rest & ~(wrong | self.stuck)
        self.stuck = (read == self._read) & ~trusted
        self._read = read.copy()
        limit = self._settings.significance * DEVIATION_PER_MEDIAN * median(self._apart.copy())
        unknown = (self._apart > limit + _LEAST_DISTANCE) & (self._offsets.corrections == 0)
        # An offset of a rotor near the wall also shifts the residuals of the neighbouring rotors.
        # Therefore exclude one rotor at a time.
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
        sides, means = self._sides(), self._sums / self._frames
        rows = np.array([np.where(sides == side, means, np.nan) for side in (1, -1)])
        return self._disorder(rows, math.sqrt(variance / self._frames))

    def _persistent_disorder(self) -> float:
        weights = self._offsets.weights
        chances = 1 / np.sqrt(weights[weights > 0])
        with np.errstate(invalid='ignore'):
            rows = self._offsets.sums / weights
        return self._disorder(rows, median(chances) if len(chances) else 0.0)

    def _disorder(self, means: Array, noise: float) -> float:
        """Return a robust estimate of the disorder [rad]; 0 if insignificant."""
        (before, beyond), tail = means, self._tail
        added = np.concatenate([before[:-1] - tail * before[1:], beyond[1:] - tail * beyond[:-1]])
        sizes = np.abs(added[np.isfinite(added)])
        freedoms = max(FREEDOMS_OF_MEDIAN * len(sizes), 3.0)
        by_noise = (1 + tail**2) * noise**2
        excess = robust_deviation(sizes) ** 2 - by_noise
        if excess <= self._settings.significance * math.sqrt(2 / freedoms) * by_noise:
            return 0.0
        return math.sqrt(excess * freedoms / (freedoms - 2))


def _trimmed_mean(squares: Array) -> float:
    """Return the mean of `squares` without the two largest; two encoders may have offsets."""
    count = len(squares) - 2
    if count <= 0:
        return 0.0
    squares.partition(count)
    return float(squares[:count].sum()) / count
