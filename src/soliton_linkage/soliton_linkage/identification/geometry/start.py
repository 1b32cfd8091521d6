# SPDX-License-Identifier: Apache-2.0
"""The chain of equal rotors that the angles are nearest to, from nothing but them.

The bond of equal rotors closes where

    cos(phi_n - phi_{n+1}) = K_0 + K_1 (sin(phi_{n+1}) - sin(phi_n)),
    K_0 = (a^2 + 2 r^2 - l^2) / (2 r^2),    K_1 = a / r,

which is linear in K_0 and K_1 (after Freudenstein's equation of four-bar linkages).
"""

from __future__ import annotations

import math

import numpy as np

from soliton_linkage.identification.geometry.lengths import Lengths
from soliton_linkage.linkage.chain import Array

_PASSING = 0.2
"""Difference of the sines of neighbours about a wall, over the largest of most bonds [1]."""


def equal_rotors(angles: Array) -> Lengths:
    """Lengths of equal rotors on pivots a distance of 1 apart, for angles [rad] (T, N).

    Raises ValueError where no chain has these angles.
    """
    inner = angles[:, 1:-1] if angles.shape[1] > 4 else angles
    apart = np.diff(np.sin(inner), axis=1)
    together = np.cos(np.diff(inner, axis=1))
    constants = np.nanmedian(together, axis=0)
    swing = float(np.median(np.nanmax(np.abs(apart - np.nanmedian(apart, axis=0)), axis=0)))
    across = apart - np.nanmedian(apart, axis=0)
    passing = np.abs(across) > _PASSING * swing
    ratio = float(across[passing] @ (together - constants)[passing])
    ratio /= float(across[passing] @ across[passing])
    constant = float(np.median(constants))
    if ratio < 0:
        raise ValueError(
            'the angles are those of a chain seen from behind: name the joints from the first '
            'rotor to the last, and count angles from upright towards the last'
        )
    squared = ratio**2 + 2 * (1 - constant)
    if not squared > ratio**2 > 0:
        raise ValueError(
            'the angles are those of no chain of rotors on pivots in a row; check that they are '
            'in radians, counted from upright towards the last rotor, in the order of the rotors'
        )
    rotors = angles.shape[1]
    length, rest = 1 / float(ratio), math.sqrt(squared) / float(ratio)
    return Lengths(
        np.full(rotors, length), np.ones(rotors - 1), np.full(rotors - 1, rest), np.zeros(rotors)
    )
