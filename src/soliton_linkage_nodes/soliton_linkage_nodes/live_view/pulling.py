# SPDX-License-Identifier: Apache-2.0
"""Pull of a rotor by the pointer, modelled as a damped spring with a limited torque."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain

_ACCELERATION = 200.0
"""Largest acceleration of a free rotor by the torque [rad/s^2]: 10 rad/s are reached in 0.05 s."""
_STRETCH = 1.0
"""Angle between rotor and pointer at which the spring reaches its largest torque [rad]."""
_TOP_SPEED = 20.0
"""At this speed of the rotor, the damping torque equals the largest torque [rad/s]."""
_DEAD_ZONE = 0.2
"""Radius around the pivot within which the pointer causes no torque [rotor lengths]."""


@dataclass
class Pull:
    """Pull of one rotor towards a point in the plane of the chain."""

    rotor: int
    x: float
    """Coordinate of the pointer along the chain from the first pivot [m]."""
    z: float
    """Height of the pointer above the pivots [m]."""
    held: bool = True

    def point_to(self, x: float, z: float) -> None:
        """Move the pointer to `x` and `z` [m]; ValueError unless both are finite."""
        if not (math.isfinite(x) and math.isfinite(z)):
            raise ValueError(f'position ({x}, {z}) m of the pointer must be finite')
        self.x, self.z = float(x), float(z)

    def torque(self, chain: Chain, angles: Array, rates: Array | None, limit: float) -> float:
        """Return the torque on the pulled rotor [N m], limited to +-`limit` [N m].

        The `angles` [rad] and `rates` [rad/s] of all rotors have shape (N,).
        """
        pivot = float(np.sum(chain.spacings[: self.rotor]))
        length = float(chain.rotor_lengths[self.rotor])
        angle = float(angles[self.rotor])
        if math.hypot(self.x - pivot, self.z) < _DEAD_ZONE * length or not math.isfinite(angle):
            return 0.0
        stretch = math.remainder(math.atan2(self.x - pivot, self.z) - angle, math.tau)
        rate = 0.0 if rates is None else float(rates[self.rotor])
        inertia = float(chain.masses[self.rotor]) * length**2
        largest = min(limit, _ACCELERATION * inertia)
        share = max(-1.0, min(1.0, stretch / _STRETCH)) - rate / _TOP_SPEED
        return largest * max(-1.0, min(1.0, share))
