# SPDX-License-Identifier: Apache-2.0
"""Constant offsets of single encoders, learnt from what is left beside the wall.

Away from the wall a rotor shows its uniform angle, but for the offset o of its encoder, the
difference delta of its true rest angle from the chain's, whose sign changes with the side that
it leans to, and noise: x = o + side * delta + noise, side = +1 before the wall and -1 beyond
it. Offset and rest angle are therefore told apart only once the wall has passed the rotor.
"""

from __future__ import annotations

import numpy as np

from soliton_linkage.chain import Array

_WIDEST = 2.0
_SIGNIFICANT = 5.0


class EncoderOffsets:
    """Offset of each encoder: the likeliest for normal priors of offsets and rest angles."""

    def __init__(self, number_of_rotors: int, rest_angle_deviation: float = 0.05) -> None:
        """Begin with nothing known, rest angles deviating by about so much [rad]."""
        self._trust = rest_angle_deviation**-2
        self._weights = np.zeros((2, number_of_rotors))
        self._sums = np.zeros((2, number_of_rotors))
        self._solve()

    @property
    def values(self) -> Array:
        """Likeliest offset of each encoder [rad], shape (N,)."""
        return self._values

    @property
    def deviations(self) -> Array:
        """Standard deviation of each offset [rad], shape (N,)."""
        return self._deviations

    @property
    def corrections(self) -> Array:
        """What is to be subtracted from each angle [rad], shape (N,): 0 where none is sure."""
        return self._corrections

    def update(self, residuals: Array, sides: Array, variance: float) -> None:
        """Learn from a frame: angles as read less those of the orbit [rad], shape (N,).

        They are NaN where unknown; sides [1] are +1 before the wall, -1 beyond it and 0 about
        it, shape (N,); the variance is that of the noise [rad^2].
        """
        for row, side in enumerate((1, -1)):
            known = (sides == side) & np.isfinite(residuals)
            self._weights[row, known] += 1 / variance
            self._sums[row, known] += residuals[known] / variance
        self._solve()

    def _solve(self) -> None:
        """Mean and deviation of o, from the 2 x 2 normal equations of o and delta."""
        both = self._weights.sum(axis=0)
        of_offset, of_rest = both + _WIDEST**-2, both + self._trust
        mixed = self._weights[0] - self._weights[1]
        sums, differences = self._sums.sum(axis=0), self._sums[0] - self._sums[1]
        determinant = of_offset * of_rest - mixed**2
        self._values: Array = (of_rest * sums - mixed * differences) / determinant
        self._deviations: Array = np.sqrt(of_rest / determinant)
        sure = np.abs(self._values) > _SIGNIFICANT * self._deviations
        self._corrections = np.where(sure, self._values, 0.0)
