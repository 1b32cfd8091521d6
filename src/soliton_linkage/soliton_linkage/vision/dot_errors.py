# SPDX-License-Identifier: Apache-2.0
"""Errors of dots beyond pixel noise: compression, repeated pixels and the dead zone of a video.

Compression removes noise from similar pixels and adds errors that are correlated between pixels. A
mass stays on a circle around its pivot. A change of its distance from the pivot is therefore an
error, and the error along the circle is assumed to be equally large. In compressed pictures,
moving dots have larger errors than resting dots.

A video codec stores only those changes of a picture that exceed a threshold. Elsewhere the codec
repeats the pixels of the previous picture exactly. Without a codec, camera noise prevents exact
repetition. A repeated dot is not a new measurement, because the mass may have moved by up to the
threshold since the last update of the dot. At the next update, the dot jumps along its circle by
this error. If some dots are repeated while others move, the video has a dead zone, in which slow
motion is invisible.

In a video with a dead zone, the errors are estimated from dots that move so fast that every
picture updates them. The sixth divided difference of the angles in seven pictures contains only
errors, because slow motions and typical waves do not contribute. This difference also reduces
errors that are correlated between pictures. The reduction factor is measured for the lengths of
the rotors, whose errors are known with and without the difference, and is assumed to be the same
for angles.

Let s^2 be the variance of resting dots, e^2 the variance of moving dots, and t the typical number
of pictures in which a dot is repeated. A dot that was repeated in n pictures has the variance

    s^2 + (e^2 - s^2) / (1 + n / t).

The variance decreases with n, because a dot that is repeated often probably moves slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.opencv import Picture

MEMORY = 300
"""Number of pictures after which the weight of a value in the statistics has decreased to 1/e
[1]."""
_PRIOR_WEIGHT = 30.0
"""Weight of the expected mean square, as a number of values [1]."""
_MAX_VALUE = 5.0
"""Limit of a value, relative to the root mean square [1]. A larger value probably belongs to
another dot."""
_MOVING = 0.1
"""Threshold of the displacement between two pictures [pixels]: a dot counts as moving if its
displacement is larger. The threshold is ten times the noise."""
_ORDER = 6
"""Order of the divided difference [1]. The difference reduces waves with a tenth of the picture
rate to a thousandth, and errors that last for two pictures to a half."""
_RECORDED_STEP = 0.4
"""Threshold of the displacement between two pictures [pixels]: every usable video updates a dot if
its displacement is larger. The threshold is several times the errors of good videos."""


def _faded(total: float) -> float:
    """Return the value to which a sum over pictures fades until the next picture."""
    return total * (1 - 1 / MEMORY)


class FadingMeanSquare:
    """Mean square of values, with weights that decrease exponentially from picture to picture."""

    def __init__(self) -> None:
        self._squares = self._count = 0.0

    def add(self, values: Array, expected: float = 1.0) -> None:
        """Add the values of a picture, shape (K,).

        Values far above the mean square are ignored. `expected` is the mean square that is
        expected before there are values.
        """
        valid = values[np.isfinite(values)]
        valid = valid[valid**2 < _MAX_VALUE**2 * self.value(expected)]
        self._squares = _faded(self._squares) + float(valid @ valid)
        self._count = _faded(self._count) + len(valid)

    def add_weighted(self, values: Array, weights: Array) -> None:
        """Add the values of a picture with weights, (K,) each.

        A weight is a number of pictures. Large values are reduced to `_MAX_VALUE`.
        """
        squares = np.minimum(values**2, _MAX_VALUE**2 * self.value())
        self._squares = _faded(self._squares) + float(weights @ squares)
        self._count = _faded(self._count) + float(weights.sum())

    def value(self, expected: float = 1.0) -> float:
        """Return the weighted mean of the added squares and the expected mean square."""
        return (self._squares + _PRIOR_WEIGHT * expected) / (self._count + _PRIOR_WEIGHT)


class RepeatDetector:
    """Comparison of the pixels of dots in each picture with those in the previous picture."""

    def __init__(self) -> None:
        self._before: Picture | None = None

    def compare(self, grey: Picture, centres: Array, radius: float) -> NDArray[np.bool_]:
        """Return which dots have exactly the same pixels as in the previous picture, shape (N,).

        A dot consists of the pixels within a radius [pixels] of its centre. `centres` [pixels]
        have the shape (N, 2). The centre of a hidden dot is NaN.
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
    """Measurements of the dots of N masses in a picture.

    Each array has the shape (N,). Values of hidden dots are NaN.
    """

    time: float
    """Time of the angles [s]."""
    angles: Array
    """Measured angles [rad]."""
    noise: Array
    """Standard deviations of the angles due to pixel noise [rad]."""
    length_errors: Array
    """Errors of the distances from the pivots, over their standard deviations by pixel noise
    [1]."""
    pixels_per_radian: Array
    """Displacements of the centres per change of the angles [pixels/rad]."""
    displacements: Array
    """Displacements since the previous picture [pixels]."""
    repeated: NDArray[np.bool_]
    """Whether each dot has exactly the same pixels as in the previous picture."""


