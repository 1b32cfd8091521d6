# SPDX-License-Identifier: Apache-2.0
"""Loops over the rotors of a frame: turns, sines, and how it differs from the orbit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.compiling import COUNT, NUMBER, READ, ROW, YES, compile_loop, compiled
from soliton_linkage.linkage.chain import Array

Flags = NDArray[np.bool_]

LARGEST_ANGLE = 1e9
"""Angle [rad] from which on none is told: a double is then 1e-7 rad apart from the next."""

_WHOLE = 2 * math.pi
"""A turn [rad]."""
_SHARE_OF_A_TURN = 0.5 / math.pi
"""One radian in turns [1/rad]."""


def _wrapped(angle: float) -> float:
    """Angle from -pi to pi [rad]."""
    return float(angle - _WHOLE * np.rint(angle * _SHARE_OF_A_TURN))


wrapped = compile_loop(_wrapped, (NUMBER,), inlined=True)


@compiled(READ, ROW, ROW, ROW)
def unwrap(angles: Array, last: Array, turns: Array, seen: Array) -> None:
    """Set angles as read without jumps [rad], as seen; NaN where they are not finite or too large.

    The last that were read [rad] and their turns, each of shape (N,), are brought up to date.
    """
    for n in range(angles.size):
        angle = angles[n]
        if abs(angle) < LARGEST_ANGLE:
            jump = np.rint((angle - last[n]) / _WHOLE)
            if math.isfinite(jump):
                turns[n] -= jump
            last[n] = angle
            seen[n] = angle + _WHOLE * turns[n]
        else:
            seen[n] = math.nan


@compiled(READ, NUMBER)
def all_within(values: Array, limit: float) -> bool:
    """Whether the absolute values of a row are all known, finite and no more than a limit."""
    within = True
    for n in range(values.size):
        size = abs(values[n])
        within &= size <= limit and size < math.inf
    return within


@compiled(READ, READ, YES, READ, READ, READ, COUNT, ROW)
def compare(
    angles: Array,
    corrections: Array,
    upside_down: bool,
    before: Array,
    about: Array,
    beyond: Array,
    first: int,
    differences: Array,
) -> None:
    """Set differences of angles less corrections from those of a wall, -pi to pi [rad], (N,).

    The wall has angles about it from the first of its rotors on, and before and beyond them
    those of a background, shape (N,) each.
    """
    end = first + about.size
    for n in range(angles.size):
        angle = angles[n] - corrections[n]
        if upside_down:
            angle = math.pi - angle
        expected = before[n] if n < first else about[n - first] if n < end else beyond[n]
        differences[n] = wrapped(angle - expected)


@compiled(READ, READ, READ)
def median_change(first: Array, second: Array, third: Array) -> float:
    """Median of the absolute second differences of three rows that are known, NaN of none."""
    changes, known = np.empty(first.size), 0
    for n in range(first.size):
        change = abs(first[n] - 2 * second[n] + third[n])
        if change < math.inf:
            changes[known] = change
            known += 1
    return float(np.median(changes[:known])) if known else math.nan


@compiled(READ, READ, READ, READ, COUNT)
def products_in_time(
    oldest: Array, older: Array, left: Array, tangent: Array, first: int
) -> tuple[float, float, float, float]:
    """Sums of p = x (4 x' - x'') / 3 of what three frames running left of rotors [rad], (N,).

    They are over those about the wall, from a first one on: sum p, sum t^2 p, sum f and sum
    f^2 with f = t^2 - t^4.
    """
    whole, wall, free, chance = 0.0, 0.0, 0.0, 0.0
    for n in range(tangent.size):
        before = older[first + n] * (4 / 3) - oldest[first + n] / 3
        product = left[first + n] * before
        share = tangent[n] * tangent[n]
        alone = share - share * share
        whole += product
        wall += share * product
        free += alone
        chance += alone * alone
    return whole, wall, free, chance
