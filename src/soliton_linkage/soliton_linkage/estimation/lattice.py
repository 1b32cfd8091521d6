# SPDX-License-Identifier: Apache-2.0
"""Lattice coordinates of walls along a chain or round a ring, and quantities of one frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.estimation.state_report import (
    FrameErrors,
    FrameState,
    StateReporter,
    energy_reach,
)
from soliton_linkage.linear.bands import gap
from soliton_linkage.linkage.chain import Array, Chain, Motion, wrapped
from soliton_linkage.solitons.tanh_fit import order_field


class LatticeCoordinates:
    """Coordinates of sites [rotor spacings]; a ring has periodic sites from 0 to N."""

    def __init__(self, chain: Chain) -> None:
        self.rotors, self.periodic = chain.number_of_rotors, chain.periodic
        self.width = chain.wall_width / chain.spacing
        """Width of a slow wall [rotor spacings]."""
        room, reach = self.rotors - (not chain.periodic), energy_reach(chain)
        self.near = min(reach, room / 3)
        """Distance below which two walls, or a wall and an edge, interact [rotor spacings]."""
        self.parted = min(1.5 * reach, room / 2)
        """Distance above which two walls have separated [rotor spacings]."""
        self.period = 2 * math.pi / max(gap(chain), 1e-12)
        """Longest period of a phonon [s]."""

    def separation(self, site: float, other: float) -> float:
        """Return the displacement from the other site [rotor spacings], the shorter on a ring."""
        way = site - other
        return math.remainder(way, self.rotors) if self.periodic else way

    def wrap(self, site: float) -> float:
        """Return the equivalent site between 0 and N on a ring."""
        return site % self.rotors if self.periodic else site

    def edge_distance(self, site: float) -> float:
        """Return the distance from the nearer edge [rotor spacings], infinite for a ring."""
        return math.inf if self.periodic else min(site, self.rotors - 1 - site)

    def nearest_edge(self, site: float) -> float:
        """Return the site of the nearer edge."""
        return 0.0 if site < (self.rotors - 1) / 2 else self.rotors - 1.0

    def rotors_between(self, low: float, high: float, edge: int = 0) -> NDArray[np.int64]:
        """Return the rotors between two sites without some at each edge of a chain.

        The indices of a ring continue below 0 and above N.
        """
        first, last = math.ceil(low), math.floor(high)
        if not self.periodic:
            first, last = max(first, edge), min(last, self.rotors - 1 - edge)
        return np.arange(first, last + 1)

    def midpoint(self, left: float, right: float) -> float:
        """Return the midpoint between a site and the next one on its right."""
        way = right - left
        if self.periodic:
            way %= self.rotors
        return self.wrap(left + way / 2)


class WallFrame:
    """Frame of a chain, from which quantities about its walls are computed on demand."""

    def __init__(
        self,
        reporter: StateReporter,
        line: LatticeCoordinates,
        angles: Array | None,
        rates: Array | None,
        errors: FrameErrors,
    ) -> None:
        """Take angles [rad] and rates [rad/s], shape (N,), None if unknown."""
        self._reporter, self._chain, self._line = reporter, reporter.chain, line
        self._angles, self._rates, self._errors = angles, rates, errors

    def energy(self, sites: Sequence[float]) -> float:
        """Return the energy within reach of walls without noise [J], NaN if unknown."""
        angles, rates = self._angles, self._rates
        if angles is None or rates is None or not np.isfinite(rates).all():
            return math.nan
        return self._reporter.report(angles, sites, rates, self._errors).energies.wall

    def swing(self, site: float, lean: int) -> float:
        """Return the largest swing of a rotor near a site from the state with a lean.

        It is relative to the swing to the opposite state [1], and 0 with unknown rotors.
        """
        if self._angles is None:
            return 0.0
        field, _ = order_field(self._chain, self._angles)
        near = self._line.rotors_between(site - self._line.near, site + self._line.near)
        return float(np.abs(field[near % len(field)] - lean).max() / 2)

    def turn(self, left: float, right: float) -> int:
        """Return the turning sense of a spinner's rotors in the left of two walls, +1 or -1.

        Neighbours differ by less than half a turn from a uniform state. It is 0 for flippers and
        with unknown rotors.
        """
        chain, line, angles = self._chain, self._line, self._angles
        if angles is None or chain.motion is not Motion.SPINNER:
            return 0
        family = 1 if FrameState(chain, angles).twists > 0 else -1
        middle = left + line.separation(line.midpoint(left, right), left)
        rotors = line.rotors_between(left - max(line.near, 2.0), middle) % line.rotors
        steps = np.diff((angles - chain.uniform_state(family))[rotors])
        return int(np.sign(np.sum(wrapped(steps))))
