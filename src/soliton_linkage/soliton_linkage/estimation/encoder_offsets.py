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

from soliton_linkage.compiling import (
    b1_1d,
    compiled,
    const_b1_1d,
    const_f8_1d,
    f8,
    f8_1d,
    f8_2d,
    records,
)
from soliton_linkage.estimation.frames import Flags
from soliton_linkage.estimation.noise import (
    DEVIATION_PER_MEDIAN,
    FREEDOMS_OF_MEDIAN,
    median,
    robust_deviation,
)
from soliton_linkage.estimation.settings import DEFAULTS, OffsetSettings, record_dtype
from soliton_linkage.linear.bands import penetration_depth, tail_ratio
from soliton_linkage.linkage.chain import Array, Chain

Records = NDArray[np.void]

_SUMS = ('weight_before', 'weight_beyond', 'sum_before', 'sum_beyond', 'means')
_SOLUTION = ('offset', 'rest_angle')
_COVARIANCE = ('offset_offset', 'offset_rest_angle', 'rest_angle_rest_angle')
ENCODER = np.dtype([(name, np.float64) for name in (*_SUMS, *_SOLUTION, *_COVARIANCE)])
"""What is known of an encoder and the rest angle of its rotor.

Weights [1/rad^2] and weighted sums [1/rad] of residuals before the wall and beyond it, and how
many means these were; the offset o and the difference delta of the rest angle [rad], with their
covariance [rad^2].
"""
_READ_ENCODERS = records(ENCODER)
_ENCODERS = records(ENCODER, writable=True)
_NUMBERS = records(record_dtype(OffsetSettings))


@compiled(_ENCODERS, const_f8_1d, const_f8_1d, f8)
def add_residuals(encoders: Records, residuals: Array, sides: Array, variance: float) -> None:
    """Add residuals of a variance [rad^2] to the weights and sums of their rotors.

    Residuals [rad], NaN where unknown, and sides, +1, -1 and 0 about the wall: (N,) each.
    """
    for n in range(residuals.size):
        if sides[n] != 0 and math.isfinite(residuals[n]):
            each = encoders[n]
            each['means'] += 1
            if sides[n] > 0:
                each['weight_before'] += 1 / variance
                each['sum_before'] += residuals[n] / variance
            else:
                each['weight_beyond'] += 1 / variance
                each['sum_beyond'] += residuals[n] / variance


@compiled(_ENCODERS, f8, f8)
def solve(encoders: Records, of_offsets: float, of_rest_angles: float) -> None:
    """Set offsets and rest angles from the 2 x 2 normal equations of each.

    With the weights of the priors of both [1/rad^2].
    """
    for n in range(encoders.size):
        each = encoders[n]
        before, beyond = each['weight_before'], each['weight_beyond']
        of_offset, of_rest = before + beyond + of_offsets, before + beyond + of_rest_angles
        mixed = before - beyond
        whole = each['sum_before'] + each['sum_beyond']
        apart = each['sum_before'] - each['sum_beyond']
        determinant = of_offset * of_rest - mixed * mixed
        each['offset'] = (of_rest * whole - mixed * apart) / determinant
        each['rest_angle'] = (of_offset * apart - mixed * whole) / determinant
        each['offset_offset'] = of_rest / determinant
        each['offset_rest_angle'] = -mixed / determinant
        each['rest_angle_rest_angle'] = of_offset / determinant


@compiled(_ENCODERS, _NUMBERS, f8, f8_1d, f8_1d)
def find_sure(
    encoders: Records, settings: Records, repeated: float, deviations: Array, corrections: Array
) -> None:
    """Set deviations of offsets and what is sure of these [rad], shape (N,).

    The repeated is the variance of the error that is the same in all frames [rad^2].
    """
    limit, fewest = settings[0]['significance'], settings[0]['fewest_means']
    for n in range(encoders.size):
        each = encoders[n]
        deviations[n] = math.sqrt(each['offset_offset'] + repeated)
        sure = each['means'] >= fewest and abs(each['offset']) > limit * deviations[n]
        corrections[n] = each['offset'] if sure else 0.0


