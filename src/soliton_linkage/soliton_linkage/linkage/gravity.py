# SPDX-License-Identifier: Apache-2.0
"""Gravity in the plane of the chain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.quantities import CheckedQuantities, document_fields, quantity


@document_fields
@dataclass(frozen=True)
class Gravity(CheckedQuantities):
    """Gravity along -z, rotated towards +x by `tilt`; ValueError for values out of range."""

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

    def energy(self, chain: Chain, angles: Array) -> Array:
        """Return the potential energy U = g sum_n M r cos(phi_n + tilt) [J], shape (...)."""
        heights = np.cos(angles + self.tilt)
        return np.asarray(np.sum(self._weights(chain) * heights, axis=-1))

    def torques(self, chain: Chain, angles: Array) -> Array:
        """Return the torques -dU/dphi_n = g M r sin(phi_n + tilt) [N m], shape (..., N)."""
        return np.asarray(self._weights(chain) * np.sin(angles + self.tilt))

    def scale(self, chain: Chain) -> float:
        """Return the typical size of the potential energy, g sum_n M r [J]."""
        return float(self._weights(chain).sum())

    def _weights(self, chain: Chain) -> Array:
        return np.asarray(self.acceleration * chain.masses * chain.rotor_lengths)


NO_GRAVITY = Gravity()
