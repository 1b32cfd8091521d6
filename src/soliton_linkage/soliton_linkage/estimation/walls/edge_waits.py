# SPDX-License-Identifier: Apache-2.0
"""Walls that have gone into an edge, and may come back."""

from __future__ import annotations

import math

from soliton_linkage.estimation.settings import WallSettings
from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.estimation.walls.wall_track import WallTrack


class EdgeWaits:
    """The walls that are at the edges of a chain."""

    def __init__(self, line: WallLine, settings: WallSettings, swing: float) -> None:
        """Begin without any; the swing at an edge takes as long as so many rotor spacings."""
        self._line, self._settings = line, settings
        self._way = swing + 2 * line.edge
        self._waiting: list[tuple[float, WallTrack]] = []
        """When each has been there too long to come back [s]."""

    def __len__(self) -> int:
        """How many there are."""
        return len(self._waiting)

    def add(self, track: WallTrack) -> None:
        """A wall is seen no more that was near an edge."""
        speed = abs(track.place_rate) if math.isfinite(track.place_rate) else 0.0
        patience = self._settings.edge_patience * self._way / max(speed, 1e-9)
        until = track.last_seen + min(patience, self._settings.longest_wait)
        self._waiting.append((until, track))

    def taken(self, rotor: float, charge: int) -> WallTrack | None:
        """The wall that comes back from the edge nearest to a place, None where it is another."""
        edge = self._line.edge_of(rotor)
        for index, (_, track) in enumerate(self._waiting):
            if self._line.edge_of(track.rotor) == edge and track.charge == charge:
                return self._waiting.pop(index)[1]
        return None

    def too_long(self, time: float) -> list[WallTrack]:
        """Walls that will not come back any more, which are forgotten."""
        gone = [track for until, track in self._waiting if time > until]
        self._waiting = [each for each in self._waiting if time <= each[0]]
        return gone
