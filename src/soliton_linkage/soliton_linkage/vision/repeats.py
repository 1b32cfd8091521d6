# SPDX-License-Identifier: Apache-2.0
"""Dots that a film repeats, and by how much these are off.

Films keep of a picture what has changed since the last, beyond a step: where nothing has, they
repeat its pixels to the last bit, which noise of a camera never does. Such a dot was not seen
anew, its errors are those of before, and it has moved on by up to that step. By how much is seen
when it is seen anew: it jumps.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.dots import Picture


class Repeats:
    """Compares dots of a picture with what was there in the picture before."""

    def __init__(self, rotors: int) -> None:
        """Have seen none."""
        self._before: Picture | None = None
        self._angles = np.full(rotors, np.nan)
        self.runs = np.zeros(rotors)
        """Pictures running in which each dot was repeated, shape (N,)."""

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

    def jumps(self, angles: Array, repeated: NDArray[np.bool_]) -> tuple[Array, Array]:
        """By what rotors that were repeated jump as they are seen anew [rad], and their runs.

        Angles [rad] are of shape (N,), jumps are, NaN of all others.
        """
        ended = (self.runs > 0) & ~repeated & np.isfinite(angles)
        jumps, runs = np.where(ended, angles - self._angles, np.nan), self.runs.copy()
        self.runs = np.where(repeated, self.runs + 1, 0.0)
        self._angles = angles
        return jumps, runs
