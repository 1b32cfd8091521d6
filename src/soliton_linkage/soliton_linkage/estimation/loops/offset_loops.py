# SPDX-License-Identifier: Apache-2.0
"""Loops over the encoders, for `EncoderOffsets`: records of shape (N,)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import (
    FLAGS,
    NUMBER,
    READ,
    READ_FLAGS,
    ROW,
    TABLE,
    compiled,
    records,
)
from soliton_linkage.estimation.loops.frame_loops import Flags
from soliton_linkage.estimation.settings import OffsetSettings, record_dtype
from soliton_linkage.linkage.chain import Array

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


@compiled(_ENCODERS, READ, READ, NUMBER)
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


@compiled(_ENCODERS, NUMBER, NUMBER)
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


@compiled(_ENCODERS, _NUMBERS, NUMBER, ROW, ROW)
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


@compiled(_READ_ENCODERS, READ, READ, NUMBER, NUMBER, NUMBER, ROW, TABLE)
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


@compiled(_READ_ENCODERS, _NUMBERS, READ, NUMBER, ROW)
def beyond_chance(
    encoders: Records, settings: Records, sides: Array, repeated: float, apart: Array
) -> None:
    """Set how far rotors are from the orbit beyond chance [rad], (N,), where they have a side.

    The repeated is the variance of the error that is the same in all frames [rad^2].
    """
    limit = settings[0]['beyond_chance']
    for n in range(sides.size):
        side, each = sides[n], encoders[n]
        if side:
            expected = each['offset'] + side * each['rest_angle']
            mixed = 2 * each['offset_rest_angle'] + side * each['rest_angle_rest_angle']
            variance = each['offset_offset'] + side * mixed
            apart[n] = max(abs(expected) - limit * math.sqrt(variance + repeated), 0.0)


@compiled(READ, ROW, READ_FLAGS, FLAGS, NUMBER, NUMBER)
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
