# SPDX-License-Identifier: Apache-2.0
"""Places along a chain or round a ring, and the lengths that tell near walls from free ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.settings import ReportSettings, WallSettings
from soliton_linkage.estimation.state_report import (
    FrameErrors,
    FrameState,
    StateReporter,
    energy_reach,
)
from soliton_linkage.linear.bands import gap, penetration_depth
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.solitons.tanh_fit import order_field


class LatticeCoordinates:
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

    def apart(self, site: float, other: float) -> float:
        """Way from the other place to this one [rotor spacings], the shorter one round a ring."""
        way = site - other
        return math.remainder(way, self.rotors) if self.periodic else way

    def on_it(self, site: float) -> float:
        """The same place of a ring between 0 and N."""
        return site % self.rotors if self.periodic else site

    def edge_distance(self, site: float) -> float:
        """Distance from the nearer edge [rotor spacings], infinite for a ring."""
        return math.inf if self.periodic else min(site, self.rotors - 1 - site)

    def edge_of(self, site: float) -> float:
        """Place of the nearer edge, that of the first rotor or of the last."""
        return 0.0 if site < (self.rotors - 1) / 2 else self.rotors - 1.0

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


class WallFrame:
    """One frame of a chain, asked where it is of use to know more."""

    def __init__(
        self,
        reporter: StateReporter,
        line: LatticeCoordinates,
        angles: Array | None,
        rates: Array | None,
        errors: FrameErrors,
    ) -> None:
        """Take angles [rad], None where rotors are not known, and rates [rad/s], shape (N,)."""
        self._reporter, self._chain, self._line = reporter, reporter.chain, line
        self._angles, self._rates, self._errors = angles, rates, errors

    def energy(self, places: Sequence[float]) -> float:
        """Energy within reach of walls at places [rotor spacings], less that of the noise [J].

        NaN where it cannot be told.
        """
        angles, rates = self._angles, self._rates
        if angles is None or rates is None or not np.isfinite(rates).all():
            return math.nan
        return self._reporter.report(angles, places, rates, self._errors).energies.wall

    def swing(self, site: float, lean: int) -> float:
        """Largest swing of a rotor near a place from a uniform state that leans so.

        It is over that to the opposite state [1], and 0 where rotors are not known.
        """
        if self._angles is None:
            return 0.0
        field, _ = order_field(self._chain, self._angles)
        near = self._line.numbers(site - self._line.near, site + self._line.near)
        return float(np.abs(field[near % len(field)] - lean).max() / 2)

    def turn(self, left: float, right: float) -> int:
        """Sense in which a spinner's rotors turn in the left one of two walls, +1 or -1.

        Neighbours are less than half a turn apart from how they are in a uniform state. It is 0
        for flippers, and where rotors are not known.
        """
        chain, line, angles = self._chain, self._line, self._angles
        if angles is None or chain.motion is not Motion.SPINNER:
            return 0
        family = 1 if FrameState(chain, angles).twists > 0 else -1
        middle = left + line.apart(line.between(left, right), left)
        rotors = line.numbers(left - max(line.near, 2.0), middle) % line.rotors
        steps = np.diff((angles - chain.uniform_state(family))[rotors])
        return int(np.sign(np.sum(wrapped(steps))))
