# SPDX-License-Identifier: Apache-2.0
"""A kink and an anti-kink that are near each other, from when they come near until they part."""

from __future__ import annotations

import math

from soliton_linkage.estimation.estimates import EventKind
from soliton_linkage.estimation.lattice import LatticeCoordinates
from soliton_linkage.estimation.settings import WallSettings
from soliton_linkage.estimation.wall_track import WallTrack


class Encounter:
    """Two neighbours on a chain, the left one and the right one, that are not free."""

    def __init__(
        self,
        line: LatticeCoordinates,
        settings: WallSettings,
        left: WallTrack,
        right: WallTrack,
        time: float,
        energy: float,
    ) -> None:
        """Begin at an instant [s] with the energy [J] within reach of both."""
        self._line, self._settings = line, settings
        self.left, self.right = left, right
        self.energy = energy
        """Within reach of both before, or of the breather as it formed [J]."""
        self.collisions = 0
        """How often they overlapped."""
        self.breather = 0
        """Name of both, 0 unless they are a breather."""
        self.overlaps = False
        """Whether the last frame showed neither."""
        self.when = self._moved = time
        """When they were nearest to each other, or first overlapped [s]."""
        self.site = line.between(left.rotor, right.rotor)
        """Where that was [rotor spacings]."""
        self.passed = False
        """Whether they have passed through each other an odd number of times."""
        self._turn = 0
        self._distance = abs(line.apart(right.rotor, left.rotor))
        self._begun = self._closest = self._distance
        self._onset = self._peak = 0.0
        self._overlapped_since = math.nan

    @property
    def both_seen(self) -> bool:
        """Whether the last frame showed both."""
        return self.left.is_seen and self.right.is_seen

    @property
    def ids_before(self) -> tuple[int, ...]:
        """Names from left to right as they came, or that of the breather."""
        ids = self.left.id, self.right.id
        return (self.breather,) if self.breather else ids[::-1] if self.passed else ids

    def see(self, time: float, turn: int) -> None:
        """Note a frame that shows both, with the sense in which rotors between them turned.

        That is +1 or -1 for spinners, and 0 where it is not known.
        """
        self.overlaps, self._moved = False, time
        self._distance = abs(self._line.apart(self.right.rotor, self.left.rotor))
        self._peak = max(self._peak, self._distance)
        if not self.collisions and self._distance < self._closest:
            self._closest, self.when = self._distance, time
            self.site = self._line.between(self.left.rotor, self.right.rotor)
        if turn and self._turn and turn != self._turn:
            self.passed = not self.passed
            self.left.id, self.right.id = self.right.id, self.left.id
        self._turn = turn or self._turn

    def overlap(self, time: float, swing: float) -> None:
        """Note a frame that shows neither, with the largest swing of a rotor about the place.

        It is over that between the uniform states [1]. Where they were seen to part a little
        only, as noise may make it appear, it is the same collision.
        """
        if not self.overlaps:
            if not self.collisions or self._peak > self._onset + self._line.width / 4:
                self.collisions += 1
            if self.collisions == 1:
                self.when = time
            self._onset, self._peak = self._distance, 0.0
            self._overlapped_since = time
        self.overlaps = True
        if swing > self._settings.lump_share:
            self._moved = time

    def is_over(self) -> bool:
        """Whether they have parted."""
        return self.both_seen and self._distance > self._line.parted

    def met(self) -> bool:
        """Whether they have come so near that they turned back."""
        nearer = self._begun - self._closest
        return self.collisions > 0 or nearer > max(0.2 * self._begun, self._line.width / 2)

    def outcome(self, time: float) -> EventKind | None:
        """What has become of them by now, None while that is open or where nothing has."""
        if self.is_over():
            if self.breather:
                return EventKind.BREATHER_DECAYED
            if not self.met():
                return None
            return EventKind.PASSING if self.passed else EventKind.BOUNCE
        if self.overlaps and time - self._moved > self._settings.quiet_periods * self._line.period:
            return EventKind.BREATHER_DECAYED if self.breather else EventKind.ANNIHILATION
        if not self.breather and self._is_breather(time):
            return EventKind.BREATHER_FORMED
        return None

    def _is_breather(self, time: float) -> bool:
        long = 4 * self._settings.quiet_periods * self._line.period
        lasting = self.overlaps and time - self._overlapped_since > long
        return lasting or self.collisions >= self._settings.breather_collisions
