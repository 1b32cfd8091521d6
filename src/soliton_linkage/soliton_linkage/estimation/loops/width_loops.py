# SPDX-License-Identifier: Apache-2.0
"""The loop of the least squares of a wall's contraction."""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.compiling import COUNT, NUMBER, READ, READ_TABLE, compiled
from soliton_linkage.estimation.loops.frame_loops import wrapped
from soliton_linkage.linkage.chain import Array


@compiled(READ, READ_TABLE, COUNT, COUNT, NUMBER, NUMBER, NUMBER)
def contraction_sums(
    angles: Array,
    table: Array,
    begin: int,
    end: int,
    centre: float,
    gamma: float,
    step: float,
) -> tuple[float, float, float, float, float]:
    """Sums over rotors that are known of f'^2, f' g, g^2, f' x and g x, where g = u f'.

    The table has f, f' and f'' of even and then of odd rotors in steps [rotor spacings] up to a
    half of its length on either side of 0, shape (3, 2 K); x is what f leaves of an angle [rad]
    at u = gamma (centre - n). See `WallFamily.step`.
    """
    count = table.shape[1] // 2
    half = float(count // 2)
    places, both, logs, of_place, of_log = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(begin, end):
        if not math.isfinite(angles[n]):
            continue
        distance = min(max(gamma * (centre - n), -half * step), half * step)
        steps = distance * (1 / step)
        nearest = np.rint(steps)
        beyond = (steps - nearest) * step
        at = int(nearest + half) + (n % 2) * count
        bent = beyond * table[2, at]
        left = wrapped(angles[n] - (table[0, at] + beyond * (table[1, at] + 0.5 * bent)))
        slope = table[1, at] + bent
        by_log = distance * slope
        places += slope * slope
        both += slope * by_log
        logs += by_log * by_log
        of_place += slope * left
        of_log += by_log * left
    return places, both, logs, of_place, of_log
