# SPDX-License-Identifier: Apache-2.0
"""Each wall keeps its name, and what happens to walls is told once."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from soliton_linkage.estimation.estimates import EventKind, SolitonEvent, lost
from soliton_linkage.estimation.lattice import LatticeCoordinates, WallFrame
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.estimation.wall_track import WallMeasurement, WallTrack
from soliton_linkage.estimation.wall_tracker import WallTracker
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.static_wall import site_arc

CHAIN = Chain(60)
RING = Chain(60, periodic=True)
PERIOD = 0.004


class Scene(WallFrame):
    """A frame in which each wall has an energy of 1 J, and that still swings or is at rest."""

    def __init__(self, swing: float = 0.0, turn: int = 0) -> None:
        self._swing, self._turn = swing, turn

    def energy(self, places: Sequence[float]) -> float:
        return float(len(places))

    def swing(self, site: float, lean: int) -> float:
        return self._swing

    def turn(self, left: float, right: float) -> int:
        return self._turn


class Story:
    """Frames shown to a tracker one after the other, and what it made of them."""

    def __init__(self, chain: Chain = CHAIN) -> None:
        line = LatticeCoordinates(chain)
        self.tracker = WallTracker(line, 1 / chain.time_unit, site_arc(chain), 3.0, DEFAULTS)
        self.time = 0.0
        self.events: list[SolitonEvent] = []
        self.charges: list[int] = []
        self.names: dict[int, float] = {}

    def show(self, walls: Sequence[tuple[float, int]], scene: WallFrame | None = None) -> None:
        seen = [
            WallMeasurement(site, 0.01, charge, (math.nan, math.nan)) for site, charge in walls
        ]
        self.time += PERIOD
        shown, events = self.tracker.update(self.time, seen, scene or Scene(), 3)
        self._note(shown, events)

    def follow(self, wall: tuple[float, float] | None) -> None:
        self.time += PERIOD
        seen = []
        if wall:
            estimate = lost(self.time)._replace(site=wall[0], site_rate=wall[1])
            seen = [WallMeasurement(wall[0], math.nan, 1, estimate=estimate)]
        self._note(*self.tracker.update(self.time, seen, Scene(), 1))

    def _note(self, shown: list[WallTrack], events: list[SolitonEvent]) -> None:
        self.events += events
        self.charges.append(sum(each.charge for each in shown))
        self.names = {each.id: each.rotor for each in shown}

    @property
    def kinds(self) -> list[EventKind]:
        return [each.kind for each in self.events]

    def approach(self, start: float, end: float, scene: WallFrame | None = None) -> None:
        """A kink and an anti-kink go from one distance about rotor 30 to another."""
        for half in np.linspace(start, end, 60) / 2:
            self.show([(30 - half, 1), (30 + half, -1)], scene)

    def wait(self, periods: float, swing: float) -> None:
        """Neither is seen for some periods of the slowest phonon, while rotors swing or do not."""
        line = LatticeCoordinates(CHAIN)
        for _ in range(math.ceil(periods * line.period / PERIOD)):
            self.show([], Scene(swing))


BOUNCE = EventKind.BOUNCE


@pytest.mark.parametrize(('turn', 'kind'), [(0, BOUNCE), (1, BOUNCE), (-1, EventKind.PASSING)])
def test_two_that_overlap_and_part_keep_their_sides_or_exchange_them(
    turn: int, kind: EventKind
) -> None:
    story = Story()
    story.approach(30, 3, Scene(turn=abs(turn)))
    story.wait(1, swing=0.5)
    story.approach(3, 30, Scene(turn=turn))
    assert story.kinds == [EventKind.FOUND, EventKind.FOUND, kind]
    met = story.events[-1]
    after = (2, 1) if kind is EventKind.PASSING else (1, 2)
    assert (met.ids_before, met.ids_after, met.collisions) == ((1, 2), after, 1)
    assert (met.energy_before, met.energy_after, met.rotor) == (2.0, 2.0, pytest.approx(30))
    assert story.names == {after[0]: pytest.approx(15), after[1]: pytest.approx(45)}
    assert set(story.charges) == {0}


def test_two_that_turn_back_before_they_overlap_have_bounced() -> None:
    story = Story()
    story.approach(30, 5)
    story.approach(5, 30)
    assert story.kinds[2:] == [BOUNCE]
    assert story.events[-1].collisions == 0


def test_two_that_leave_nothing_but_waves_are_annihilated() -> None:
    story = Story()
    story.approach(30, 3)
    story.wait(3, swing=0.1)
    met = story.events[-1]
    assert story.kinds[2:] == [EventKind.ANNIHILATION]
    assert (met.ids_before, met.ids_after) == ((1, 2), ())
    assert (met.energy_before, met.energy_after) == (2.0, 0.0)


def test_two_that_go_on_swinging_are_a_breather_until_they_do_not() -> None:
    story = Story()
    story.approach(30, 3)
    story.wait(9, swing=0.5)
    assert story.kinds[2:] == [EventKind.BREATHER_FORMED]
    story.wait(3, swing=0.1)
    formed, decayed = story.events[2:]
    assert decayed.kind is EventKind.BREATHER_DECAYED
    assert formed.ids_before == (1, 2)
    assert formed.ids_after == decayed.ids_before == (3,)
    assert decayed.ids_after == ()


def test_a_pair_is_born_only_where_frame_after_frame_shows_it() -> None:
    story = Story()
    story.show([])
    for _ in range(2):
        story.show([(29.0, 1), (32.0, -1)])
    assert not story.names
    story.show([])
    for _ in range(3):
        story.show([(29.0, -1), (32.0, 1)])
    assert story.kinds == [EventKind.BIRTH_OF_PAIR]
    assert story.events[0].ids_after == (1, 2)


@pytest.mark.parametrize('back', [True, False])
def test_a_wall_that_goes_into_an_edge_comes_back_or_dies(back: bool) -> None:
    story = Story()
    for site in np.linspace(20, 1, 80):
        story.follow((float(site), -59.0))
    for _ in range(20):
        story.follow(None)
    if back:
        for site in np.linspace(1, 25, 100):
            story.follow((float(site), 59.0))
        assert story.kinds == [EventKind.FOUND, EventKind.REFLECTION]
        assert story.names == {1: 25.0}
        return
    for _ in range(400):
        story.follow(None)
    assert story.kinds == [EventKind.FOUND, EventKind.DEATH_AT_EDGE]
    died = story.events[-1]
    assert (died.charge_before, died.charge_after, died.energy_before) == (1, 0, 1.0)
    for site in np.linspace(1, 25, 100):
        story.follow((float(site), 59.0))
    assert story.kinds[2:] == [EventKind.BIRTH_AT_EDGE]
    assert story.events[-1].ids_after == (2,)


def test_walls_keep_their_names_all_the_way_round_a_ring() -> None:
    story = Story(RING)
    for shift in np.linspace(0, 150, 1500):
        places = [(float(site + shift) % 60, (-1) ** k) for k, site in enumerate((5, 20, 35, 50))]
        story.show(places)
    assert story.kinds == 4 * [EventKind.FOUND]
    start = {1: 5.0, 2: 20.0, 3: 35.0, 4: 50.0}
    assert story.names == {name: pytest.approx((site + 150) % 60) for name, site in start.items()}


def test_a_wall_that_jumps_beyond_what_was_expected_is_still_the_only_one_it_can_be() -> None:
    story = Story()
    for _ in range(10):
        story.show([(20.0, 1), (40.0, -1)])
    story.show([(20.0, 1), (44.0, -1)])
    assert story.names == {1: pytest.approx(20.0), 2: pytest.approx(44.0)}
    assert len(story.events) == 2
