# SPDX-License-Identifier: Apache-2.0
"""Errors of dots beyond the noise of pixels: scatter, repeated dots, the dead zone of a film.

Compression removes noise from similar pixels and adds errors that many pixels share. A mass stays
on a circle about its pivot: a change of its distance from there is an error, as large as the error
along the circle. In compressed pictures, moving dots have larger errors than resting ones.

Films store the changes of a picture that exceed a step. Where nothing changed they repeat the
pixels to the last bit, which the noise of a camera never does. Such a dot was not measured again:
its error is that of before, and it has moved by up to that step. When it is measured again it
jumps along its circle by its error. If some dots are repeated while others move, the film has a
dead zone: dots creep or swing along their way while the film shows them at rest. Dots that move
beyond the dead zone in each picture have errors alike along and across their way:

* Along the way, the divided difference of sixth order of seven pictures contains the errors from
  picture to picture, because no motion of slow and of usual waves has it.
* Errors that last are reduced in that contrast by the same factor as those across the way.

A dot that was repeated in n pictures, where t is usual before it moves on, has the variance

    s^2 + (e^2 - s^2) / (1 + n / t)

between that of resting dots, s^2, and that of moving dots, e^2: the longer it stays in its dead
zone, the less it moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.opencv import Picture

MEMORY = 300
"""Pictures after which statistics have faded to 1/e [1]."""
_PRIOR = 30.0
"""Weight of the expected value, in numbers [1]."""
_LARGEST = 5.0
"""Largest number that counts, over the usual one [1]: a larger one belongs to another dot."""
_MOVING = 0.1
"""Way since the picture before beyond which a dot moves [pixels]: ten times that of noise."""
_ORDER = 6
"""Order of the contrast [1]: waves of a tenth of the picture rate are reduced to a thousandth, and
errors that last for two pictures to a half."""
_MEASURABLE = 0.4
"""Way from picture to picture that every usable film records [pixels]: several times the errors of
good films, and less than a block of pixels needs to change."""


def _faded(total: float) -> float:
    """Return a sum over pictures, one picture later."""
    return total * (1 - 1 / MEMORY)


class FadingMeanSquare:
    """Mean square of the numbers of the pictures so far, with an exponential memory."""

    def __init__(self) -> None:
        self._squares = self._count = 0.0

    def take(self, numbers: Array, expected: float = 1.0) -> None:
        """Add the numbers of a picture, (K,), whose square has an expected value."""
        known = numbers[np.isfinite(numbers)]
        known = known[known**2 < _LARGEST**2 * self.square(expected)]
        self._squares = _faded(self._squares) + float(known @ known)
        self._count = _faded(self._count) + len(known)

    def take_for(self, numbers: Array, pictures: Array) -> None:
        """Add numbers that count for so many pictures, (K,) each, clipped to the largest."""
        squares = np.minimum(numbers**2, _LARGEST**2 * self.square())
        self._squares = _faded(self._squares) + float(pictures @ squares)
        self._count = _faded(self._count) + float(pictures.sum())

    def square(self, expected: float = 1.0) -> float:
        """Return the mean of what was added and of the expected value."""
        return (self._squares + _PRIOR * expected) / (self._count + _PRIOR)


class RepeatDetector:
    """Comparison of the dots of a picture with the picture before."""

    def __init__(self) -> None:
        self._before: Picture | None = None

    def compare(self, grey: Picture, places: Array, radius: float) -> NDArray[np.bool_]:
        """Return which dots at places [pixels], (N, 2), NaN if hidden, have the pixels of before.

        The pixels within a radius [pixels] count.
        """
        before, self._before = self._before, grey.copy()
        repeated = np.zeros(len(places), dtype=bool)
        if before is None:
            return repeated
        half = math.ceil(radius)
        for rotor in np.flatnonzero(np.isfinite(places[:, 0])):
            column, row = np.rint(places[rotor]).astype(int)
            rows = slice(max(row - half, 0), row + half + 1)
            columns = slice(max(column - half, 0), column + half + 1)
            repeated[rotor] = np.array_equal(grey[rows, columns], before[rows, columns])
        return repeated


@dataclass(frozen=True)
class DotMeasurements:
    """Dots of N masses in a picture, NaN if hidden, shape (N,) each."""

    time: float
    """Time of the angles [s]."""
    angles: Array
    """Actual angles [rad]."""
    turning: Array
    """Standard deviations of the angles by the noise of pixels [rad]."""
    lengths: Array
    """Errors of distances from the pivots, over those by the noise of pixels [1]."""
    pixels: Array
    """Derivative of a dot by its angle [pixels/rad]."""
    ways: Array
    """Ways since the picture before [pixels]."""
    repeated: NDArray[np.bool_]
    """Whether the dot has the pixels of the picture before."""


class ErrorScale:
    """Ratio of the errors of dots to those by the noise of pixels, from the pictures so far."""

    def __init__(self, rotors: int) -> None:
        self._standing, self._moving, self._jumps = (FadingMeanSquare() for _ in range(3))
        self._dead_zone = DeadZone(rotors)
        self._runs, self._before = np.zeros(rotors), np.full(rotors, np.nan)

    def update(self, shown: DotMeasurements) -> Array:
        """Return the standard deviations over those by the noise of pixels, shape (N,)."""
        moving = shown.ways > _MOVING
        self._standing.take(shown.lengths[~shown.repeated & ~moving])
        self._moving.take(shown.lengths[~shown.repeated & moving])
        self._take_jumps(shown)
        jumps, standing = self._jumps.square(), self._standing.square()
        self._dead_zone.take_repeated(shown.repeated, np.isfinite(shown.angles))
        self._dead_zone.take(shown, jumps)
        if self._dead_zone.there:
            return np.sqrt(self._dead_zone.variances(standing, jumps))
        of_new = np.where(moving, self._moving.square(), standing)
        return np.sqrt(np.where(shown.repeated, jumps, of_new))

    def _take_jumps(self, shown: DotMeasurements) -> None:
        """Add the jumps of repeated dots that are measured again."""
        jumps = (shown.angles - self._before) / shown.turning
        ended = (self._runs > 0) & ~shown.repeated & np.isfinite(jumps)
        self._jumps.take_for(jumps[ended], self._runs[ended])
        self._runs = np.where(shown.repeated, self._runs + 1, 0.0)
        self._before = shown.angles


class DeadZone:
    """Errors of dots along their way in a film with a dead zone."""

    def __init__(self, rotors: int) -> None:
        self._times = np.full(_ORDER + 1, np.nan)
        self._angles = np.full((_ORDER + 1, rotors), np.nan)
        self._lengths = np.full((_ORDER + 1, rotors), np.nan)
        self._along, self._across, self._across_contrast = (FadingMeanSquare() for _ in range(3))
        self._runs = np.zeros(rotors)
        self._log_runs = self._ended = 0.0
        self._since = MEMORY

    @property
    def there(self) -> bool:
        """Whether some dots were repeated recently while others moved."""
        return self._since < MEMORY

    def take_repeated(self, repeated: NDArray[np.bool_], seen: NDArray[np.bool_]) -> None:
        """Add which dots of a picture were repeated and which were seen, (N,) each."""
        ended = self._runs[(self._runs > 0) & ~repeated & seen]
        self._log_runs = _faded(self._log_runs) + float(np.log(ended).sum())
        self._ended = _faded(self._ended) + len(ended)
        self._runs = np.where(repeated, self._runs + 1, 0.0)
        self._since = 0 if repeated.any() and (seen & ~repeated).any() else self._since + 1

    def take(self, shown: DotMeasurements, jumps: float) -> None:
        """Add the errors in a picture and the mean square of jumps of repeated dots [1].

        The jumps are the expected errors until dots have moved.
        """
        self._times = np.append(self._times[1:], shown.time)
        self._angles = np.vstack([self._angles[1:], shown.angles])
        self._lengths = np.vstack([self._lengths[1:], shown.lengths])
        if not np.isfinite(self._times).all():
            return
        steps = np.abs(np.diff(self._angles, axis=0)) * shown.pixels
        contrast = _contrast(self._times)
        moving, always = steps.max(axis=0) > _MEASURABLE, steps.min(axis=0) > _MEASURABLE
        self._along.take((contrast @ self._angles / shown.turning)[moving], jumps)
        self._across_contrast.take((contrast @ self._lengths)[always])
        self._across.take(self._lengths[_ORDER // 2, always])

    def variances(self, standing: float, jumps: float) -> Array:
        """Return the variances of errors over those by the noise of pixels [1], shape (N,)."""
        along = self._along.square(jumps)
        along *= max(1.0, self._across.square() / self._across_contrast.square())
        usual = math.exp(self._log_runs / max(self._ended, 1.0))
        return standing + max(along - standing, 0.0) / (1 + self._runs / usual)


def _contrast(times: Array) -> Array:
    """Return weights of unit length of the divided difference of values at times, shape (T,)."""
    apart = times[:, None] - times
    np.fill_diagonal(apart, times[-1] - times[0])
    weights = 1 / np.prod(apart / (times[-1] - times[0]), axis=1)
    return np.asarray(weights / np.linalg.norm(weights))
