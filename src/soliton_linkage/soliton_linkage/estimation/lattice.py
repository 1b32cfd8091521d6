# SPDX-License-Identifier: Apache-2.0
"""Places along a chain or round a ring, and the lengths that tell near walls from free ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.settings import ReportSettings, WallSettings
from soliton_linkage.estimation.state_report import energy_reach
from soliton_linkage.linear.bands import gap, penetration_depth
from soliton_linkage.linkage.chain import Chain


class WallLine:
    """The places of a chain [rotor spacings]; those of a ring run from 0 to N and on from 0."""

    def __init__(self, chain: Chain, settings: WallSettings, report: ReportSettings) -> None:
        """Work out the lengths of a chain."""
        depth = penetration_depth(chain) / chain.spacing
        self.rotors = chain.number_of_rotors
        self.periodic = chain.periodic
        self.width = chain.wall_width / chain.spacing
        """Of a slow wall [rotor spacings]."""
        room = self.rotors if chain.periodic else self.rotors - 1
        near = settings.near_depths * depth + settings.near_beside
        self.near = min(near, room / 3)
        """Distance of two walls below which they are not free [rotor spacings]."""
        self.parted = min(1.5 * near, room / 2)
        """Distance beyond which they are free again [rotor spacings]."""
        self.edge = min(settings.edge_rotors + settings.edge_widths * self.width, room / 3)
        """Distance from an edge up to which a wall may come from it [rotor spacings]."""
        self.reach = energy_reach(chain, report)
        """Distance from a wall that holds its energy [rotor spacings]."""
        self.free = min(self.reach, room / 3)
        """Distance from an edge from which on a wall is free of it [rotor spacings]."""
        self.period = 2 * math.pi / max(gap(chain), 1e-12)
        """Longest period of a phonon [s]."""

    def apart(self, place: float, other: float) -> float:
        """Way from the other place to this one [rotor spacings], the shorter one round a ring."""
        way = place - other
        return math.remainder(way, self.rotors) if self.periodic else way

    def on_it(self, place: float) -> float:
        """The same place of a ring between 0 and N."""
        return place % self.rotors if self.periodic else place

    def edge_distance(self, place: float) -> float:
        """Distance from the nearer edge [rotor spacings], infinite for a ring."""
        return math.inf if self.periodic else min(place, self.rotors - 1 - place)

    def edge_of(self, place: float) -> float:
        """Place of the nearer edge, that of the first rotor or of the last."""
        return 0.0 if place < (self.rotors - 1) / 2 else self.rotors - 1.0

    def numbers(self, low: float, high: float, edge: int = 0) -> NDArray[np.int64]:
        """Numbers of the rotors between two places; round a ring they run beyond 0 and N.

        So many at each edge of a chain are left out.
        """
        first, last = math.ceil(low), math.floor(high)
        if not self.periodic:
            first, last = max(first, edge), min(last, self.rotors - 1 - edge)
        return np.arange(first, last + 1)

    def between(self, left: float, right: float) -> float:
        """Middle of the way from a place to the next on its right [rotor spacings]."""
        way = right - left
        if self.periodic:
            way %= self.rotors
        return self.on_it(left + way / 2)