@compiled(_READ_ENCODERS, const_f8_1d, const_f8_1d, f8, f8, f8, f8_1d, f8_2d)
def compare_means(
    encoders: Records,
    sums: Array,
    corrections: Array,
    share: float,
    before: float,
    beyond: float,
    sides: Array,
    found: Array,
) -> tuple[int, int]:
    """Means of the residuals of a block of frames, a share of their sums [rad], shape (N,).

    They are of angles less corrections [rad]. Rotors are before one place and beyond another
    [rotor spacings], which sets their sides. Found, shape (6, N), are the means, what they are
    more than expected, NaN about the wall, and how unsure that was [rad]; then, one after the
    other, squares of the innovations that are known and what they are more than unsure; and the
    sizes of offsets of rotors that were seen on both sides. Returns how many these are.
    """
    known, passed = 0, 0
    for n in range(sums.size):
        each = encoders[n]
        side = 1.0 if n < before else -1.0 if n > beyond else 0.0
        expected = each['offset'] + side * each['rest_angle']
        mixed = 2 * each['offset_rest_angle'] + side * each['rest_angle_rest_angle']
        sides[n] = side
        found[0, n] = share * sums[n] + corrections[n]
        found[1, n] = found[0, n] - expected if side else math.nan
        found[2, n] = math.sqrt(each['offset_offset'] + side * mixed)
        if math.isfinite(found[1, n]):
            found[3, known] = found[1, n] * found[1, n]
            found[4, known] = max(abs(found[1, n]) - found[2, n], 0.0)
            known += 1
        if each['weight_before'] > 0 and each['weight_beyond'] > 0:
            found[5, passed] = abs(each['offset'])
            passed += 1
    return known, passed


@compiled(_READ_ENCODERS, _NUMBERS, const_f8_1d, f8, f8_1d)
def beyond_chance(
    encoders: Records, settings: Records, sides: Array, repeated: float, apart: Array
) -> None:
    """Set how far rotors are from the orbit beyond chance [rad], (N,), where they have a side.

    The repeated is the variance of the error that is the same in all frames [rad^2].
    """
    limit = settings[0]['significance']
    for n in range(sides.size):
        side, each = sides[n], encoders[n]
        if side:
            expected = each['offset'] + side * each['rest_angle']
            mixed = 2 * each['offset_rest_angle'] + side * each['rest_angle_rest_angle']
            variance = each['offset_offset'] + side * mixed
            apart[n] = max(abs(expected) - limit * math.sqrt(variance + repeated), 0.0)


@compiled(const_f8_1d, f8_1d, const_b1_1d, b1_1d, f8, f8)
def find_stuck(
    read: Array, earlier: Array, outlying: Flags, stuck: Flags, few: float, still: float
) -> None:
    """Set which rotors are stuck, shape (N,), who read what they did earlier [rad].

    Where more than few [1] of those that are known read that but for what still ones do [rad],
    only of the outlying, and of those that were stuck before. What was read earlier is then what
    is read now.
    """
    same, known = 0, 0
    for n in range(read.size):
        same += abs(read[n] - earlier[n]) <= still
        known += math.isfinite(read[n])
    for n in range(read.size):
        trusted = same > few * known and not (outlying[n] or stuck[n])
        stuck[n] = read[n] == earlier[n] and not trusted
        earlier[n] = read[n]


class EncoderOffsets:
    """Offset of each encoder: the likeliest for normal priors of offsets and rest angles."""

    def __init__(self, number_of_rotors: int, settings: OffsetSettings = DEFAULTS.offsets) -> None:
        """Begin with nothing known but the priors."""
        self.settings = settings
        self.encoders = np.zeros(number_of_rotors, ENCODER)
        """What is known of each encoder and the rest angle of its rotor, records of shape (N,)."""
        nothing = np.full(number_of_rotors, np.nan)
        self.update(nothing, np.zeros(number_of_rotors), 1.0)

    @property
    def values(self) -> Array:
        """Likeliest offset of each encoder [rad], shape (N,)."""
        return np.asarray(self.encoders['offset'])

    @property
    def deviations(self) -> Array:
        """Standard deviation of each offset [rad], shape (N,)."""
        return self._deviations

    @property
    def corrections(self) -> Array:
        """What is to be subtracted from each angle [rad], shape (N,): 0 where none is sure."""
        return self._corrections

    def update(
        self, residuals: Array, sides: Array, variance: float, repeated: float = 0.0
    ) -> None:
        """Learn from a frame: angles as read less those of the orbit [rad], shape (N,).

        They are NaN where unknown; sides [1] are +1 before the wall, -1 beyond it and 0 about
        it, shape (N,); the variance is that of the noise [rad^2], and that of the error which
        is the same in all frames so far is the repeated.
        """
        given = self.settings
        residuals = np.ascontiguousarray(residuals, dtype=np.float64)
        sides = np.ascontiguousarray(sides, dtype=np.float64)
        add_residuals(self.encoders, residuals, sides, variance)
        priors = 3 / math.pi**2, given.rest_angle_deviation**-2
        solve(self.encoders, *priors)
        self._deviations: Array = np.empty(len(self.encoders))
        self._corrections: Array = np.empty(len(self.encoders))
        find_sure(self.encoders, given.record, repeated, self._deviations, self._corrections)

    def doubt(self, rotors: NDArray[np.bool_]) -> None:
        """Let rotors, shape (N,), that are not what they were before have to show it again."""
        means = np.minimum(self.encoders['means'][rotors], self.settings.fewest_means)
        self.encoders['means'][rotors] = means - 1


