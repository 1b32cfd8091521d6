# SPDX-License-Identifier: Apache-2.0
"""How far the rotors lean over the last seconds, as a picture with the track of the walls."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array, Chain, displacement

Pixels = NDArray[np.uint8]

_COLUMN_RATE = 30.0
"""Columns a second [Hz]: what an eye tells apart."""
_HEIGHT = 400
"""Rows that a picture has at least, so that viewers need not blur a short chain [1]."""
_MOST_ROWS = 1000
"""Of a longer chain every other rotor is shown, or less, for a screen has no more rows [1]."""
_LEVELS = 2048
"""Steps from the furthest left to the furthest right [1]: near rest colours change fast."""
_BLANK, _TRACK, _BORDER = 217, 0, 255
"""Greys of what is not known yet, of the track and of its border: they are no leans [1]."""
_HALF_BORDER, _HALF_TRACK = 2, 1
"""Rows beside the middle of the track [1]."""
_JUMP = 0.25
"""Of a chain [1]: what goes further between two columns was put there, and is not joined."""


class Kymograph:
    """Keeps the leans of the last seconds, and draws them when they are asked for.

    Time runs to the right, rotor 0 is at the bottom; purple leans right, orange left.
    """

    def __init__(self, chain: Chain, length: float) -> None:
        """Keep so many seconds of this chain."""
        self.chain = chain
        self.columns = max(2, round(length * _COLUMN_RATE))
        self._every = -(-chain.number_of_rotors // _MOST_ROWS)
        self._stamps: deque[float] = deque(maxlen=self.columns)
        self._leans: deque[NDArray[np.float32]] = deque(maxlen=self.columns)
        self._walls: deque[tuple[float, ...]] = deque(maxlen=self.columns)
        self._table: Pixels | None = None

    def add(self, stamp: float, angles: Array, walls: Sequence[float]) -> None:
        """Add the angles [rad] of an instant [s] with the places of walls [rotor spacings]."""
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
        """The last seconds, red, green and blue, shape (rows, columns, 3)."""
        if self._table is None:
            # matplotlib takes half a second and 25 MB, which only who looks has to spend.
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
        """Draw the places of walls, joined where as many walls follow in the next column."""
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
