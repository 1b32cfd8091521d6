# SPDX-License-Identifier: Apache-2.0
"""By how much places of dots scatter more, or less, than their pixels say.

Noise of pixels is not all: compression takes it from pixels that are alike, and puts errors in its
place that many pixels have in common. A mass stays on a circle about its pivot: what its distance
from there changes by is an error of its place, as large as that along the circle. In films what
moves has larger errors: pixels of what stands are those of many pictures.
"""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array

_MEMORY = 300
"""Pictures that tell it [1]."""
_PRIOR = 30.0
"""Dots that speak for what pixels say, to begin with [1]."""
_LARGEST = 5.0
"""Of an error over what pixels say, that is taken for one [1]: a dot of another is none."""
_MOVING = 0.1
"""Way since the picture before beyond which a dot moves [pixels]: those that stand seem to go a
tenth of that."""


class Scatter:
    """Learns it from the pictures so far, of all dots and of those that move."""

    def __init__(self) -> None:
        """Believe the pixels."""
        self._squares = np.full(2, _PRIOR)
        self._counts = np.full(2, _PRIOR)

    def take(self, errors: Array, ways: Array) -> None:
        """Take errors over what pixels say of them [1], and ways since the last picture [pixels].

        Both have the shape (K,).
        """
        squares = np.minimum(np.abs(errors), _LARGEST) ** 2
        fade = 1 - 1 / _MEMORY
        for group, which in enumerate((np.ones_like(ways, dtype=bool), ways > _MOVING)):
            self._squares[group] = fade * self._squares[group] + squares[which].sum()
            self._counts[group] = fade * self._counts[group] + which.sum()

    def factors(self, ways: Array) -> Array:
        """True standard deviations over what pixels say, by ways [pixels], shape (K,) each."""
        of_all, of_moving = np.sqrt(self._squares / self._counts)
        return np.asarray(np.where(ways > _MOVING, of_moving, of_all))