class ErrorScale:
    """Ratios of the errors of dots to the errors due to pixel noise, from the pictures so far."""

    def __init__(self, rotors: int) -> None:
        self._resting, self._moving, self._jumps = (FadingMeanSquare() for _ in range(3))
        self._dead_zone = DeadZone(rotors)
        self._repeats, self._before = np.zeros(rotors), np.full(rotors, np.nan)

    def update(self, dots: DotMeasurements) -> Array:
        """Add a picture; return the ratio of each error to the error due to pixel noise, (N,)."""
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
        """Add the jumps of the dots that were repeated before and are updated in this picture."""
        jumps = (dots.angles - self._before) / dots.noise
        ended = (self._repeats > 0) & ~dots.repeated & np.isfinite(jumps)
        self._jumps.add_weighted(jumps[ended], self._repeats[ended])
        self._repeats = np.where(dots.repeated, self._repeats + 1, 0.0)
        self._before = dots.angles


class DeadZone:
    """Errors of the angles of dots in a video with a dead zone."""

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
        """Whether the video has a dead zone: recently some dots were repeated, others updated."""
        return self._since < MEMORY

    def add_repeated(self, repeated: NDArray[np.bool_], seen: NDArray[np.bool_]) -> None:
        """Add a picture: which dots are repeated and which are visible, shape (N,) each."""
        ended = self._repeats[(self._repeats > 0) & ~repeated & seen]
        self._log_repeats = _faded(self._log_repeats) + float(np.log(ended).sum())
        self._ended = _faded(self._ended) + len(ended)
        self._repeats = np.where(repeated, self._repeats + 1, 0.0)
        self._since = 0 if repeated.any() and (seen & ~repeated).any() else self._since + 1

    def add(self, dots: DotMeasurements, jumps: float) -> None:
        """Add the errors of a picture.

        `jumps` is the mean square of the jumps of repeated dots, relative to the variance due to
        pixel noise [1]. It is the expected variance before dots have moved.
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
        """Return the ratios of error variances to the variances due to pixel noise [1], (N,).

        `resting` and `jumps` are such ratios of resting dots and of repeated dots.
        """
        along = self._along.value(jumps)
        along *= max(1.0, self._across.value() / self._across_difference.value())
        usual = math.exp(self._log_repeats / max(self._ended, 1.0))
        return resting + max(along - resting, 0.0) / (1 + self._repeats / usual)


def _difference_weights(times: Array) -> Array:
    """Return the weights of the divided difference of values at times, shape (T,).

    The sum of the squared weights is 1.
    """
    apart = times[:, None] - times
    np.fill_diagonal(apart, times[-1] - times[0])
    weights = 1 / np.prod(apart / (times[-1] - times[0]), axis=1)
    return np.asarray(weights / np.linalg.norm(weights))
