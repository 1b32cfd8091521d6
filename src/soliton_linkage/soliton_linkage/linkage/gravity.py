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
    """Uniform gravity. It acts along -z if the tilt is 0; a positive tilt rotates it towards +x.

    Raises ValueError for values out of their range.
    """

    acceleration: float = quantity(
        0.0, 'acceleration of a free mass', 'm/s^2', 0.0, 1e6, adjustable=True
    )
    tilt: float = quantity(
        0.0,
        'tilt of the chain from horizontal; positive if the last rotor is lower',
        'rad',
        -1e6,
        1e6,
        adjustable=True,
    )

    def __post_init__(self) -> None:
        """Raise ValueError for values out of their range."""
        check_quantities(self)

    def energy(self, chain: Chain, angles: Array) -> Array:
        """Return the potential energy U [J], shape (...).

        U = -g sum_n M (h_n sin(tilt) - v_n cos(tilt)) = g sum_n M r cos(phi_n + tilt). It would be
        0 if the masses were at their pivots.
        """
        heights = np.cos(angles + self.tilt)
        return np.asarray(np.sum(self._weights(chain) * heights, axis=-1))

    def torques(self, chain: Chain, angles: Array) -> Array:
        """Return the torques [N m], -dU/dphi_n = g M r sin(phi_n + tilt), shape (..., N)."""
        return np.asarray(self._weights(chain) * np.sin(angles + self.tilt))

    def scale(self, chain: Chain) -> float:
        """Return the typical size of the potential energy, g sum_n M r [J]."""
        return float(self._weights(chain).sum())

    def _weights(self, chain: Chain) -> Array:
        return np.asarray(self.acceleration * chain.masses * chain.rotor_lengths)


NO_GRAVITY = Gravity()
