# SPDX-License-Identifier: Apache-2.0
"""Picture of the displacements of the rotors over time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain, displacement

Pixels = NDArray[np.uint8]

_COLUMN_RATE = 30.0
"""Number of pixel columns per second [Hz]. It equals the refresh rate of viewers."""
_HEIGHT = 400
"""Smallest height of a picture [pixel rows]. Viewers would enlarge and blur a smaller picture."""
_MOST_ROWS = 1000
"""Largest number of rotors in a picture [1]. In a longer chain, every n-th rotor is shown."""
_LEVELS = 2048
"""Number of colours, which belong to equally spaced displacements [1]. It is large, because the
colour changes fast with the displacement near a rest state of the chain. With fewer colours, steps
would be visible there."""
_BLANK, _TRACK, _BORDER = 217, 0, 255
"""Grey levels of missing data, of the line that shows the position of a wall, and of the border of
this line [1]. Displacements have other colours."""
_HALF_BORDER, _HALF_TRACK = 2, 1
"""Half widths of the border and of the line [pixel rows]."""
_JUMP = 0.25
"""Distance between successive positions of a wall above which no line connects them [chain
lengths]. The chain was probably reset between them."""


class Kymograph:
    """Displacements of the rotors in the last `length` [s], and a picture of them.

    In the picture, time increases to the right, and rotor 0 is at the bottom. Rotors that lean to
    the right are purple, and rotors that lean to the left are orange. Black lines show the walls
    (solitons).
    """

    def __init__(self, chain: Chain, length: float) -> None:
        self.chain = chain
        self.columns = max(2, round(length * _COLUMN_RATE))
        self._every = -(-chain.number_of_rotors // _MOST_ROWS)
        self._stamps: deque[float] = deque(maxlen=self.columns)
        self._leans: deque[NDArray[np.float32]] = deque(maxlen=self.columns)
        self._walls: deque[tuple[float, ...]] = deque(maxlen=self.columns)
        self._table: Pixels | None = None

    def add(self, stamp: float, angles: Array, walls: Sequence[float]) -> None:
        """Add the angles [rad], shape (N,), and wall positions [rotor spacings] at `stamp` [s].

        If `stamp` is earlier than the previous stamp, all stored displacements are deleted.
        """
        if self._stamps and stamp < self._stamps[-1]:
            for kept in (self._stamps, self._leans, self._walls):
                kept.clear()
        if self._stamps and stamp < self._stamps[-1] + 1 / _COLUMN_RATE:
            return
        self._stamps.append(stamp)
        lean = displacement(self.chain, angles)
        self._leans.append(np.asarray(lean[:: self._every], dtype=np.float32))
        self._walls.append(tuple(walls))

    def picture(self) -> Pixels:
        """Return the picture as RGB values of shape (rows, columns, 3)."""
        if self._table is None:
            # Import matplotlib only if a picture is needed, because it takes 0.5 s and 25 MB.
            from soliton_linkage_studies.palette import lean_colour_table

            self._table = lean_colour_table(self.chain, _LEVELS)
        rotors = len(range(0, self.chain.number_of_rotors, self._every))
        rows = -(-_HEIGHT // rotors)
        if not self._stamps:
            return np.full((rotors * rows, self.columns, 3), _BLANK, dtype=np.uint8)
        stamps = np.array(self._stamps)
        times = stamps[-1] - np.arange(self.columns)[::-1] / _COLUMN_RATE
        shown = np.searchsorted(stamps, times + 0.5 / _COLUMN_RATE) - 1
        largest = float(self.chain.rotor_lengths.max())
        leans = np.array(self._leans).T
        known = np.isfinite(leans)
        share = np.where(known, leans, 0.0) / largest
        level = np.rint((0.5 + 0.5 * np.clip(share, -1, 1)) * (_LEVELS - 1)).astype(np.intp)
        colours = np.where(known[..., None], self._table[level], np.uint8(_BLANK))
        picture = np.where((shown >= 0)[:, None], colours[:, shown], np.uint8(_BLANK))
        picture = np.ascontiguousarray(np.repeat(picture, rows, axis=0)[::-1])
        self._draw_track(picture, shown, rows / self._every)
        return picture

    def _draw_track(self, picture: Pixels, shown: NDArray[np.intp], rows: float) -> None:
        """Draw the positions of the walls.

        Lines connect the positions in neighbouring columns that have equal numbers of walls.
        `shown` contains the index of the stored positions for each pixel column. The index is -1
        before the first stored time. `rows` is the number of pixel rows per rotor.
        """
        xs, ys = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
        columns = [
            (x, self._walls[column]) for x, column in enumerate(shown.tolist()) if column >= 0
        ]
        for (x, walls), (_, following) in pairwise([*columns, (0, ())]):
            for number, wall in enumerate(walls):
                to = following[number] if len(following) == len(walls) else wall
                near = abs(to - wall) < _JUMP * self.chain.number_of_rotors
                path = np.arange(0.0, abs(to - wall) * rows if near else 0.0)
                heights = (wall + 0.5) * rows + np.copysign(path, to - wall)
                ys.append(heights if len(heights) else np.array([(wall + 0.5) * rows]))
                xs.append(np.full(len(ys[-1]), x))
        across, down = np.concatenate(xs), len(picture) - 1 - np.concatenate(ys)
        for half, grey in ((_HALF_BORDER, _BORDER), (_HALF_TRACK, _TRACK)):
            for off in range(-half, half + 1):
                row = np.clip(np.nan_to_num(down) + off, 0, len(picture) - 1)
                picture[row.astype(np.intp), across] = grey
