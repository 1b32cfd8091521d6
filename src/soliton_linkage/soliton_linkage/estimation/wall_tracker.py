# SPDX-License-Identifier: Apache-2.0
"""Tracker of all walls of a chain, which detects events such as reflections and collisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from soliton_linkage.estimation.estimates import EventKind, SolitonEvent
from soliton_linkage.estimation.orbit_model import ComplianceCorrection
from soliton_linkage.estimation.settings import EstimationSettings
from soliton_linkage.estimation.wall_track import (
    Encounter,
    LatticeCoordinates,
    WallFrame,
    WallMeasurement,
    WallTrack,
)

_LONGEST_DELAY = 2.0
"""Longest delay of the report of a birth or a reflection at an edge [s]."""
_FORBIDDEN = 1e9
"""Cost of a forbidden assignment [1], larger than the cost of any allowed one."""


class PredictedWall(NamedTuple):
    """Prediction of a wall in the next frame."""

    rotor: float
    """Predicted site of the centre of the wall [rotor spacings]."""
    variance: float
    """Variance of the predicted site [rotor spacings^2]."""
    charge: int
    """Charge of the wall, +1 or -1."""


def assign(
    line: LatticeCoordinates,
    predicted: Sequence[PredictedWall],
    seen: Sequence[WallMeasurement],
    gate: float,
) -> dict[int, int]:
    """Assign measured walls to predicted walls.

    Return a dict that maps the index of a predicted wall to the index of its measured wall. The
    walls of a pair have equal charges, and their sites differ by less than `gate` predicted
    standard deviations. The result has the largest possible number of pairs. Of all such
    assignments, it has the least sum of squared differences divided by the predicted variances.
    """
    if not predicted or not seen:
        return {}
    costs = np.full((len(predicted), len(seen)), _FORBIDDEN)
    for row, wall in enumerate(predicted):
        for column, other in enumerate(seen):
            square = line.separation(other.rotor, wall.rotor) ** 2 / wall.variance
            if wall.charge == other.charge and square < gate**2:
                costs[row, column] = square
    pairs = zip(*linear_sum_assignment(costs), strict=True)
    return {int(row): int(column) for row, column in pairs if costs[row, column] < _FORBIDDEN}


class WallTracker:
    """Tracker of all walls of a chain."""

    def __init__(
        self,
        line: LatticeCoordinates,
        scale: float,
        site_arc: float,
        swing: float,
        settings: EstimationSettings,
        compliance: ComplianceCorrection | None = None,
    ) -> None:
        """Start without walls.

        `scale` is the typical rate [rad/s], and `site_arc` the arc length per rotor spacing [rad].
        `swing` is the arc length of a reflection at an edge, divided by `site_arc` [1].
        """
        self._line, self._scale, self._arc = line, scale, site_arc
        self._edge_way = swing + 2 * line.near
        self._settings, self._gate = settings, settings.noise.significance
        self._compliance = compliance
        self._next = 1
        self.restart()

    def restart(self) -> None:
        """Discard all walls; their identifiers are not used again."""
        self._tracks: list[WallTrack] = []
        self._encounters: list[Encounter] = []
        self._at_edges: list[tuple[float, WallTrack]] = []
        self._pending: list[tuple[SolitonEvent, WallTrack]] = []
        self._events: list[SolitonEvent] = []
        self._time, self._frames = math.nan, 0

    def update(
        self, time: float, seen: Sequence[WallMeasurement], frame: WallFrame, confirming: int
    ) -> tuple[list[WallTrack], list[SolitonEvent]]:
        """Update the tracks with the walls `seen` in a frame.

        Return the tracks of confirmed walls that the frame shows, sorted by site, and the events
        that the frame confirms. A new wall is confirmed after at most `confirming` frames.
        """
        elapsed = time - self._time if self._frames else 0.0
        self._time, self._events = time, []
        self._frames += 1
        if self._is_undisturbed(seen):
            self._tracks[0].update(seen[0], time)
            return list(self._tracks), []
        tracks, line = list(self._tracks), self._line
        predicted = [self._predict(track, elapsed) for track in tracks]
        pairs = assign(line, predicted, seen, self._gate)
        for row, column in pairs.items():
            tracks[row].update(seen[column], time)
        # Assign the remaining walls with a wide gate, because they may have moved unexpectedly.
        left = [track for row, track in enumerate(tracks) if row not in pairs]
        others = [wall for column, wall in enumerate(seen) if column not in pairs.values()]
        variance = (line.parted / self._gate) ** 2
        predicted = [PredictedWall(each.rotor, variance, each.charge) for each in left]
        pairs = assign(line, predicted, others, self._gate)
        for row, track in enumerate(left):
            if row in pairs:
                track.stop()
                track.update(others[pairs[row]], time)
            else:
                track.missed += 1
        for column, wall in enumerate(others):
            if column not in pairs.values():
                track = self._new_track(wall.charge)
                track.update(wall, time)
                self._tracks.append(track)
        return self._resolve(time, frame, confirming)

    def _new_track(self, charge: int) -> WallTrack:
        given = self._line, charge, self._scale, self._arc, self._settings
        return WallTrack(*given, self._compliance if charge > 0 else None)

    def _is_undisturbed(self, seen: Sequence[WallMeasurement]) -> bool:
        if len(self._tracks) != 1 or len(seen) != 1 or seen[0].estimate is None:
            return False
        if self._encounters or self._pending or self._at_edges:
            return False
        track, site = self._tracks[0], seen[0].rotor
        free = track.was_free and self._line.edge_distance(site) > self._line.near
        same = track.charge == seen[0].charge and self._distance(track, site) < self._line.near
        return free and same and track.id > 0

    def _distance(self, track: WallTrack, rotor: float) -> float:
        return abs(self._line.separation(track.rotor, rotor))

    def _overlap(self, track: WallTrack) -> Encounter | None:
        for each in self._encounters:
            if each.overlaps and track in (each.left, each.right):
                return each
        return None

    def _predict(self, track: WallTrack, elapsed: float) -> PredictedWall:
        encounter = self._overlap(track)
        if encounter is not None:
            variance = (self._line.parted / self._gate) ** 2
            return PredictedWall(encounter.site, variance, track.charge)
        site, variance = track.predict(elapsed)
        margin = (0.5 * max(self._line.width, 1.0)) ** 2 / self._gate
        return PredictedWall(site, variance + margin, track.charge)

    def _resolve(
        self, time: float, frame: WallFrame, confirming: int
    ) -> tuple[list[WallTrack], list[SolitonEvent]]:
        self._tracks = [each for each in self._tracks if each.id or each.is_seen]
        self._identify_new(time, frame, confirming)
        self._update_encounters(time, frame)
        self._resolve_missing(time, frame, confirming)
        for until, track in self._at_edges:
            if time > until:
                edge, ids = self._line.nearest_edge(track.rotor), ((track.id,), ())
                death = EventKind.DEATH_AT_EDGE, track.last_seen, edge, *ids
                self._events.append(SolitonEvent(*death, track.charge, 0, track.energy))
        self._at_edges = [each for each in self._at_edges if time <= each[0]]
        shown = sorted(
            (each for each in self._tracks if each.id and each.is_seen),
            key=lambda each: each.rotor,
        )
        self._record_energies(shown, frame)
        self._find_encounters(time, shown, frame)
        self._report_pending(time, frame)
        return shown, self._events

    def _identify_new(self, time: float, frame: WallFrame, confirming: int) -> None:
        new = [each for each in self._tracks if not each.id and self._confirmed(each, confirming)]
        for track in sorted(new, key=lambda each: each.rotor):
            if track.id:
                continue
            if self._frames <= confirming:
                self._add_found(track, time, frame)
            elif self._is_at_edge(track):
                self._add_from_edge(track, time)
            else:
                self._add_inside(track, new, time, frame)

    def _confirmed(self, track: WallTrack, confirming: int) -> bool:
        """Return whether a new wall is confirmed.

        Only a pair of new walls of opposite charge inside the chain needs `confirming` frames.
        """
        if track.frames >= min(confirming, self._frames) or self._is_at_edge(track):
            return True
        return not any(
            each.is_seen and not each.id and each.charge == -track.charge for each in self._tracks
        )

    def _is_at_edge(self, track: WallTrack) -> bool:
        return self._line.edge_distance(track.rotor) < self._line.near

    def _name(self, track: WallTrack) -> int:
        track.id = self._next
        self._next += 1
        return track.id

    def _add_found(self, track: WallTrack, time: float, frame: WallFrame) -> None:
        energy, found = frame.energy([track.rotor]), (EventKind.FOUND, time, track.rotor)
        ids, charges = ((), (self._name(track),)), (track.charge, track.charge)
        self._events.append(SolitonEvent(*found, *ids, *charges, energy, energy))

    def _add_from_edge(self, track: WallTrack, time: float) -> None:
        edge, charge = self._line.nearest_edge(track.rotor), track.charge
        for index, (_, before) in enumerate(self._at_edges):
            if self._line.nearest_edge(before.rotor) == edge and before.charge == charge:
                del self._at_edges[index]
                track.id, ids = before.id, (before.id,)
                kind, middle = EventKind.REFLECTION, (before.last_seen + time) / 2
                event = SolitonEvent(kind, middle, edge, ids, ids, charge, charge, before.energy)
                break
        else:
            ids = (self._name(track),)
            event = SolitonEvent(EventKind.BIRTH_AT_EDGE, time, edge, (), ids, 0, charge)
        self._pending.append((event, track))

    def _add_inside(
        self, track: WallTrack, new: list[WallTrack], time: float, frame: WallFrame
    ) -> None:
        other = self._partner(track, [each for each in new if not each.id])
        if other is None:
            self._add_found(track, time, frame)
            return
        left, right = self._in_order(track, other)
        ids = (), (self._name(left), self._name(right))
        site = self._line.midpoint(left.rotor, right.rotor)
        energy = frame.energy([left.rotor, right.rotor])
        birth = SolitonEvent(EventKind.BIRTH_OF_PAIR, time, site, *ids, energy_after=energy)
        self._events.append(birth)

    def _partner(self, track: WallTrack, others: Sequence[WallTrack]) -> WallTrack | None:
        near = [
            each
            for each in others
            if each.charge == -track.charge
            and self._distance(each, track.rotor) < self._line.parted
        ]
        return min(near, key=lambda each: self._distance(each, track.rotor), default=None)

    def _in_order(self, one: WallTrack, other: WallTrack) -> tuple[WallTrack, WallTrack]:
        return (one, other) if self._line.separation(other.rotor, one.rotor) > 0 else (other, one)

    def _record_energies(self, shown: list[WallTrack], frame: WallFrame) -> None:
        for track in shown:
            single = all(
                self._distance(each, track.rotor) > self._line.near
                for each in shown
                if each is not track
            )
            free = single and self._line.edge_distance(track.rotor) > self._line.near
            if not free and (track.was_free or math.isnan(track.energy)):
                track.energy = frame.energy([track.rotor])
            track.was_free = free

    def _find_encounters(self, time: float, shown: list[WallTrack], frame: WallFrame) -> None:
        after = [*shown[1:], *shown[:1]] if self._line.periodic else shown[1:]
        for left, right in zip(shown, after, strict=False):
            known = any({left, right} == {each.left, each.right} for each in self._encounters)
            near = 0 < self._line.separation(right.rotor, left.rotor) < self._line.near
            if near and left.charge == -right.charge and not known:
                self._meet(left, right, time, frame)

    def _meet(self, left: WallTrack, right: WallTrack, time: float, frame: WallFrame) -> Encounter:
        energy = frame.energy([left.rotor, right.rotor])
        met = Encounter(self._line, self._settings.walls, left, right, time, energy)
        self._encounters.append(met)
        return met

    def _update_encounters(self, time: float, frame: WallFrame) -> None:
        for each in list(self._encounters):
            left, right = each.left, each.right
            if left not in self._tracks or right not in self._tracks:
                self._encounters.remove(each)
                continue
            if each.both_seen:
                each.add_seen(time, frame.turn(left.rotor, right.rotor))
            elif left.missed and right.missed:
                if not each.overlaps:
                    left.stop()
                    right.stop()
                each.add_overlap(time, frame.swing(each.site, left.charge))
            self._conclude(each, time, frame)

    def _conclude(self, met: Encounter, time: float, frame: WallFrame) -> None:
        kind = met.outcome(time)
        if kind is EventKind.BREATHER_FORMED:
            pair, before = met.ids_before, met.energy
            met.breather, self._next = self._next, self._next + 1
            met.energy = frame.energy([met.site])
            formed = kind, met.when, met.site, pair, (met.breather,)
            self._events.append(SolitonEvent(*formed, 0, 0, before, met.energy, met.collisions))
        elif kind is not None:
            parted = [met.left, met.right] if met.both_seen else []
            ids = met.ids_before, tuple(each.id for each in parted)
            after = frame.energy([each.rotor for each in parted]) if parted else 0.0
            when = time if met.breather else met.when
            ended = kind, when, met.site, *ids, 0, 0, met.energy, after, met.collisions
            self._events.append(SolitonEvent(*ended))
        if met.is_over():
            self._encounters.remove(met)
        elif kind in (EventKind.ANNIHILATION, EventKind.BREATHER_DECAYED):
            self._encounters.remove(met)
            self._tracks = [each for each in self._tracks if each not in (met.left, met.right)]

    def _resolve_missing(self, time: float, frame: WallFrame, confirming: int) -> None:
        gone = [
            each
            for each in self._tracks
            if each.id and each.missed >= confirming and not self._overlap(each)
        ]
        for track in gone:
            if self._overlap(track):
                continue
            if self._is_at_edge(track):
                speed = abs(track.rate) if math.isfinite(track.rate) else 0.0
                walls = self._settings.walls
                patience = walls.edge_patience * self._edge_way / max(speed, 1e-9)
                until = track.last_seen + min(patience, walls.longest_wait)
                self._at_edges.append((until, track))
                self._tracks.remove(track)
                continue
            others = [each for each in gone if each in self._tracks and not self._overlap(each)]
            other = self._partner(track, others)
            if other is not None:
                met = self._meet(*self._in_order(track, other), time, frame)
                met.add_overlap(time, 1.0)
                continue
            self._tracks.remove(track)
            lost = EventKind.LOST, track.last_seen, track.rotor, (track.id,), ()
            charges = track.charge, track.charge
            self._events.append(SolitonEvent(*lost, *charges, math.nan, math.nan))

    def _report_pending(self, time: float, frame: WallFrame) -> None:
        waiting = []
        for event, track in self._pending:
            free = self._line.edge_distance(track.rotor) > self._line.near
            late = time - event.time > _LONGEST_DELAY
            if event.kind is EventKind.REFLECTION and track.missed and not free:
                continue
            if free or late or track.missed:
                track.energy = frame.energy([track.rotor]) if track.is_seen else track.energy
                self._events.append(replace(event, energy_after=track.energy))
            else:
                waiting.append((event, track))
        self._pending = waiting
