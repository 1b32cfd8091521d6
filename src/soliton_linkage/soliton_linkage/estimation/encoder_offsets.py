# SPDX-License-Identifier: Apache-2.0
"""Constant offsets of single encoders, learnt from what is left beside the wall.

Away from the wall a rotor shows its uniform angle, but for the offset o of its encoder, the
difference delta of its true rest angle from the chain's, whose sign changes with the side that
it leans to, and noise: x = o + side * delta + noise, side = +1 before the wall and -1 beyond
it. Offset and rest angle are therefore told apart only once the wall has passed the rotor.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.loops.filter_arrays import BEYOND_CHANCE, LEAST_TIMES, filter_loops
from soliton_linkage.estimation.loops.frame_arrays import median
from soliton_linkage.linkage.chain import Array

_WIDEST = 2.0
_BLOCK = 16
_MOST_BY_CHANCE = 3.0
_DEVIATION_PER_MEDIAN = 1.4826
_WAVES = 10.0
_LEAST_STRONG = 4.0
_FEW_LARGEST = 0.1
_LEAST_ERROR = 3e-4
_LEAST_DOUBTED = 0.01
_FEW = 0.2
_SHARE_OF_WAVES = 0.05


class EncoderOffsets:
    """Offset of each encoder: the likeliest for normal priors of offsets and rest angles."""

    def __init__(self, number_of_rotors: int, rest_angle_deviation: float = 0.05) -> None:
        """Begin with nothing known, rest angles deviating by about so much [rad]."""
        self._trust = rest_angle_deviation**-2
        self.solution = np.zeros((5, number_of_rotors))
        """Offsets and differences of rest angles with their covariances, as `solve` tells them."""
        self.weights = np.zeros((2, number_of_rotors))
        """Of the residuals of each rotor before the wall and beyond it [1/rad^2], shape (2, N)."""
        self._sums = np.zeros((2, number_of_rotors))
        self._times = np.zeros(number_of_rotors)
        self._loops = filter_loops()
        nothing = np.full(number_of_rotors, np.nan)
        self.update(nothing, np.zeros(number_of_rotors), 1.0)

    @property
    def values(self) -> Array:
        """Likeliest offset of each encoder [rad], shape (N,)."""
        return np.asarray(self.solution[0])

    @property
    def deviations(self) -> Array:
        """Standard deviation of each offset [rad], shape (N,)."""
        return self._deviations

    @property
    def corrections(self) -> Array:
        """What is to be subtracted from each angle [rad], shape (N,): 0 where none is sure."""
        return self._corrections

    @property
    def typical(self) -> float:
        """Typical residual that lasts, of rotors on the sides on which they were seen [rad].

        It is that of rest angles, where most rotors or springs differ from the chain's; 0 where
        chance may have done it.
        """
        means, chances = np.empty((2, self.weights.size))
        known = self._loops.lasting_residuals(self.weights, self._sums, means, chances)
        if not known:
            return 0.0
        typical = _DEVIATION_PER_MEDIAN * median(means[:known])
        return typical if typical > _MOST_BY_CHANCE * median(chances[:known]) else 0.0

    def update(
        self, residuals: Array, sides: Array, variance: float, repeated: float = 0.0
    ) -> None:
        """Learn from a frame: angles as read less those of the orbit [rad], shape (N,).

        They are NaN where unknown; sides [1] are +1 before the wall, -1 beyond it and 0 about
        it, shape (N,); the variance is that of the noise [rad^2], and that of the error which
        is the same in all frames so far is the repeated.
        """
        self._deviations: Array = np.empty(len(self._times))
        self._corrections: Array = np.empty(len(self._times))
        self._loops.learn(
            self.weights,
            self._sums,
            self._times,
            np.ascontiguousarray(residuals, dtype=np.float64),
            np.ascontiguousarray(sides, dtype=np.float64),
            variance,
            repeated,
            _WIDEST**-2,
            self._trust,
            self.solution,
            self._deviations,
            self._corrections,
        )

    def doubt(self, rotors: NDArray[np.bool_]) -> None:
        """Let rotors, shape (N,), that are not what they were before have to show it again."""
        self._times[rotors] = np.minimum(self._times[rotors], LEAST_TIMES) - 1


class FarRotors:
    """Means over blocks of frames of what is left of the rotors that the wall is far from.

    What is left of a rotor for a while does not count where it is not what it was before: the
    encoder is stuck, or another wall is there.
    """

    def __init__(
        self, offsets: EncoderOffsets, margin: float, time_unit: float, strong: float
    ) -> None:
        """Learn these offsets beyond a margin [rotor spacings] of a wall; time unit in [s].

        Waves of a strong mean square [rad^2] tell nothing of encoders.
        """
        self._offsets = offsets
        self._margin = margin
        self._time_unit = time_unit
        self._strong = strong
        rotors = len(offsets.values)
        self._loops = filter_loops()
        self._sums = np.zeros(rotors)
        self._read = np.full(rotors, np.nan)
        self._apart = np.zeros(rotors)
        self._waves = 0.0
        self.stuck = np.zeros(rotors, dtype=np.bool_)
        self.doubtful = np.zeros(rotors, dtype=np.bool_)
        self.forget()

    def forget(self) -> None:
        """Begin a new block."""
        self._sums[:] = 0
        self._frames, self._time = 0, 0.0
        self._lowest, self._highest = math.inf, -math.inf

    def add(self, residuals: Array, place: float, elapsed: float) -> bool:
        """Take in what is left of a frame [rad], shape (N,); whether that fills the block.

        The frame is a time [s] after the last, with the wall at a place [rotor spacings].
        """
        self._sums += residuals
        self._lowest, self._highest = min(self._lowest, place), max(self._highest, place)
        self._time += elapsed
        self._frames += 1
        return self._frames == _BLOCK

    def learn(self, sign: int, variance: float) -> None:
        """Learn from the block, begin a new one.

        The residuals are of angles less corrections, or with a sign of -1 their opposites; the
        variance is that of the noise of an angle [rad^2].
        """
        offsets = self._offsets
        sides, found = np.empty(len(self._sums)), np.empty((6, len(self._sums)))
        known, passed = self._loops.surprise(
            offsets.weights,
            offsets.solution,
            self._sums,
            offsets.corrections,
            sign / self._frames,
            self._lowest - self._margin,
            self._highest + self._margin,
            sides,
            found,
        )
        means, surprises, unsure, squares, unexpected, common = found
        noise = variance / self._frames
        if _most(squares[:known]) > self._strong + _LEAST_STRONG * noise:
            self.forget()
            return
        of_waves = max(_typical(unexpected[:known]) ** 2 - noise, 0.0)
        repeats = max(_WAVES * self._time_unit / self._time, 1.0)
        noise += of_waves * repeats
        self._waves = max(self._waves, of_waves)
        repeated = _LEAST_ERROR**2 + _SHARE_OF_WAVES**2 * self._waves
        # Where most seem to have an offset, rotors and springs are not equal.
        repeated += _typical(common[:passed]) ** 2
        strange = np.abs(surprises) > BEYOND_CHANCE * (unsure + math.sqrt(noise))
        means[strange] = np.nan
        offsets.update(means, sides, noise, repeated)
        offsets.doubt(strange)
        self._loops.stand_apart(offsets.solution, sides, repeated, self._apart)
        self.forget()

    def look_for_doubtful(self, read: Array, outlying: NDArray[np.bool_]) -> None:
        """Find rotors that are not to be trusted, from what they read [rad], shape (N,).

        Those that read what they did a block ago, unless many do and they are not outlying, are
        stuck until they read anything else. Those that differ from the orbit by far more than
        most do have an offset, but one that is known only once the wall has passed.
        """
        self._loops.find_stuck(read, self._read, outlying, self.stuck, _FEW)
        limit = BEYOND_CHANCE * _DEVIATION_PER_MEDIAN * median(self._apart.copy())
        far_off = self._apart > limit + _LEAST_DOUBTED
        self.doubtful = self.stuck | (far_off & (self._offsets.corrections == 0))


def _most(squares: Array) -> float:
    """Mean of all squares but the few largest, which may be of offsets [rad^2]."""
    count = len(squares) - max(2, math.ceil(_FEW_LARGEST * len(squares)))
    if count <= 0:
        return 0.0
    squares.partition(count)
    return float(squares[:count].mean())


def _typical(sizes: Array) -> float:
    """Robust root mean square of errors, by their sizes [rad]; 0 of none."""
    return _DEVIATION_PER_MEDIAN * median(sizes) if len(sizes) else 0.0
