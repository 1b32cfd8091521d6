# SPDX-License-Identifier: Apache-2.0
"""Follows all walls of a chain: each keeps its name from when it comes until it goes.

Each has a filter of its own, by which it is expected in the next frame; what that shows is paired
with what was expected. What is left over on either side has come or gone: at an edge, where it
may come back, as two that overlap or part, or unseen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from soliton_linkage.estimation.encounter import Encounter
from soliton_linkage.estimation.estimates import EventKind, OrbitEstimate, SolitonEvent
from soliton_linkage.estimation.lattice import LatticeCoordinates, WallFrame
from soliton_linkage.estimation.settings import EstimationSettings, WallSettings
from soliton_linkage.estimation.wall_track import WallMeasurement, WallTrack

_LONGEST_DELAY = 2.0
"""Time within which a wall that left an edge is reported, far from it or not [s]."""
_FORBIDDEN = 1e9
"""Square of deviations [1] between walls that cannot be the same."""


class PredictedWall(NamedTuple):
    """Where a wall is expected."""

    rotor: float
    """Centre [rotor spacings]."""
    variance: float
    """Of the centre [rotor spacings^2]."""
    charge: int
    """+1 or -1."""


def assigned(
    line: LatticeCoordinates,
    expected: Sequence[PredictedWall],
    seen: Sequence[WallMeasurement],
    gate: float,
) -> dict[int, int]:
    """Index of the wall that is seen, by that of the one expected; both without those left over.

    Of all ways to pair walls of the same charge that are no more than a gate [deviations] apart
    it takes that with the most pairs, and of these that with the least sum of squares.
    """
    if not expected or not seen:
        return {}
    costs = np.full((len(expected), len(seen)), _FORBIDDEN)
    for row, wall in enumerate(expected):
        for column, other in enumerate(seen):
            square = line.apart(other.rotor, wall.rotor) ** 2 / wall.variance
            if wall.charge == other.charge and square < gate**2:
                costs[row, column] = square
    pairs = zip(*linear_sum_assignment(costs), strict=True)
    return {int(row): int(column) for row, column in pairs if costs[row, column] < _FORBIDDEN}


class EdgeWalls:
    """The walls that are at the edges of a chain."""

    def __init__(self, line: LatticeCoordinates, settings: WallSettings, swing: float) -> None:
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
        speed = abs(track.site_rate) if math.isfinite(track.site_rate) else 0.0
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


class WallTracker:
    """Names the walls of frames, as they come, and tells what happens to them."""

    def __init__(
        self,
        line: LatticeCoordinates,
        scale: float,
        site_arc: float,
        swing: float,
        settings: EstimationSettings,
    ) -> None:
        """Begin without walls.

        Rates are of the scale [rad/s] and the arc from one rotor to the next is the site arc
        [rad]; the swing at an edge takes as long as a way of so many rotor spacings.
        """
        self._line, self._scale, self._arc, self._swing = line, scale, site_arc, swing
        self._settings, self._walls = settings, settings.walls
        self._next = 1
        self.restart()

    def restart(self) -> None:
        """Forget all walls, as where a new record begins; names are not given again."""
        self._tracks: list[WallTrack] = []
        self._encounters: list[Encounter] = []
        self._waits = EdgeWalls(self._line, self._walls, self._swing)
        self._untold: list[tuple[SolitonEvent, WallTrack]] = []
        self._events: list[SolitonEvent] = []
        self._time, self._frames = math.nan, 0

    def follow(
        self, time: float, wall: OrbitEstimate | None, frame: WallFrame
    ) -> tuple[list[WallTrack], list[SolitonEvent]]:
        """Take a frame [s] that shows one kink, where the orbit has it, or no wall at all.

        Returns the walls with a name that it shows, from rotor 0 on, and what happened.
        """
        if wall is not None and self._goes_on(wall):
            self._time = time
            self._frames += 1
            self._tracks[0].follow(wall, time)
            return list(self._tracks), []
        self._begin(time)
        if wall is not None:
            kinks = [each for each in self._tracks if each.charge > 0 and not self._overlap(each)]
            same = min(kinks, key=lambda each: self._way(each, wall.site), default=None)
            if same is None or self._way(same, wall.site) > self._line.near:
                same = self._new(1)
            same.follow(wall, time)
        for track in self._tracks:
            if track.last_seen != time:
                track.miss()
        return self._resolved(time, frame, 1)

    def _goes_on(self, wall: OrbitEstimate) -> bool:
        """Whether it is the only wall that there was, far from the edges: nothing can happen."""
        if len(self._tracks) != 1 or self._encounters or self._untold or self._waits:
            return False
        track = self._tracks[0]
        free = track.was_free and self._line.edge_distance(wall.site) > self._line.free
        return free and track.id > 0 and self._way(track, wall.site) < self._line.near

    def take(
        self, time: float, seen: Sequence[WallMeasurement], frame: WallFrame
    ) -> tuple[list[WallTrack], list[SolitonEvent]]:
        """Take the walls that a frame [s] shows; returns what `follow` does."""
        elapsed = self._begin(time)
        followed = list(self._tracks)
        expected = [self._expected(track, elapsed) for track in followed]
        pairs = assigned(self._line, expected, seen, self._settings.tracking.gate)
        for row, column in pairs.items():
            followed[row].take(seen[column], time, self._settings.filter)
        left = [track for row, track in enumerate(followed) if row not in pairs]
        others = [wall for column, wall in enumerate(seen) if column not in pairs.values()]
        self._pair_the_rest(left, others, time)
        return self._resolved(time, frame, int(self._settings.tracking.confirming_frames))

    def _pair_the_rest(
        self, left: list[WallTrack], others: list[WallMeasurement], time: float
    ) -> None:
        """Pair walls that are not where they were expected: there is no other that they may be."""
        reach = (self._line.parted / self._settings.tracking.gate) ** 2
        expected = [PredictedWall(each.rotor, reach, each.charge) for each in left]
        pairs = assigned(self._line, expected, others, self._settings.tracking.gate)
        for row, track in enumerate(left):
            if row in pairs:
                track.stop()
                track.take(others[pairs[row]], time, self._settings.filter)
            else:
                track.miss()
        for column, wall in enumerate(others):
            if column not in pairs.values():
                self._new(wall.charge).take(wall, time, self._settings.filter)

    def _begin(self, time: float) -> float:
        elapsed = time - self._time if self._frames else 0.0
        self._time = time
        self._frames += 1
        self._events = []
        return elapsed

    def _new(self, charge: int) -> WallTrack:
        track = WallTrack(self._line, charge, self._scale, self._arc)
        self._tracks.append(track)
        return track

    def _way(self, track: WallTrack, rotor: float) -> float:
        return abs(self._line.apart(track.rotor, rotor))

    def _overlap(self, track: WallTrack) -> Encounter | None:
        """The encounter in which a wall is not seen as it overlaps with another."""
        for each in self._encounters:
            if each.overlaps and track in (each.left, each.right):
                return each
        return None

    def _expected(self, track: WallTrack, elapsed: float) -> PredictedWall:
        encounter = self._overlap(track)
        gate = self._settings.tracking.gate
        if encounter is not None:
            variance = (self._line.parted / gate) ** 2
            return PredictedWall(encounter.site, variance, track.charge)
        site, variance = track.predicted(elapsed)
        unsure = (0.5 * max(self._line.width, 1.0)) ** 2 / gate
        return PredictedWall(site, variance + track.deviation_squared + unsure, track.charge)

    def _resolved(
        self, time: float, frame: WallFrame, needed: int
    ) -> tuple[list[WallTrack], list[SolitonEvent]]:
        """Find out who came and who went, of walls that so many frames have to show or not."""
        self._tracks = [each for each in self._tracks if each.id or each.is_seen]
        self._name_new_ones(time, frame, needed)
        self._look_at_encounters(time, frame)
        self._let_go(time, frame, needed)
        for track in self._waits.too_long(time):
            edge, ids = self._line.edge_of(track.rotor), ((track.id,), ())
            charges, energies = (track.charge, 0), (track.energy, 0.0)
            self._tell(EventKind.DEATH_AT_EDGE, track.last_seen, edge, ids, charges, energies)
        shown = sorted(
            (each for each in self._tracks if each.id and each.is_seen),
            key=lambda each: each.rotor,
        )
        self._note_energies(shown, frame)
        self._find_encounters(time, shown, frame)
        self._tell_those_that_left(time, frame)
        return shown, self._events

    def _name_new_ones(self, time: float, frame: WallFrame, needed: int) -> None:
        """Give names to walls that are sure."""
        new = [each for each in self._tracks if not each.id and self._is_sure(each, needed)]
        for track in sorted(new, key=lambda each: each.rotor):
            if track.id:
                continue
            if self._frames <= needed:
                self._found(track, time, frame)
            elif self._is_at_edge(track):
                self._came_from_edge(track, time)
            else:
                self._came_inside(track, new, time, frame)

    def _is_sure(self, track: WallTrack, needed: int) -> bool:
        """What is read wrongly makes two walls side by side; a wall alone is one."""
        if track.frames >= min(needed, self._frames) or self._is_at_edge(track):
            return True
        return not any(
            each.is_seen and not each.id and each.charge == -track.charge for each in self._tracks
        )

    def _is_at_edge(self, track: WallTrack) -> bool:
        return self._line.edge_distance(track.rotor) < self._line.edge

    def _name(self, track: WallTrack) -> int:
        track.id = self._next
        self._next += 1
        return track.id

    def _tell(
        self,
        kind: EventKind,
        time: float,
        rotor: float,
        ids: tuple[tuple[int, ...], tuple[int, ...]],
        charges: tuple[int, int] = (0, 0),
        energies: tuple[float, float] = (0.0, 0.0),
        collisions: int = 0,
    ) -> None:
        """Tell of an event now, of pairs of what there was before and afterwards."""
        self._events.append(SolitonEvent(kind, time, rotor, *ids, *charges, *energies, collisions))

    def _found(self, track: WallTrack, time: float, frame: WallFrame) -> None:
        energy, ids = frame.energy([track.rotor]), ((), (self._name(track),))
        charges = track.charge, track.charge
        self._tell(EventKind.FOUND, time, track.rotor, ids, charges, (energy, energy))

    def _came_from_edge(self, track: WallTrack, time: float) -> None:
        """A wall that came back, or a new one; it is told of once it is sure to have left."""
        edge, charge = self._line.edge_of(track.rotor), track.charge
        before = self._waits.taken(track.rotor, charge)
        if before is None:
            ids = (self._name(track),)
            event = SolitonEvent(EventKind.BIRTH_AT_EDGE, time, edge, (), ids, 0, charge)
        else:
            track.id, ids = before.id, (before.id,)
            kind, middle = EventKind.REFLECTION, (before.last_seen + time) / 2
            event = SolitonEvent(kind, middle, edge, ids, ids, charge, charge, before.energy)
        self._untold.append((event, track))

    def _came_inside(
        self, track: WallTrack, new: list[WallTrack], time: float, frame: WallFrame
    ) -> None:
        """A wall that nobody saw come, unless another of the opposite charge came beside it."""
        other = self._partner(track, [each for each in new if not each.id])
        if other is None:
            self._found(track, time, frame)
            return
        left, right = self._in_order(track, other)
        ids = (), (self._name(left), self._name(right))
        site = self._line.between(left.rotor, right.rotor)
        energies = 0.0, frame.energy([left.rotor, right.rotor])
        self._tell(EventKind.BIRTH_OF_PAIR, time, site, ids, energies=energies)

    def _partner(self, track: WallTrack, others: Sequence[WallTrack]) -> WallTrack | None:
        """The nearest wall of the opposite charge that is not parted from one."""
        near = [
            each
            for each in others
            if each.charge == -track.charge and self._way(each, track.rotor) < self._line.parted
        ]
        return min(near, key=lambda each: self._way(each, track.rotor), default=None)

    def _in_order(self, one: WallTrack, other: WallTrack) -> tuple[WallTrack, WallTrack]:
        """The left one and the right one."""
        return (one, other) if self._line.apart(other.rotor, one.rotor) > 0 else (other, one)

    def _note_energies(self, shown: list[WallTrack], frame: WallFrame) -> None:
        """Note what a wall that was free had, as it comes near an edge or another wall."""
        for track in shown:
            alone = all(
                self._way(each, track.rotor) > self._line.near
                for each in shown
                if each is not track
            )
            free = alone and self._line.edge_distance(track.rotor) > self._line.free
            if not free and (track.was_free or math.isnan(track.energy)):
                track.energy = frame.energy([track.rotor])
            track.was_free = free

    def _find_encounters(self, time: float, shown: list[WallTrack], frame: WallFrame) -> None:
        """Neighbours of opposite charges that have come near each other."""
        after = [*shown[1:], *shown[:1]] if self._line.periodic else shown[1:]
        for left, right in zip(shown, after, strict=False):
            known = any({left, right} == {each.left, each.right} for each in self._encounters)
            near = 0 < self._line.apart(right.rotor, left.rotor) < self._line.near
            if near and left.charge == -right.charge and not known:
                self._meet(left, right, time, frame)

    def _meet(self, left: WallTrack, right: WallTrack, time: float, frame: WallFrame) -> Encounter:
        energy = frame.energy([left.rotor, right.rotor])
        met = Encounter(self._line, self._walls, left, right, time, energy)
        self._encounters.append(met)
        return met

    def _look_at_encounters(self, time: float, frame: WallFrame) -> None:
        for each in list(self._encounters):
            left, right = each.left, each.right
            if left not in self._tracks or right not in self._tracks:
                self._encounters.remove(each)
                continue
            if each.both_seen:
                each.see(time, frame.turn(left.rotor, right.rotor))
            elif left.missed and right.missed:
                if not each.overlaps:
                    left.stop()
                    right.stop()
                each.overlap(time, frame.swing(each.site, left.charge))
            self._conclude(each, time, frame)

    def _conclude(self, met: Encounter, time: float, frame: WallFrame) -> None:
        """Tell what has become of two that met, if anything has by now."""
        kind = met.outcome(time)
        if kind is EventKind.BREATHER_FORMED:
            self._tell_breather(met, frame)
        elif kind is not None:
            parted = [met.left, met.right] if met.both_seen else []
            ids = met.ids_before, tuple(each.id for each in parted)
            after = frame.energy([each.rotor for each in parted]) if parted else 0.0
            when, energies = time if met.breather else met.when, (met.energy, after)
            self._tell(kind, when, met.site, ids, (0, 0), energies, met.collisions)
        if met.is_over():
            self._encounters.remove(met)
        elif kind in (EventKind.ANNIHILATION, EventKind.BREATHER_DECAYED):
            self._encounters.remove(met)
            self._tracks = [each for each in self._tracks if each not in (met.left, met.right)]

    def _tell_breather(self, met: Encounter, frame: WallFrame) -> None:
        kind, ids = EventKind.BREATHER_FORMED, (met.ids_before, (self._next,))
        met.breather, self._next = self._next, self._next + 1
        energies = met.energy, frame.energy([met.site])
        met.energy = energies[1]
        self._tell(kind, met.when, met.site, ids, (0, 0), energies, met.collisions)

    def _let_go(self, time: float, frame: WallFrame, needed: int) -> None:
        """Find out where walls are that were not seen for long enough."""
        gone = [
            each
            for each in self._tracks
            if each.id and each.missed >= needed and not self._overlap(each)
        ]
        for track in gone:
            if self._overlap(track):
                continue
            if self._is_at_edge(track):
                self._waits.add(track)
                self._tracks.remove(track)
                continue
            others = [each for each in gone if each in self._tracks and not self._overlap(each)]
            other = self._partner(track, others)
            if other is not None:
                self._meet(*self._in_order(track, other), time, frame).overlap(time, 1.0)
                continue
            self._tracks.remove(track)
            charges, ids = (track.charge, track.charge), ((track.id,), ())
            energies = math.nan, math.nan
            self._tell(EventKind.LOST, track.last_seen, track.rotor, ids, charges, energies)

    def _tell_those_that_left(self, time: float, frame: WallFrame) -> None:
        """Tell of walls that came from an edge once they are free of it, or after a while.

        One that is at the edge again has not turned back.
        """
        waiting = []
        for event, track in self._untold:
            free = self._line.edge_distance(track.rotor) > self._line.free
            late = time - event.time > _LONGEST_DELAY
            if event.kind is EventKind.REFLECTION and track.missed and not free:
                continue
            if free or late or track.missed:
                track.energy = frame.energy([track.rotor]) if track.is_seen else track.energy
                self._events.append(replace(event, energy_after=track.energy))
            else:
                waiting.append((event, track))
        self._untold = waiting
