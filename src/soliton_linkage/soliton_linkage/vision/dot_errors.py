# SPDX-License-Identifier: Apache-2.0
"""Position errors of dots in videos, in particular if compression suppresses small motions.

A mass stays on a circle around its pivot. Changes of its distance from the pivot are therefore
errors, and errors along the circle are assumed to be equally large.

Where the picture changes by less than a threshold, a codec repeats the pixels of the previous
picture unchanged. A dot with repeated pixels may therefore have moved by a small distance (dead
zone). A video has a dead zone if some dots are repeated while others are not. If pictures are
predicted from later pictures (B-frames), no dot is repeated exactly. The error of a resting dot is
then nearly constant. A video therefore also has a dead zone if moving dots have much larger errors
than resting ones, because both errors are equal if each picture is stored separately.

In videos with a dead zone, the errors are estimated from fast dots: true angles vary smoothly, so
that the eighth divided differences of the angles contain only errors. Let s^2 be the
error variance of resting dots, e^2 the error variance of moving dots, and t the typical number of
successive repetitions. A dot that has not moved since the first picture, and was repeated n times
in succession, has the error variance

    s^2 + (e^2 - s^2) / (1 + n / t),

because a dot whose pixels are repeated more often is more probably at rest. A dot that has moved
keeps the error variance e^2 while its pixels are repeated, because repeated pixels repeat the
error of the moving dot.

The error of a fitted centre also depends on the position of the dot on the grid of pixels. While a
dot rests, this error is constant, so that changes of the distance from the pivot do not contain
it. The variance of this error is therefore estimated from the frame markers: their dots deviate
from the known shape of a marker. In the formula, s^2 includes this variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.opencv import Picture

MEMORY = 300
"""Number of pictures after which the weight of a value has decreased to 1/e."""
_PRIOR_WEIGHT = 30.0
"""In an estimate, the expected mean square has the weight of this number of measured
values [1]."""
_MAX_VALUE = 5.0
"""Largest value of a measurement, relative to the root mean square [1]. Larger ones may belong to
another dot; `FadingMeanSquare.add` ignores them, and `add_weighted` reduces them to this limit."""
_MOVING = 0.1
"""A dot counts as moving if its displacement between two pictures exceeds this [pixels], which is
ten times the typical error of a centre due to pixel noise."""
_CODED_ERROR = 0.02
"""In a video with a dead zone, moving dots are assumed to have at least this error before fast
dots have been observed [pixels]. Codecs ignore displacements of up to 0.02 to 0.1 pixels.
Sensitivity in the first second: at half this value, errors are up to 1.4 times the stated standard
deviations; at twice this value, they are 0.4 to 0.7 times the stated ones."""
_DEAD_ZONE_RATIO = 5.0
"""A video has a dead zone if the mean square error of moving dots is larger than this times the
one of resting dots [1]. Sensitivity in the films of the camera documentation: at half this value,
the errors of one of 13 raw films decrease to 0.8 times the stated standard deviations; at twice
this value, the errors of a noisy H.264 film increase to 1.5 times the stated ones."""
_ORDER = 8
"""Order of divided differences [1]. At this order, an oscillation of a dot contributes less than a
thousandth of its amplitude if there are 9 or more pictures per period."""
_RECORDED_STEP = 0.4
"""A usable video never loses displacements between two pictures that are larger than this
[pixels]. Smaller displacements may be lost in the dead zone."""


def _faded(total: float) -> float:
    return total * (1 - 1 / MEMORY)


class FadingMeanSquare:
    """Mean square of values, with weights that decrease exponentially from picture to picture."""

    def __init__(self) -> None:
        self._squares = self._count = 0.0

    def add(self, values: Array, expected: float = 1.0) -> None:
        """Add the values of one picture, (K,), except for those beyond `_MAX_VALUE`.

        `expected` is the mean square that is expected before any measurement (see `value`).
        """
        # The comparison also excludes NaN.
        valid = values[values**2 < _MAX_VALUE**2 * self.value(expected)]
        self._squares = _faded(self._squares) + float(valid @ valid)
        self._count = _faded(self._count) + len(valid)

    def add_weighted(self, values: Array, weights: Array) -> None:
        """Add the values of one picture, (K,), with the given `weights`, (K,)."""
        squares = np.minimum(values**2, _MAX_VALUE**2 * self.value())
        self._squares = _faded(self._squares) + float(weights @ squares)
        self._count = _faded(self._count) + float(weights.sum())

    def value(self, expected: float = 1.0) -> float:
        """Return the estimated mean square: a weighted mean of added squares and `expected`."""
        return (self._squares + _PRIOR_WEIGHT * expected) / (self._count + _PRIOR_WEIGHT)


class RepeatDetector:
    """Comparison of the pixels of dots in each picture with those in the previous picture."""

    def __init__(self) -> None:
        self._before: Picture | None = None

    def compare(self, grey: Picture, centres: Array, radius: float) -> NDArray[np.bool_]:
        """Return for each dot whether all pixels within a `radius` [pixels] are repeated, (N,)."""
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
    """Measurements of the dots of N masses at a time [s], (N,) each; NaN if hidden."""

    time: float
    angles: Array
    """Measured angles [rad]."""
    noise: Array
    """Standard deviations of the angles due to pixel noise [rad]."""
    length_errors: Array
    """Errors of distances from pivots, divided by standard deviations due to pixel noise [1]."""
    pixels_per_radian: Array
    """Displacements of the centres per change of the angles [pixels/rad]."""
    displacements: Array
    """Displacements since the previous picture [pixels]."""
    repeated: NDArray[np.bool_]
    """Whether each dot has exactly the same pixels as in the previous picture."""


class ErrorScale:
    """Ratios of errors of dots to errors due to pixel noise, estimated from earlier pictures."""

    def __init__(self, rotors: int) -> None:
        self._resting, self._moving, self._jumps = (FadingMeanSquare() for _ in range(3))
        self._dead_zone = DeadZone(rotors)
        self._before = np.full(rotors, np.nan)

    def update(self, dots: DotMeasurements, constant: float = 0.0) -> Array:
        """Add the dots of a picture; return the ratio for each of them [1], (N,).

        `constant` [pixels] is the standard deviation of errors that are constant while a dot
        rests.
        """
        moving = dots.displacements > _MOVING
        self._resting.add(dots.length_errors[~dots.repeated & ~moving])
        self._moving.add(dots.length_errors[~dots.repeated & moving])
        changes, repeats = (dots.angles - self._before) / dots.noise, self._dead_zone.repeats
        ended = (repeats > 0) & ~dots.repeated & np.isfinite(changes)
        self._jumps.add_weighted(changes[ended], repeats[ended])
        self._before = dots.angles
        jumps = self._jumps.value()
        relative, seen = 1 / (dots.noise * dots.pixels_per_radian), np.isfinite(dots.angles)
        usual = float(np.median(relative[seen])) if seen.any() else 0.0
        expected = max(jumps, (_CODED_ERROR * usual) ** 2)
        at_rest = self._resting.value()
        errors = self._moving.value(at_rest)
        differ = errors > _DEAD_ZONE_RATIO * (at_rest + (constant * usual) ** 2)
        if differ:
            expected = max(expected, errors)
        self._dead_zone.add_repeated(dots.repeated, seen)
        self._dead_zone.add(dots, expected)
        resting = at_rest + (constant * relative) ** 2
        if differ or self._dead_zone.present:
            return np.sqrt(self._dead_zone.variances(resting, expected))
        updated = np.where(moving, errors, resting)
        return np.sqrt(np.where(dots.repeated, jumps, updated))


class DeadZone:
    """Errors of the angles of dots in a video with a dead zone."""

    def __init__(self, rotors: int) -> None:
        self._times = np.full(_ORDER + 1, np.nan)
        self._angles = np.full((_ORDER + 1, rotors), np.nan)
        self._length_errors = np.full((_ORDER + 1, rotors), np.nan)
        self._along, self._across, self._across_difference = (FadingMeanSquare() for _ in range(3))
        self.repeats = np.zeros(rotors)
        """Number of successive repetitions of each dot [1], (N,)."""
        self._first, self._moved = np.full(rotors, np.nan), np.zeros(rotors, dtype=bool)
        self._log_repeats = self._ended = 0.0
        self._since = MEMORY

    @property
    def present(self) -> bool:
        """Whether the video has a dead zone: recently, some but not all dots were repeated."""
        return self._since < MEMORY

    def add_repeated(self, repeated: NDArray[np.bool_], seen: NDArray[np.bool_]) -> None:
        """Count repetitions in a picture, given which dots are repeated and visible, (N,) each.

        For each picture, both `add_repeated` and `add` are called.
        """
        ended = self.repeats[(self.repeats > 0) & ~repeated & seen]
        self._log_repeats = _faded(self._log_repeats) + float(np.log(ended).sum())
        self._ended = _faded(self._ended) + len(ended)
        self.repeats = np.where(repeated, self.repeats + 1, 0.0)
        self._since = 0 if repeated.any() and (seen & ~repeated).any() else self._since + 1

    def add(self, dots: DotMeasurements, jumps: float) -> None:
        """Update the errors of moving dots with a picture; for `jumps`, see `variances`."""
        self._first = np.where(np.isnan(self._first), dots.angles, self._first)
        self._moved |= np.abs(dots.angles - self._first) * dots.pixels_per_radian > _RECORDED_STEP
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

    def variances(self, resting: Array, jumps: float) -> Array:
        """Return the error variance of each dot, divided by the one due to pixel noise [1], (N,).

        `resting` is this ratio for dots at rest, (N,), and `jumps` the ratio that is assumed for
        moving dots before fast dots have been observed.
        """
        along = self._along.value(jumps)
        along *= max(1.0, self._across.value() / self._across_difference.value())
        usual = math.exp(self._log_repeats / max(self._ended, 1.0))
        repeats = np.where(self._moved, 0.0, self.repeats)
        return resting + np.maximum(along - resting, 0.0) / (1 + repeats / usual)


def _difference_weights(times: Array) -> Array:
    """Return the weights of T values in their divided difference, with a sum of squares of 1."""
    apart = times[:, None] - times
    np.fill_diagonal(apart, times[-1] - times[0])
    weights = 1 / np.prod(apart / (times[-1] - times[0]), axis=1)
    return np.asarray(weights / np.linalg.norm(weights))
