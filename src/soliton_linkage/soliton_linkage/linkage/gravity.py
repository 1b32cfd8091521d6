# SPDX-License-Identifier: Apache-2.0
"""Gravity in the plane of the chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import check_quantities, document_fields, quantity


@document_fields
@dataclass(frozen=True)
class Gravity:
    """A field of constant strength whose direction tilts from -z (tilt 0) towards +x (pi / 2).

    Raises ValueError for values out of their range.
    """

    acceleration: float = quantity(
        0.0, 'acceleration of a free mass', 'm/s^2', 0.0, 1e6, adjustable=True
    )
    tilt: float = quantity(
        0.0,
        'tilt of the chain from horizontal, above 0 where the last rotor is the lower end',
        'rad',
        -1e6,
        1e6,
        adjustable=True,
    )

    def __post_init__(self) -> None:
        """Refuse values out of their range."""
        check_quantities(self)

    def energy(self, chain: Chain, angles: Array) -> Array:
        """Potential energy of the masses, 0 at their pivots [J], shape (...).

        U = -g sum_n M (h_n sin(tilt) - v_n cos(tilt)) = g sum_n M r cos(phi_n + tilt).
        """
        heights = np.cos(angles + self.tilt)
        return np.asarray(np.sum(self._weights(chain) * heights, axis=-1))

    def torques(self, chain: Chain, angles: Array) -> Array:
        """Torque on each rotor [N m], -dU/dphi_n = g M r sin(phi_n + tilt), shape (..., N)."""
        return np.asarray(self._weights(chain) * np.sin(angles + self.tilt))

    def scale(self, chain: Chain) -> float:
        """Energy that lifting every mass by the length of its rotor takes [J]."""
        return float(self._weights(chain).sum())

    def _weights(self, chain: Chain) -> Array:
        return np.asarray(self.acceleration * chain.masses * chain.rotor_lengths)


NO_GRAVITY = Gravity()
