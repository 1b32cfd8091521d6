# SPDX-License-Identifier: Apache-2.0
"""By how much places of dots scatter more, or less, than their pixels say.

Noise of pixels is not all: compression takes it from pixels that are alike, and puts errors in its
place that many pixels have in common. A mass stays on a circle about its pivot: what its distance
from there changes by is an error of its place, as large as that along the circle. In films what
moves has larger errors: pixels of what stands are those of many pictures. Dots that are repeated
stay on their circle, but jump along it as they are seen anew, by what they were off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array

_MEMORY = 300
"""Pictures that tell it [1]."""
_PRIOR = 30.0
"""Dots that speak for what pixels say, to begin with [1]."""
_LARGEST = 5.0
"""Of an error over the usual one, that is taken for one [1]: a dot of another is none, and what
goes on while it is seen anew is no jump."""
_MOVING = 0.1
"""Way since the picture before beyond which a dot moves [pixels]: those that stand seem to go a
tenth of that."""


class Scatter:
    """Learns it from the pictures so far, of all dots, those that move and those repeated."""

    def __init__(self) -> None:
        """Believe the pixels."""
        self._squares = np.full(3, _PRIOR)
        self._counts = np.full(3, _PRIOR)

    def take(self, errors: Array, ways: Array) -> None:
        """Take errors over what pixels say of them [1], and ways since the last picture [pixels].

        Both have the shape (K,), of dots that were not repeated.
        """
        for group, least in enumerate((-np.inf, _MOVING)):
            taken = (ways > least) & (np.abs(errors) < self._largest(group))
            self._learn(group, errors[taken], np.ones(int(taken.sum())))

    def take_jumps(self, jumps: Array, runs: Array) -> None:
        """Take jumps over what pixels say [1], (K,), and for how many pictures they came, (K,)."""
        self._learn(2, np.minimum(np.abs(jumps), self._largest(2)), runs)

    def factors(self, ways: Array, repeated: NDArray[np.bool_]) -> Array:
        """True standard deviations over what pixels say, by ways [pixels], shape (K,) each."""
        of_all, of_moving, of_repeated = np.sqrt(self._squares / self._counts)
        of_new = np.where(ways > _MOVING, of_moving, of_all)
        return np.asarray(np.where(repeated, of_repeated, of_new))

    def _learn(self, group: int, errors: Array, weights: Array) -> None:
        fade = 1 - 1 / _MEMORY
        self._squares[group] = fade * self._squares[group] + weights @ errors**2
        self._counts[group] = fade * self._counts[group] + weights.sum()

    def _largest(self, group: int) -> float:
        return float(_LARGEST * np.sqrt(self._squares[group] / self._counts[group]))