class FarFieldResiduals:
    """Means over blocks of frames of what is left of the rotors that the wall is far from.

    What is left of a rotor for a while does not count where it is not what it was before: the
    encoder is stuck, or another wall is there.
    """

    def __init__(self, offsets: EncoderOffsets, chain: Chain, strong: float) -> None:
        """Learn these offsets of a chain, of which strong waves [rad^2] tell nothing."""
        self._offsets = offsets
        depth = penetration_depth(chain) / chain.spacing
        self._margin = 1 + offsets.settings.depths_beside * depth
        self._tail = tail_ratio(chain)
        self._time_unit = chain.time_unit
        self._strong = strong
        self._settings = offsets.settings
        rotors = len(offsets.encoders)
        self._sums = np.zeros(rotors)
        self._read = np.full(rotors, np.nan)
        self._apart = np.zeros(rotors)
        self._waves = 0.0
        self._means = np.full(rotors, np.nan)
        self._uneven = False
        self._first = True
        self.unevenness = 0.0
        """Standard deviation of what deviations that nobody told add to far rotors [rad].

        It is that beside the tail of what they have nearer to the wall. Until the first block
        tells, or where that is strong the next, it is all that is not known to be noise.
        """
        self.stuck = np.zeros(rotors, dtype=np.bool_)
        self.doubtful = np.zeros(rotors, dtype=np.bool_)
        self._outlying: NDArray[np.bool_] | None = None
        self._residuals = np.full(rotors, np.nan)
        self.forget()

    def forget(self) -> None:
        """Begin a new block."""
        self._sums[:] = 0
        self._frames, self._time = 0, 0.0
        self._lowest, self._highest = math.inf, -math.inf

    def is_near(self, site: float) -> NDArray[np.bool_]:
        """Which rotors are not far from a place [rotor spacings], shape (N,)."""
        return np.asarray(np.abs(np.arange(len(self._sums)) - site) <= self._margin)

    def add(
        self,
        residuals: Array,
        outlying: NDArray[np.bool_] | None,
        site: float,
        elapsed: float,
        variance: float,
    ) -> bool:
        """Take in what is left of a frame [rad], shape (N,); whether that fills the block.

        Of rotors that are outlying now and were not, or by as much, before, the mean so far
        counts: such a reading is wrong once. The frame is a time [s] after the last, with the
        wall at a place [rotor spacings]; of noise a variance is known [rad^2].
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
            self.unevenness = self._beyond_noise(variance)
        return self._frames == self._settings.block

    def learn(self, sign: int, variance: float) -> None:
        """Learn from the block, begin a new one.

        The residuals are of angles less corrections, or with a sign of -1 their opposites; the
        variance is that of the noise of an angle [rad^2].
        """
        offsets, given = self._offsets, self._settings
        sides, found = np.empty(len(self._sums)), np.empty((6, len(self._sums)))
        known, passed = compare_means(
            encoders=offsets.encoders,
            sums=self._sums,
            corrections=offsets.corrections,
            share=sign / self._frames,
            before=self._lowest - self._margin,
            beyond=self._highest + self._margin,
            sides=sides,
            found=found,
        )
        means, innovations, unsure, squares, unexpected, common = found
        noise = variance / self._frames
        strong = self._strong + 4 * noise
        changed, self._means = means - self._means, means.copy()
        changed[np.isnan(innovations)] = np.nan
        first, self._first = self._first, False
        if self._most(squares[:known]) > strong:
            if not self._lasts(changed, strong):
                if not first:
                    self.unevenness = self._lasting()
                self.forget()
                return
            self._uneven = True
        of_waves = max(robust_deviation(unexpected[:known]) ** 2 - noise, 0.0)
        repeats = max(given.wave_time * self._time_unit / self._time, 1.0)
        noise += of_waves * repeats
        self._waves = max(self._waves, of_waves)
        repeated = given.least_error**2 + given.wave_share**2 * self._waves
        # Where most seem to have an offset, rotors and springs are not equal.
        repeated += robust_deviation(common[:passed]) ** 2
        strange = np.abs(innovations) > given.significance * (unsure + math.sqrt(noise))
        means[strange] = np.nan
        offsets.update(means, sides, noise, repeated)
        if self._uneven:
            offsets.corrections[:] = 0.0
        offsets.doubt(strange)
        beyond_chance(offsets.encoders, given.record, sides, repeated, self._apart)
        self.unevenness = self._lasting()
        self.forget()

    def _lasts(self, changed: Array, strong: float) -> bool:
        """Whether means are those of the block before [rad], as waves would not be."""
        both = changed[np.isfinite(changed)]
        return len(both) > 0 and self._most(both**2) < strong

    def look_for_doubtful(self, read: Array, outlying: NDArray[np.bool_]) -> None:
        """Find rotors that are not to be trusted, from what they read [rad], shape (N,).

        Those that read what they did a block ago, unless many do and they are not outlying, are
        stuck until they read anything else. Those that differ from the orbit by far more than
        most do have an offset, but one that is known only once the wall has passed.
        """
        given = self._settings
        find_stuck(read, self._read, outlying, self.stuck, 0.2, 1e-5)
        limit = given.significance * DEVIATION_PER_MEDIAN * median(self._apart.copy())
        far_off = self._apart > limit + given.least_doubted
        unknown = far_off & (self._offsets.corrections == 0)
        self.doubtful = self.stuck | (unknown & (not self._uneven))

    def _beyond_noise(self, variance: float) -> float:
        """Deviation of mean residuals in the block so far that no noise has made [rad]."""
        rotors, means = np.arange(len(self._sums)), self._sums / self._frames
        before = np.where(rotors < self._lowest - self._margin, means, np.nan)
        beyond = np.where(rotors > self._highest + self._margin, means, np.nan)
        return self._stated(before, beyond, math.sqrt(variance / self._frames))

    def _lasting(self) -> float:
        """The same of residuals that last, of rotors on the sides on which they were seen."""
        known = self._offsets.encoders
        weights = np.concatenate([known['weight_before'], known['weight_beyond']])
        chances = 1 / np.sqrt(weights[weights > 0])
        with np.errstate(invalid='ignore'):
            before = known['sum_before'] / known['weight_before']
            beyond = known['sum_beyond'] / known['weight_beyond']
        return self._stated(before, beyond, median(chances) if len(chances) else 0.0)

    def _stated(self, before: Array, beyond: Array, chance: float) -> float:
        """Deviation of what residuals have beside tails [rad], by Student's distribution.

        They are before the wall and beyond it, shape (N,) each, NaN where unknown. It is 0 where
        chance, so much in a residual [rad], may have made it, or what moves in an even chain.
        """
        given, tail = self._settings, self._tail
        added = np.concatenate([before[:-1] - tail * before[1:], beyond[1:] - tail * beyond[:-1]])
        sizes = np.abs(added[np.isfinite(added)])
        freedoms = max(FREEDOMS_OF_MEDIAN * len(sizes), 3.0)
        by_chance = (1 + tail**2) * chance**2
        excess = robust_deviation(sizes) ** 2 - by_chance - given.evenness**2
        if excess <= given.significance * math.sqrt(2 / freedoms) * by_chance:
            return 0.0
        return math.sqrt(excess * freedoms / (freedoms - 2))

    def _most(self, squares: Array) -> float:
        """Mean of all squares but the few largest, which may be of offsets [rad^2]."""
        few = 2
        count = len(squares) - few
        if count <= 0:
            return 0.0
        squares.partition(count)
        return float(squares[:count].mean())
