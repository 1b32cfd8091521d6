# SPDX-License-Identifier: Apache-2.0
"""Dots that a film repeats.

Films keep of a picture what has changed since the last, beyond a step: where nothing has, they
repeat its pixels to the last bit, which noise of a camera never does. Such a dot was not seen
anew, its errors are those of before, and it has moved on by up to that step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dots import Picture


class Repeats:
    """Compares dots of a picture with what was there in the picture before."""

    def __init__(self) -> None:
        """Have seen none."""
        self._before: Picture | None = None

    def look(self, grey: Picture, places: Array, radius: float) -> NDArray[np.bool_]:
        """Which dots at places [pixels], (N, 2), NaN of hidden ones, have the pixels of before.

        They are those within a radius [pixels].
        """
        before, self._before = self._before, grey.copy()
        repeated = np.zeros(len(places), dtype=bool)
        if before is None:
            return repeated
        half = math.ceil(radius)
        for rotor in np.flatnonzero(np.isfinite(places[:, 0])):
            column, row = np.rint(places[rotor]).astype(int)
            rows = slice(max(row - half, 0), row + half + 1)
            columns = slice(max(column - half, 0), column + half + 1)
            repeated[rotor] = np.array_equal(grey[rows, columns], before[rows, columns])
        return repeated
