# SPDX-License-Identifier: Apache-2.0
"""Errors of dots beyond pixel noise: compression, repeated blocks and the dead zone of a video.

Compression removes noise from similar pixels and adds errors that are correlated between pixels. A
mass stays on a circle around its pivot, so that a change of its distance from the pivot is an
error. The error along the circle is assumed to be equally large. In compressed pictures, moving
dots have larger errors than resting dots.

A video codec stores only changes of a picture that exceed a threshold. Elsewhere it repeats the
pixels of the previous picture exactly; without a codec, camera noise prevents exact repetition. A
repeated dot is not a new measurement. The mass may have moved by up to the threshold since the
last update. At the next update the dot jumps along its circle by this error. If some dots are
repeated while others move, the video has a dead zone, in which slow motion is invisible. The
errors of dots that move beyond the dead zone in each picture are estimated as follows.

Along the path, the sixth divided difference of seven pictures contains only errors, because slow
    motions and typical waves do not contribute to it. This difference reduces correlated errors.
    The reduction factor is assumed to be that of the errors across the path, which are also
    measured directly.

Let s^2 be the variance of resting dots, e^2 the variance of moving dots, and t the typical number
of repeats. A dot that was repeated in n pictures has the variance

    s^2 + (e^2 - s^2) / (1 + n / t).

It decreases with n, because a dot that stays long in its dead zone probably moves slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.opencv import Picture

MEMORY = 300
"""Number of pictures after which statistics fade to 1/e [1]."""
_PRIOR_WEIGHT = 30.0
"""Weight of the expected mean square, in values [1]."""
_MAX_VALUE = 5.0
"""Limit of a value, in root mean squares [1]; larger values belong to another dot."""
_MOVING = 0.1
"""Displacement between two pictures above which a dot moves [pixels], ten times the noise."""
_ORDER = 6
"""Order of the divided difference [1]. It reduces waves of a tenth of the picture rate to a
thousandth, and errors that last for two pictures to a half."""
_RECORDED_STEP = 0.4
"""Displacement between two pictures above which every usable video updates a dot [pixels], several
times the errors of good videos."""


def _faded(total: float) -> float:
    """Return the fading sum of pictures, one picture later."""
    return total * (1 - 1 / MEMORY)


class FadingMeanSquare:
    """Mean square of values over the pictures, with an exponentially fading memory."""

    def __init__(self) -> None:
        self._squares = self._count = 0.0

    def add(self, values: Array, expected: float = 1.0) -> None:
        """Add the values of a picture, shape (K,), with an expected mean square."""
        valid = values[np.isfinite(values)]
        valid = valid[valid**2 < _MAX_VALUE**2 * self.value(expected)]
        self._squares = _faded(self._squares) + float(valid @ valid)
        self._count = _faded(self._count) + len(valid)

    def add_weighted(self, values: Array, weights: Array) -> None:
        """Add values with weights in pictures, (K,) each, clipped to `_MAX_VALUE`."""
        squares = np.minimum(values**2, _MAX_VALUE**2 * self.value())
        self._squares = _faded(self._squares) + float(weights @ squares)
        self._count = _faded(self._count) + float(weights.sum())

    def value(self, expected: float = 1.0) -> float:
        """Return the mean square of the added values and the expected one."""
        return (self._squares + _PRIOR_WEIGHT * expected) / (self._count + _PRIOR_WEIGHT)


class RepeatDetector:
    """Comparison of the dots of each picture with the previous picture."""

    def __init__(self) -> None:
        self._before: Picture | None = None

    def compare(self, grey: Picture, centres: Array, radius: float) -> NDArray[np.bool_]:
        """Return which dots have exactly the pixels of the previous picture, shape (N,).

        Compares the pixels within a radius [pixels] of the centres [pixels], (N, 2). Centres are
        NaN for hidden dots.
        """
        before, self._before = self._before, grey.copy()
        repeated = np.zeros(len(centres), dtype=bool)
        if before is None:
            return repeated
        half = math.ceil(radius)
        for rotor in np.flatnonzero(np.isfinite(centres[:, 0])):
            column, row = np.rint(centres[rotor]).astype(int)
            rows = slice(max(row - half, 0), row + half + 1)
            columns = slice(max(column - half, 0), column + half + 1)
            repeated[rotor] = np.array_equal(grey[rows, columns], before[rows, columns])
        return repeated


@dataclass(frozen=True)
class DotMeasurements:
    """Measurements of the dots of N masses in a picture, NaN if hidden, shape (N,) each."""

    time: float
    """Time of the angles [s]."""
    angles: Array
    """Actual angles [rad]."""
    noise: Array
    """Standard deviations of the angles from pixel noise [rad]."""
    length_errors: Array
    """Errors of the distances from the pivots, relative to the errors from pixel noise [1]."""
    pixels_per_radian: Array
    """Derivatives of the centres by the angles [pixels/rad]."""
    displacements: Array
    """Displacements since the previous picture [pixels]."""
    repeated: NDArray[np.bool_]
    """Whether the dot has exactly the pixels of the previous picture."""


class ErrorScale:
    """Ratios of the errors of dots to the errors from pixel noise, estimated from the pictures."""

    def __init__(self, rotors: int) -> None:
        self._resting, self._moving, self._jumps = (FadingMeanSquare() for _ in range(3))
        self._dead_zone = DeadZone(rotors)
        self._repeats, self._before = np.zeros(rotors), np.full(rotors, np.nan)

    def update(self, dots: DotMeasurements) -> Array:
        """Return the ratios of the standard deviations to those from pixel noise, shape (N,)."""
        moving = dots.displacements > _MOVING
        self._resting.add(dots.length_errors[~dots.repeated & ~moving])
        self._moving.add(dots.length_errors[~dots.repeated & moving])
        self._add_jumps(dots)
        jumps, resting = self._jumps.value(), self._resting.value()
        self._dead_zone.add_repeated(dots.repeated, np.isfinite(dots.angles))
        self._dead_zone.add(dots, jumps)
        if self._dead_zone.present:
            return np.sqrt(self._dead_zone.variances(resting, jumps))
        updated = np.where(moving, self._moving.value(), resting)
        return np.sqrt(np.where(dots.repeated, jumps, updated))

    def _add_jumps(self, dots: DotMeasurements) -> None:
        """Add the jumps of dots that were repeated and are now updated."""
        jumps = (dots.angles - self._before) / dots.noise
        ended = (self._repeats > 0) & ~dots.repeated & np.isfinite(jumps)
        self._jumps.add_weighted(jumps[ended], self._repeats[ended])
        self._repeats = np.where(dots.repeated, self._repeats + 1, 0.0)
        self._before = dots.angles


class DeadZone:
    """Errors of dots along their paths in a video with a dead zone."""

    def __init__(self, rotors: int) -> None:
        self._times = np.full(_ORDER + 1, np.nan)
        self._angles = np.full((_ORDER + 1, rotors), np.nan)
        self._length_errors = np.full((_ORDER + 1, rotors), np.nan)
        self._along, self._across, self._across_difference = (FadingMeanSquare() for _ in range(3))
        self._repeats = np.zeros(rotors)
        self._log_repeats = self._ended = 0.0
        self._since = MEMORY

    @property
    def present(self) -> bool:
        """Whether some dots were recently repeated while others moved."""
        return self._since < MEMORY

    def add_repeated(self, repeated: NDArray[np.bool_], seen: NDArray[np.bool_]) -> None:
        """Add which dots of a picture were repeated and which were visible, (N,) each."""
        ended = self._repeats[(self._repeats > 0) & ~repeated & seen]
        self._log_repeats = _faded(self._log_repeats) + float(np.log(ended).sum())
        self._ended = _faded(self._ended) + len(ended)
        self._repeats = np.where(repeated, self._repeats + 1, 0.0)
        self._since = 0 if repeated.any() and (seen & ~repeated).any() else self._since + 1

    def add(self, dots: DotMeasurements, jumps: float) -> None:
        """Add the errors of a picture.

        `jumps`, the mean square of the jumps of repeated dots [1], is the expected error until
        dots move.
        """
        self._times = np.append(self._times[1:], dots.time)
        self._angles = np.vstack([self._angles[1:], dots.angles])
        self._length_errors = np.vstack([self._length_errors[1:], dots.length_errors])
        if not np.isfinite(self._times).all():
            return
        steps = np.abs(np.diff(self._angles, axis=0)) * dots.pixels_per_radian
        weights = _difference_weights(self._times)
        moving, always = steps.max(axis=0) > _RECORDED_STEP, steps.min(axis=0) > _RECORDED_STEP
        self._along.add((weights @ self._angles / dots.noise)[moving], jumps)
        self._across_difference.add((weights @ self._length_errors)[always])
        self._across.add(self._length_errors[_ORDER // 2, always])

    def variances(self, resting: float, jumps: float) -> Array:
        """Return the ratios of error variances to variances from pixel noise [1], shape (N,)."""
        along = self._along.value(jumps)
        along *= max(1.0, self._across.value() / self._across_difference.value())
        usual = math.exp(self._log_repeats / max(self._ended, 1.0))
        return resting + max(along - resting, 0.0) / (1 + self._repeats / usual)


def _difference_weights(times: Array) -> Array:
    """Return the weights, of unit norm, of the divided difference at times, shape (T,)."""
    apart = times[:, None] - times
    np.fill_diagonal(apart, times[-1] - times[0])
    weights = 1 / np.prod(apart / (times[-1] - times[0]), axis=1)
    return np.asarray(weights / np.linalg.norm(weights))
