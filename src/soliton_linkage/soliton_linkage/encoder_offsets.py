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
from numpy.typing import ArrayLike, NDArray

from soliton_linkage.chain import Array
from soliton_linkage.filter_arrays import filter_loops
from soliton_linkage.frame_arrays import median

_WIDEST = 2.0
_SIGNIFICANT = 5.5
_LEAST_TIMES = 5
_BLOCK = 16
_BEYOND_CHANCE = 5.0
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
        self._weights = np.zeros((2, number_of_rotors))
        self._sums = np.zeros((2, number_of_rotors))
        self._repeated = 0.0
        self._times = np.zeros(number_of_rotors)
        self._solution = np.zeros((5, number_of_rotors))
        self._loops = filter_loops()
        self._solve()

    @property
    def values(self) -> Array:
        """Likeliest offset of each encoder [rad], shape (N,)."""
        return np.asarray(self._solution[0])

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
        seen = self._weights > 0
        if not seen.any():
            return 0.0
        means = np.abs(self._sums[seen] / self._weights[seen])
        chance = 1 / np.sqrt(self._weights[seen])
        typical = _DEVIATION_PER_MEDIAN * median(means)
        return typical if typical > _MOST_BY_CHANCE * median(chance) else 0.0

    @property
    def passed(self) -> NDArray[np.bool_]:
        """Rotors that were seen on either side of the wall, shape (N,)."""
        return np.asarray((self._weights > 0).all(axis=0))

    def expected(self, sides: Array) -> tuple[Array, Array]:
        """Residual o + side * delta expected of each rotor [rad] and its variance, (N,) each."""
        means, variances = np.empty(len(sides)), np.empty(len(sides))
        given = np.ascontiguousarray(sides, dtype=np.float64)
        self._loops.expect(self._solution, given, means, variances)
        return means, variances

    def update(
        self, residuals: Array, sides: Array, variance: float, repeated: float = 0.0
    ) -> None:
        """Learn from a frame: angles as read less those of the orbit [rad], shape (N,).

        They are NaN where unknown; sides [1] are +1 before the wall, -1 beyond it and 0 about
        it, shape (N,); the variance is that of the noise [rad^2], and that of the error which
        is the same in all frames so far is the repeated.
        """
        self._repeated = repeated
        self._loops.gather(
            self._weights,
            self._sums,
            self._times,
            np.ascontiguousarray(residuals, dtype=np.float64),
            np.ascontiguousarray(sides, dtype=np.float64),
            variance,
        )
        self._solve()

    def doubt(self, rotors: NDArray[np.bool_]) -> None:
        """Let rotors, shape (N,), that are not what they were before have to show it again."""
        self._times[rotors] = np.minimum(self._times[rotors], _LEAST_TIMES) - 1

    def _solve(self) -> None:
        """Means and covariances of o and delta, and which offsets are sure."""
        self._loops.solve(self._weights, self._sums, _WIDEST**-2, self._trust, self._solution)
        values, variances = self._solution[0], self._solution[2]
        self._deviations: Array = np.sqrt(variances + self._repeated)
        sure = np.abs(values) > _SIGNIFICANT * self._deviations
        sure &= self._times >= _LEAST_TIMES
        self._corrections = np.where(sure, values, 0.0)


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
        self._rotors = np.arange(rotors)
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
        sides = np.where(self._rotors < self._lowest - self._margin, 1.0, 0.0)
        sides[self._rotors > self._highest + self._margin] = -1.0
        means = sign / self._frames * self._sums + offsets.corrections
        expected, spreads = offsets.expected(sides)
        surprises = np.where(sides == 0, np.nan, means - expected)
        unsure, noise = np.sqrt(spreads), variance / self._frames
        if _most(surprises) > self._strong + _LEAST_STRONG * noise:
            self.forget()
            return
        of_waves = max(_typical(surprises, unsure) ** 2 - noise, 0.0)
        repeats = max(_WAVES * self._time_unit / self._time, 1.0)
        noise += of_waves * repeats
        self._waves = max(self._waves, of_waves)
        repeated = _LEAST_ERROR**2 + _SHARE_OF_WAVES**2 * self._waves + self._common() ** 2
        strange = np.abs(surprises) > _BEYOND_CHANCE * (unsure + math.sqrt(noise))
        offsets.update(np.where(strange, np.nan, means), sides, noise, repeated)
        offsets.doubt(strange)
        expected, spreads = offsets.expected(sides)
        apart = np.maximum(np.abs(expected) - _BEYOND_CHANCE * np.sqrt(spreads + repeated), 0)
        self._apart = np.where(sides == 0, self._apart, apart)
        self.forget()

    def _common(self) -> float:
        """How far the rotors of the chain commonly are from the orbit on either side [rad].

        Where most seem to have an offset, rotors and springs are not equal.
        """
        offsets = np.abs(self._offsets.values[self._offsets.passed])
        return _DEVIATION_PER_MEDIAN * median(offsets) if offsets.size else 0.0

    def look_for_doubtful(self, read: Array, outlying: NDArray[np.bool_]) -> None:
        """Find rotors that are not to be trusted, from what they read [rad], shape (N,).

        Those that read what they did a block ago, unless many do and they are not outlying, are
        stuck until they read anything else. Those that differ from the orbit by far more than
        most do have an offset, but one that is known only once the wall has passed.
        """
        same = read == self._read
        if np.count_nonzero(same) > _FEW * np.count_nonzero(np.isfinite(read)):
            same &= outlying | self.stuck
        self._read = read
        self.stuck = same
        limit = _BEYOND_CHANCE * _DEVIATION_PER_MEDIAN * median(self._apart.copy())
        far_off = self._apart > limit + _LEAST_DOUBTED
        self.doubtful = same | (far_off & (self._offsets.corrections == 0))


def _most(surprises: Array) -> float:
    """Mean square of all surprises but the few largest, which may be of offsets [rad^2]."""
    squares = surprises[np.isfinite(surprises)] ** 2
    count = len(squares) - max(2, math.ceil(_FEW_LARGEST * len(squares)))
    if count <= 0:
        return 0.0
    squares.partition(count)
    return float(squares[:count].mean())


def _typical(surprises: Array, unsure: ArrayLike) -> float:
    """Robust root mean square of surprises that were not to be expected [rad]."""
    beyond = np.maximum(np.abs(surprises) - unsure, 0.0)
    known = beyond[np.isfinite(beyond)]
    return _DEVIATION_PER_MEDIAN * median(known) if known.size else 0.0
