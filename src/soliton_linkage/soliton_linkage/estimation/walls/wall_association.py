# SPDX-License-Identifier: Apache-2.0
"""Who is who: walls of a frame and walls that are followed, paired so that all ways are short."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.estimation.walls.wall_track import SeenWall

_FORBIDDEN = 1e9
"""Square of deviations [1] between walls that cannot be the same."""


class ExpectedWall(NamedTuple):
    """Where a wall is expected."""

    rotor: float
    """Centre [rotor spacings]."""
    variance: float
    """Of the centre [rotor spacings^2]."""
    charge: int
    """+1 or -1."""


def assigned(
    line: WallLine, expected: Sequence[ExpectedWall], seen: Sequence[SeenWall], gate: float
) -> dict[int, int]:
    """Index of the wall that is seen, by that of the one expected; both without those left over.

    Of all ways to pair walls of the same charge that are no more than a gate [deviations] apart
    it takes that with the most pairs, and of these that with the least sum of squares.
    """
    if not expected or not seen:
        return {}
    costs = np.full((len(expected), len(seen)), _FORBIDDEN)
    for row, wall in enumerate(expected):
        for column, other in enumerate(seen):
            square = line.apart(other.rotor, wall.rotor) ** 2 / wall.variance
            if wall.charge == other.charge and square < gate**2:
                costs[row, column] = square
    pairs = zip(*linear_sum_assignment(costs), strict=True)
    return {int(row): int(column) for row, column in pairs if costs[row, column] < _FORBIDDEN}
