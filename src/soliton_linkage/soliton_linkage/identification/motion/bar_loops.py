# SPDX-License-Identifier: Apache-2.0
"""The loop over the frames of a motion of rigid bars, for `bar_motion`."""

from __future__ import annotations

import math

from soliton_linkage.compiling import READ, READ_TABLE, TABLE, compile_loop, compiled
from soliton_linkage.linkage.chain import Array


def _acceleration(
    arc: float,
    speed: float,
    roots: Array,
    pulls: Array,
    rubbing: Array,
    column: int,
    grid: Array,
    drags: Array,
) -> tuple[float, float]:
    """Changes of arc and speed in time, by rows of the grid between which there are lines."""
    at = (arc - grid[0]) / grid[1]
    row = 0
    if at > 0.0:
        row = int(min(at, len(rubbing) - 2.0))
    part = min(max(at - row, 0.0), 1.0)
    root = (1 - part) * roots[row, column] + part * roots[row + 1, column]
    rub = (1 - part) * rubbing[row] + part * rubbing[row + 1]
    pull = (1 - part) * pulls[row, column] + part * pulls[row + 1, column]
    rate = speed / root
    drag = drags[0, column] * rate + drags[1, column] * rub * math.tanh(rate / grid[2])
    return rate, (pull - drag) / root


acceleration = compile_loop(_acceleration, inlined=True)


@compiled(READ_TABLE, READ_TABLE, READ, READ, READ_TABLE, READ, READ_TABLE, TABLE)
def move_along(
    roots: Array,
    pulls: Array,
    rubbing: Array,
    grid: Array,
    drags: Array,
    times: Array,
    begin: Array,
    arcs: Array,
) -> None:
    """Set arcs at times, (T, K), of K motions along an orbit from `begin`, arcs and speeds (2, K).

    On a grid of G arcs, which begins at grid[0] and is grid[1] apart, are the roots of the
    inertias and the pulls of gravity, (G, K), and the rubbing, (G,); `drags` are damping and dry
    friction, (2, K), which is nearly whole at the rate grid[2]. By the classical method of Runge
    and Kutta.
    """
    for k in range(begin.shape[1]):
        s, u = begin[0, k], begin[1, k]
        arcs[0, k] = s
        for n in range(1, len(times)):
            step = times[n] - times[n - 1]
            half = step / 2
            s1, u1 = acceleration(s, u, roots, pulls, rubbing, k, grid, drags)
            s2, u2 = acceleration(
                s + half * s1, u + half * u1, roots, pulls, rubbing, k, grid, drags
            )
            s3, u3 = acceleration(
                s + half * s2, u + half * u2, roots, pulls, rubbing, k, grid, drags
            )
            s4, u4 = acceleration(
                s + step * s3, u + step * u3, roots, pulls, rubbing, k, grid, drags
            )
            s += step / 6 * (s1 + 2 * s2 + 2 * s3 + s4)
            u += step / 6 * (u1 + 2 * u2 + 2 * u3 + u4)
            arcs[n, k] = s
