# SPDX-License-Identifier: Apache-2.0
"""The loops over rays that a lens moves, and over those that it has moved."""

from __future__ import annotations

from soliton_linkage.compiling import READ, READ_TABLE, TABLE, compile_loop, compiled
from soliton_linkage.linkage.chain import Array

_ITERATIONS = 20
"""In which the lens is undone at most: each makes the error smaller by the distortion."""
_UNDONE = 1e-9
"""Error of a ray with which it is undone [1]: a millionth of a pixel."""


def _moved(x: float, y: float, lens: Array) -> tuple[float, float]:
    """Where a lens of k1, k2, p1, p2, k3, k4, k5, k6 makes a ray go."""
    q = x * x + y * y
    radial = 1 + q * (lens[0] + q * (lens[1] + q * lens[4]))
    radial /= 1 + q * (lens[5] + q * (lens[6] + q * lens[7]))
    across, down = lens[2], lens[3]
    return (
        x * radial + 2 * across * x * y + down * (q + 2 * x * x),
        y * radial + across * (q + 2 * y * y) + 2 * down * x * y,
    )


moved = compile_loop(_moved, inlined=True)


@compiled(READ_TABLE, READ, TABLE)
def distort(rays: Array, lens: Array, seen: Array) -> None:
    """Set rays as a lens of eight coefficients makes them go, shape (K, 2) each."""
    for n in range(len(rays)):
        seen[n, 0], seen[n, 1] = moved(rays[n, 0], rays[n, 1], lens)


@compiled(READ_TABLE, READ, TABLE)
def undistort(seen: Array, lens: Array, rays: Array) -> None:
    """Set the rays that a lens makes go so, shape (K, 2) each, as fixed points."""
    for n in range(len(seen)):
        x, y = seen[n, 0], seen[n, 1]
        for _ in range(_ITERATIONS):
            across, down = moved(x, y, lens)
            across, down = seen[n, 0] - across, seen[n, 1] - down
            x += across
            y += down
            if not max(abs(across), abs(down)) > _UNDONE:
                break
        rays[n, 0], rays[n, 1] = x, y
