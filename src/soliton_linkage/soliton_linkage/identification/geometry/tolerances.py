# SPDX-License-Identifier: Apache-2.0
"""What is known of lengths before any angle is seen: those of one kind are much alike.

Logarithms of lengths of one kind are normal about their common mean, offsets of encoders about
0. How wide these normal distributions are, the tolerance of the workshop, the angles show too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.identification.geometry.lengths import OF_A_ROTOR, Lengths, split
from soliton_linkage.linkage.chain import Array

_BEGIN = 0.04
"""Tolerances to start from [1], [rad]: wider ones let single lengths run away at first."""
_WIDEST = 0.3
"""The largest [1], [rad]: beyond a third nothing is alike."""
_NARROWEST = 1e-4
"""Smallest tolerance [1], [rad], a tenth of what workshops reach: 0 has no logarithm."""


@dataclass(frozen=True)
class Tolerances:
    """Standard deviations of lengths of one kind about their mean, and of offsets."""

    of_lengths: float = _BEGIN
    """Relative [1]."""
    of_offsets: float = _BEGIN
    """[rad]."""

    def information(self, rotors: int) -> Array:
        """Information on the unknowns of a chain of N rotors, shape (P, P)."""
        size = OF_A_ROTOR * rotors - 2
        information = np.zeros((size, size))
        for part in (0, 2, 3):
            places = np.arange(part, size, OF_A_ROTOR)
            alike = np.eye(len(places)) - 1 / len(places)
            information[np.ix_(places, places)] = alike / self.of_lengths**2
        places = np.arange(1, size, OF_A_ROTOR)
        information[places, places] = self.of_offsets**-2
        return information

    def close_to(self, other: Tolerances, share: float) -> bool:
        """Whether they are those of another to a share of it [1]."""
        return (
            abs(self.of_lengths - other.of_lengths) <= share * other.of_lengths
            and abs(self.of_offsets - other.of_offsets) <= share * other.of_offsets
        )

    def relearnt(self, lengths: Lengths, covariance: Array) -> Tolerances:
        """Tolerances that lengths and offsets have, given what is known of these (P, P)."""
        rotor, offset, spacing, rest = split(np.diag(covariance))
        squares = [
            _squares(np.log(lengths.rotor_lengths), rotor),
            _squares(np.log(lengths.spacings), spacing),
            _squares(np.log(lengths.rest_lengths), rest),
        ]
        of_lengths = math.sqrt(sum(squares) / (3 * lengths.rotors - 5))
        of_offsets = math.sqrt(float(np.mean(lengths.offsets**2 + offset)))
        return Tolerances(_within(of_lengths), _within(of_offsets))


def unknowns_of(lengths: Lengths) -> Array:
    """Logarithms of lengths and offsets in the order of the unknowns, shape (P,)."""
    values = np.empty(OF_A_ROTOR * lengths.rotors - 2)
    rotor, offset, spacing, rest = split(values)
    rotor[:], offset[:] = np.log(lengths.rotor_lengths), lengths.offsets
    spacing[:], rest[:] = np.log(lengths.spacings), np.log(lengths.rest_lengths)
    return values


def _squares(logarithms: Array, variances: Array) -> float:
    return float(np.sum((logarithms - logarithms.mean()) ** 2 + variances))


def _within(tolerance: float) -> float:
    return min(max(tolerance, _NARROWEST), _WIDEST)
