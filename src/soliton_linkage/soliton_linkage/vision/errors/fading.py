# SPDX-License-Identifier: Apache-2.0
"""A mean square that forgets, and passes over what belongs to something else."""

from __future__ import annotations

import numpy as np

from soliton_linkage.linkage.chain import Array

MEMORY = 300
"""Pictures that tell how errors are [1]."""
_PRIOR = 30.0
"""Numbers that speak for what is expected, to begin with [1]."""
_LARGEST = 5.0
"""Of a number over the usual one, that is taken for one [1]: a dot of another is none."""


def faded(total: float) -> float:
    """A sum over pictures, a picture later."""
    return total * (1 - 1 / MEMORY)


class FadingSquare:
    """Mean square of numbers of the pictures so far."""

    def __init__(self) -> None:
        """Have seen none."""
        self._squares = self._count = 0.0

    def take(self, numbers: Array, expected: float = 1.0) -> None:
        """Take the numbers of a picture, (K,), whose square is expected to be that."""
        known = numbers[np.isfinite(numbers)]
        known = known[known**2 < _LARGEST**2 * self.square(expected)]
        self._squares = faded(self._squares) + float(known @ known)
        self._count = faded(self._count) + len(known)

    def take_for(self, numbers: Array, pictures: Array) -> None:
        """Take numbers that count for so many pictures, (K,) each, the largest as the usual."""
        squares = np.minimum(numbers**2, _LARGEST**2 * self.square())
        self._squares = faded(self._squares) + float(pictures @ squares)
        self._count = faded(self._count) + float(pictures.sum())

    def square(self, expected: float = 1.0) -> float:
        """The mean of what was seen and of what is expected."""
        return (self._squares + _PRIOR * expected) / (self._count + _PRIOR)
