# SPDX-License-Identifier: Apache-2.0
"""Which walls a frame shows: the borders of its domains, each placed by a fit."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d

from soliton_linkage.estimation.loops import wall_loops
from soliton_linkage.linkage.chain import Array

_CLEAR = 9
"""Bonds about a joint that are to be of one domain [1], where there are so many."""


def domain_borders(polarised: Array, opposite: float) -> list[tuple[float, int]]:
    """Borders of the domains [rotor spacings] with the charges of the walls there.

    By the polarisations of all bonds, shape (springs,). A domain is of more bonds than so many,
    or of half of them at an end, so that rotors that are read wrongly are none. Charges
    alternate.
    """
    scores = np.ascontiguousarray(polarised, dtype=np.float64)
    right = np.empty(len(scores), dtype=np.bool_)
    wall_loops.domains(scores, opposite, right)
    borders = []
    for bond in np.flatnonzero(right[1:] != right[:-1]).tolist():
        before, after = float(scores[bond]), float(scores[bond + 1])
        opposed = before * after < 0
        share = before / (before - after) if opposed else 0.5
        borders.append((bond + 0.5 + share, 1 if right[bond] else -1))
    return borders


def borders_of_ring(polarised: Array, opposite: float) -> list[tuple[float, int]]:
    """The same of a ring, from 0 to the number of its bonds; it is opened within a domain."""
    bonds = len(polarised)
    clear = minimum_filter1d(np.abs(polarised), min(_CLEAR, bonds), mode='wrap')
    joint = int(np.argmax(clear)) + 1
    opened = np.roll(polarised, -joint)[:-1]
    turned = [
        ((place + joint) % bonds, charge) for place, charge in domain_borders(opened, opposite)
    ]
    return sorted(turned)
