# SPDX-License-Identifier: Apache-2.0
"""Walls that have gone into an edge, and may come back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soliton_linkage.estimation.settings import WallSettings
from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.estimation.walls.wall_track import WallTrack


@dataclass(frozen=True)
class WaitAtEdge:
    """A wall that is at an edge."""

    track: WallTrack
    side: int
    """-1 at the first rotor, +1 at the last."""
    since: float
    """When it was last seen [s]."""
    until: float
    """When it has been there too long to come back [s]."""
    energy: float
    """Within its reach before [J]."""


class EdgeWaits:
    """The walls that are at the edges of a chain."""

    def __init__(self, line: WallLine, settings: WallSettings, swing: float) -> None:
        """Begin without any; the swing at an edge takes as long as so many rotor spacings."""
        self._line, self._settings = line, settings
        self._way = swing + 2 * line.edge
        self._waiting: list[WaitAtEdge] = []

    def __len__(self) -> int:
        """How many there are."""
        return len(self._waiting)

    def add(self, track: WallTrack) -> None:
        """A wall is seen no more that was near an edge."""
        speed = abs(track.place_rate) if math.isfinite(track.place_rate) else 0.0
        longest = self._settings.longest_wait
        patience = min(self._settings.edge_patience * self._way / max(speed, 1e-9), longest)
        self._waiting.append(
            WaitAtEdge(
                track,
                self._line.side(track.rotor),
                track.last_seen,
                track.last_seen + patience,
                track.energy,
            )
        )

    def taken(self, rotor: float, charge: int) -> WaitAtEdge | None:
        """The wall that comes back from the edge nearest to a place, None where it is another."""
        side = self._line.side(rotor)
        for wait in self._waiting:
            if wait.side == side and wait.track.charge == charge:
                self._waiting.remove(wait)
                return wait
        return None

    def too_long(self, time: float) -> list[WaitAtEdge]:
        """Walls that will not come back any more, which are forgotten."""
        gone = [wait for wait in self._waiting if time > wait.until]
        self._waiting = [wait for wait in self._waiting if time <= wait.until]
        return gone
