# SPDX-License-Identifier: Apache-2.0
"""The walls of each frame: one alone as its orbit has it, several each by a fit and a filter."""

from __future__ import annotations

from functools import partial

from soliton_linkage.estimation.orbit_filter import OrbitEstimate
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.walls.soliton_event import SolitonEvent
from soliton_linkage.estimation.walls.wall_detection import domain_borders
from soliton_linkage.estimation.walls.wall_frame import WallFrame
from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.estimation.walls.wall_track import FollowedWall, SeenWall, WallTrack
from soliton_linkage.estimation.walls.wall_tracker import WallTracker
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage.solitons.tanh_fit import find_solitons

Walls = tuple[list[WallTrack], list[SolitonEvent]]
"""Walls that a frame shows, from rotor 0 on, and what happened to them."""


class WallReporter:
    """Follows the walls of a chain through its frames."""

    def __init__(self, chain: Chain, orbit: Orbit | None, settings: EstimationSettings) -> None:
        """Begin without walls; the orbit tells how long one takes to turn back at an edge."""
        self._chain = chain
        self._inside = settings.report.inside
        self.line = WallLine(chain, settings.walls, settings.report)
        self._borders = partial(domain_borders, opposite=settings.walls.opposite)
        arc, swing = _site_arc(chain), 2 * self.line.width
        if orbit is not None:
            begin, end = orbit.leg_arcs(0)
            swing = max((end - begin) / orbit.site_arc - (chain.number_of_rotors - 1), 0.0)
        self._tracker = WallTracker(self.line, 1 / chain.time_unit, arc, swing, settings)

    def restart(self) -> None:
        """Forget all walls, as where a new record begins."""
        self._tracker.restart()

    def on_orbit(self, estimate: OrbitEstimate, frame: WallFrame) -> Walls:
        """The wall on the orbit, none while it is at an edge."""
        inside = self._inside <= estimate.place <= self.line.rotors - 1 - self._inside
        wall = FollowedWall(estimate.place, estimate.place_rate) if inside else None
        return self._tracker.follow(estimate.time, wall, frame)

    def beside_orbit(
        self, time: float, angles: Array, rates: Array | None, frame: WallFrame
    ) -> Walls:
        """All walls that a frame shows at an instant [s], angles [rad] and rates [rad/s], (N,)."""
        spacing = self._chain.spacing
        seen = [
            SeenWall(
                each.rotor,
                each.position_deviation / spacing,
                each.charge,
                each.width,
                each.width_deviation,
            )
            for each in find_solitons(self._chain, angles, rates, self._borders)
        ]
        return self._tracker.take(time, seen, frame)


def _site_arc(chain: Chain) -> float:
    """Arc from one rotor to the next [rad], 1 where it cannot be told."""
    try:
        return site_arc(chain)
    except (ValueError, ArithmeticError):
        return 1.0
