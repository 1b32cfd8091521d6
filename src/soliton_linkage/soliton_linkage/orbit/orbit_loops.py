# SPDX-License-Identifier: Apache-2.0
"""The rotors about a wall of a uniform chain, as its orbit is put together from a short one."""

from __future__ import annotations

import math

from soliton_linkage.compiling import COUNT, NUMBER, READ, READ_TABLE, ROW, compiled
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.spline import spline


@compiled(NUMBER, READ_TABLE, COUNT, NUMBER, NUMBER, READ, READ_TABLE, COUNT, ROW)
def about_wall(
    arc: float,
    legs: Array,
    repeats: int,
    site_arc: float,
    length: float,
    knots: Array,
    coefficients: Array,
    degree: int,
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
    spline(knots, coefficients, degree, within, values)
    # Edge rotors of the short chain stand where the long one has none, but at its ends.
    low = 0 if offset == 0 else 1
    end = values.size // 2
    high = end if offset == 2 * repeats else end - 1
    return offset + low, low, high
