# SPDX-License-Identifier: Apache-2.0
"""Compiled evaluation of an orbit; scipy's splines take ten times as long for one place."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import COUNT, NUMBER, READ, READ_TABLE, ROW, compiled
from soliton_linkage.linkage.chain import Array


@compiled(READ, READ_TABLE, NUMBER, ROW)
def spline(knots: Array, coefficients: Array, at: float, values: Array) -> None:
    """Set values of B-splines with knots in common, shape (M,); coefficients of shape (K, M).

    By the recursion of Cox and de Boor.
    """
    high = coefficients.shape[0]
    low = degree = knots.size - high - 1
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= at:
            low = middle
        else:
            high = middle
    basis = np.zeros(degree + 1)
    basis[0] = 1.0
    for order in range(1, degree + 1):
        saved = 0.0
        for n in range(order):
            right, left = knots[low + n + 1], knots[low + 1 + n - order]
            share = basis[n] / (right - left)
            basis[n] = saved + (right - at) * share
            saved = (at - left) * share
        basis[order] = saved
    for column in range(values.size):
        value = 0.0
        for n in range(degree + 1):
            value += basis[n] * coefficients[low - degree + n, column]
        values[column] = value


@compiled(NUMBER, READ_TABLE, COUNT, NUMBER, NUMBER, READ, READ_TABLE, ROW)
def about_wall(
    arc: float,
    legs: Array,
    repeats: int,
    site_arc: float,
    length: float,
    knots: Array,
    coefficients: Array,
    values: Array,
) -> tuple[int, int, int]:
    """Set angles [rad], up to whole turns, and tangents [1] of a short chain, shape (2 n,).

    At an arc [rad] of the long chain, in whose legs so many passages repeat; legs are where each
    begins in the long chain, where in the short one, and the way from there to the middle of the
    short one [rad], shape (3, legs). The length [rad] is that of the short orbit, whose angles
    and tangents are a spline. Returns the first rotor of the long chain that is among those of
    the short one, and of these the first and the end.
    """
    leg = legs.shape[1] - 1
    while leg > 0 and arc < legs[0, leg]:
        leg -= 1
    beyond = arc - legs[0, leg]
    passed = math.floor((beyond - legs[2, leg]) / (2 * site_arc))
    passed = min(max(passed, 0), repeats)
    offset = 2 * (passed if leg % 2 == 0 else repeats - passed)
    within = (legs[1, leg] + beyond - 2 * passed * site_arc) % length
    spline(knots, coefficients, within, values)
    # Edge rotors of the short chain stand where the long one has none, but at its ends.
    low = 0 if offset == 0 else 1
    end = values.size // 2
    high = end if offset == 2 * repeats else end - 1
    return offset + low, low, high
