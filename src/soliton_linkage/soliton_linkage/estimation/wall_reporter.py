# SPDX-License-Identifier: Apache-2.0
"""The walls of each frame: one alone as its orbit has it, several each by a fit and a filter."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np

from soliton_linkage.estimation.estimates import OrbitEstimate, SolitonEvent
from soliton_linkage.estimation.lattice import WallLine
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.state_report import FrameState
from soliton_linkage.estimation.wall_frame import WallFrame
from soliton_linkage.estimation.wall_placing import WallPlacer, borders_of_ring, domain_borders
from soliton_linkage.estimation.wall_shapes import WallShapes
from soliton_linkage.estimation.wall_track import SeenWall, WallTrack
from soliton_linkage.estimation.wall_tracker import WallTracker
from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.orbit.wall_shifts import WallShifts
from soliton_linkage.solitons.static_wall import site_arc

Walls = tuple[list[WallTrack], list[SolitonEvent]]
"""Walls that a frame shows, from rotor 0 on, and what happened to them."""


class WallReporter:
    """Follows the walls of a chain through its frames."""

    def __init__(self, chain: Chain, orbit: Orbit | None, settings: EstimationSettings) -> None:
        """Make the shapes of walls; the orbit tells how long one takes to turn back at an edge."""
        self._chain = chain
        self._inside = settings.report.inside
        self.line = WallLine(chain, settings.walls, settings.report)
        self._opposite = settings.walls.opposite
        plus, minus = couplings(chain)
        self._uniform = (plus**2 - minus**2) / (plus**2 + minus**2)
        arc, swing = _site_arc(chain), 2 * self.line.width
        if orbit is not None:
            begin, end = orbit.leg_arcs(0)
            swing = max((end - begin) / orbit.site_arc - (chain.number_of_rotors - 1), 0.0)
        self._tracker = WallTracker(self.line, 1 / chain.time_unit, arc, swing, settings)
        # Made before the first frame comes: it takes as long as hundreds of them.
        self._placer: WallPlacer | None = None
        with suppress(ValueError, ArithmeticError):
            shifts = WallShifts(orbit) if orbit else None
            self._placer = WallPlacer(self.shapes, self.line, settings, shifts)

    @cached_property
    def shapes(self) -> WallShapes:
        """Shapes of single walls, made where they are first asked for; errors as there."""
        return WallShapes(self._chain)

    def restart(self) -> None:
        """Forget all walls, as where a new record begins."""
        self._tracker.restart()
        if self._placer is not None:
            self._placer.restart()

    def on_orbit(self, estimate: OrbitEstimate, frame: WallFrame) -> Walls:
        """The wall on the orbit, none while it is at an edge."""
        inside = self._inside <= estimate.place <= self.line.rotors - 1 - self._inside
        return self._tracker.follow(estimate.time, estimate if inside else None, frame)

    def beside_orbit(self, time: float, state: FrameState, seen: Array, frame: WallFrame) -> Walls:
        """All walls that a frame shows at an instant [s].

        Its angles as they were seen [rad] are of shape (N,), NaN where they were not.
        """
        walls: list[SeenWall] = []
        if self._placer is not None:
            walls = self._placer.placed(state, seen, self._borders_of(state))
        return self._tracker.take(time, walls, frame)

    def _borders_of(self, state: FrameState) -> list[tuple[float, int]]:
        """Borders of the domains of a state, with the charges there."""
        first, second = state.first**2, state.second**2
        strength = np.maximum(first + second, np.finfo(np.float64).tiny)
        polarised = (first - second) / (strength * self._uniform)
        found = borders_of_ring if self.line.periodic else domain_borders
        return found(polarised, self._opposite)


def _site_arc(chain: Chain) -> float:
    """Arc from one rotor to the next [rad], 1 where it cannot be told."""
    try:
        return site_arc(chain)
    except (ValueError, ArithmeticError):
        return 1.0
