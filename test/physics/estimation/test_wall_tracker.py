# SPDX-License-Identifier: Apache-2.0
"""Wall tracker: identifiers, events, assignment, domains, and energies of walls."""

import math
from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
import pytest

from soliton_linkage.estimation.estimates import EventKind, SolitonEvent, lost
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.estimation.shape_model import domain_borders
from soliton_linkage.estimation.state_report import EXACT, StateReporter, energy_reach
from soliton_linkage.estimation.wall_shapes import find_domains
from soliton_linkage.estimation.wall_track import (
    LatticeCoordinates,
    WallFrame,
    WallMeasurement,
    WallTrack,
)
from soliton_linkage.estimation.wall_tracker import PredictedWall, WallTracker, assign
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import site_arc, static_wall

CHAIN = Chain(60)
RING = Chain(60, periodic=True)
PERIOD = 0.004


class Scene(WallFrame):
    """Frame in which each wall has an energy of 1 J, with a given swing and turn."""

    def __init__(self, swing: float = 0.0, turn: int = 0) -> None:
        self._swing, self._turn = swing, turn

    def energy(self, sites: Sequence[float]) -> float:
        return float(len(sites))

    def swing(self, site: float, lean: int) -> float:
        return self._swing

    def turn(self, left: float, right: float) -> int:
        return self._turn


class Story:
    """Successive frames of a tracker, and their results."""

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
        """Move a kink and an anti-kink from one distance about rotor 30 to another."""
        for half in np.linspace(start, end, 60) / 2:
            self.show([(30 - half, 1), (30 + half, -1)], scene)

    def wait(self, periods: float, swing: float) -> None:
        """Show neither wall for some phonon periods, with a swing of the rotors."""
        line = LatticeCoordinates(CHAIN)
        for _ in range(math.ceil(periods * line.period / PERIOD)):
            self.show([], Scene(swing))


BOUNCE = EventKind.BOUNCE


@pytest.mark.parametrize(('turn', 'kind'), [(0, BOUNCE), (1, BOUNCE), (-1, EventKind.PASSING)])
def test_overlapping_walls_bounce_or_pass(turn, kind):
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


def test_walls_that_turn_back_before_overlap_have_bounced():
    story = Story()
    story.approach(30, 5)
    story.approach(5, 30)
    assert story.kinds[2:] == [BOUNCE]
    assert story.events[-1].collisions == 0


def test_walls_that_leave_only_waves_are_annihilated():
    story = Story()
    story.approach(30, 3)
    story.wait(3, swing=0.1)
    met = story.events[-1]
    assert story.kinds[2:] == [EventKind.ANNIHILATION]
    assert (met.ids_before, met.ids_after) == ((1, 2), ())
    assert (met.energy_before, met.energy_after) == (2.0, 0.0)


def test_walls_that_continue_to_oscillate_are_a_breather():
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


def test_a_new_pair_is_confirmed_by_three_frames():
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
def test_a_wall_at_an_edge_is_reflected_or_dies(back):
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


def test_walls_keep_their_identifiers_round_a_ring():
    story = Story(RING)
    for shift in np.linspace(0, 150, 1500):
        sites = [(float(site + shift) % 60, (-1) ** k) for k, site in enumerate((5, 20, 35, 50))]
        story.show(sites)
    assert story.kinds == 4 * [EventKind.FOUND]
    start = {1: 5.0, 2: 20.0, 3: 35.0, 4: 50.0}
    assert story.names == {name: pytest.approx((site + 150) % 60) for name, site in start.items()}


def test_a_wall_that_jumps_keeps_its_identifier():
    story = Story()
    for _ in range(10):
        story.show([(20.0, 1), (40.0, -1)])
    story.show([(20.0, 1), (44.0, -1)])
    assert story.names == {1: pytest.approx(20.0), 2: pytest.approx(44.0)}
    assert len(story.events) == 2


LINE = LatticeCoordinates(Chain(60))
RING_LINE = LatticeCoordinates(Chain(60, periodic=True))


def seen(rotor: float, charge: int) -> WallMeasurement:
    return WallMeasurement(rotor, 0.01, charge, (math.nan, math.nan))


def test_the_assignment_has_the_least_sum_of_squares():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        before, after = rng.uniform(20, 30, (2, 4))
        expected = [PredictedWall(site, 4.0, 1) for site in before]
        pairs = assign(LINE, expected, [seen(site, 1) for site in after], 100.0)

        squares = (after[:, None] - before) ** 2
        ways = {order: squares[list(order), range(4)].sum() for order in permutations(range(4))}
        assert ways[tuple(pairs[row] for row in range(4))] == min(ways.values())


def test_walls_of_another_charge_or_beyond_the_gate_are_not_assigned():
    expected = [PredictedWall(10.0, 0.25, 1), PredictedWall(20.0, 0.25, -1)]
    shown = [seen(10.5, -1), seen(10.8, 1), seen(22.5, -1)]
    assert assign(LINE, expected, shown, 4.0) == {0: 1}


def test_the_shorter_way_round_a_ring_counts():
    expected = [PredictedWall(59.8, 0.25, 1)]
    assert assign(RING_LINE, expected, [seen(0.3, 1)], 4.0) == {0: 0}
    assert assign(LINE, expected, [seen(0.3, 1)], 4.0) == {}


OPPOSITE = DEFAULTS.walls.domain_bonds


def value(polarised: Array, leans: Array, cost: float) -> float:
    return float(np.clip(polarised, -1, 1) @ leans) - cost * np.count_nonzero(np.diff(leans))


def test_the_division_into_domains_is_optimal():
    for seed in range(4):
        polarised = np.random.default_rng(seed).normal(0, 1.2, 10)
        right = np.empty(10, dtype=np.bool_)
        find_domains(polarised, OPPOSITE, right)
        found = value(polarised, np.where(right, 1.0, -1.0), OPPOSITE)
        others = (
            value(polarised, np.array(each), OPPOSITE) for each in product((-1.0, 1.0), repeat=10)
        )
        assert found == pytest.approx(max(others), abs=1e-12)


def test_two_opposite_bonds_are_no_domain_and_three_are():
    polarised = np.ones(20)
    polarised[8:10] = -1
    assert domain_borders(polarised, OPPOSITE) == []
    polarised[10] = -1
    assert domain_borders(polarised, OPPOSITE) == [(8.0, 1), (11.0, -1)]


def test_borders_are_zeros_of_the_polarisation_with_alternating_charges():
    polarised = np.tanh((np.arange(40) - 12.25) / 2) * np.tanh((np.arange(40) - 30.5) / 2)
    sites, charges = zip(*domain_borders(polarised, OPPOSITE), strict=True)
    assert charges == (1, -1)
    np.testing.assert_allclose(sites, (12.75, 31.0), atol=0.01)


SPINNER = Chain(80, rotor_length=0.2, rest_angle=1.18)


def frame_of(chain: Chain, angles: Array, rates: Array | None) -> WallFrame:
    line = LatticeCoordinates(chain)
    return WallFrame(StateReporter(chain), line, angles, rates, EXACT)


def near(where: Array, sites: list[float], reach: float) -> Array:
    """Return which sites on the ring are within reach of the others."""
    ways = where[:, None] - np.array(sites)
    ways -= 60 * np.rint(ways / 60)
    return np.asarray((np.abs(ways) <= reach).any(axis=1))


def test_the_energy_of_walls_is_the_energy_within_reach():
    rng = np.random.default_rng(1)
    angles = RING.uniform_state(1) + rng.normal(0, 0.1, 60)
    rates = rng.normal(0, 1.0, 60)
    frame = frame_of(RING, angles, rates)
    kinetic = 0.5 * RING.moments_of_inertia * rates**2
    elastic = 0.5 * RING.stiffnesses * RING.springs(angles)[0] ** 2
    reach = energy_reach(RING)
    for sites in ([58.3], [2.0, 30.7], [5.0 * n for n in range(12)]):
        whole = sum(
            energy[near(np.arange(60) + beyond, sites, reach)].sum()
            for energy, beyond in ((kinetic, 0.0), (elastic, 0.5))
        )
        assert frame.energy(sites) == pytest.approx(whole, rel=1e-12)
    assert np.isnan(frame_of(RING, angles, None).energy([3.0]))


def test_the_turning_sense_agrees_with_the_rotors_in_the_wall():
    for leg in [0, 1]:
        angles = static_wall(SPINNER, 30.4, leg)
        before = SPINNER.uniform_state(1)
        turned = np.unwrap((angles - before)[5:60])
        frame = frame_of(SPINNER, angles, None)
        assert frame.turn(30.4, 70.0) == np.sign(turned[-1] - turned[0])


@pytest.mark.parametrize('periods', [0.3, 1.0, 4.0])
def test_the_rate_of_a_resting_wall_among_waves_agrees_with_its_deviation(periods):
    line, amplitude, scores = LatticeCoordinates(CHAIN), 0.02, []
    frames = round(periods * line.period / PERIOD)
    for phase in np.linspace(0, 2 * math.pi, 8, endpoint=False):
        track = WallTrack(line, -1, 1 / CHAIN.time_unit, site_arc(CHAIN), DEFAULTS)
        for frame in range(frames + 1):
            time = frame * PERIOD
            if frame:
                track.predict(PERIOD)
            site = 30 + amplitude * math.sin(phase + 2 * math.pi * time / line.period)
            wall = WallMeasurement(site, 0.001, -1, bias=amplitude**2 / 2)
            track.update(wall, time)
        scores.append(track.rate / track.rate_deviation)
    assert np.sqrt(np.mean(np.square(scores))) < 2


@pytest.mark.parametrize('amplitude', [0.05, 0.15])
def test_the_rate_of_an_anti_kink_in_a_well_agrees_with_its_deviation(amplitude):
    line, barrier, scores = LatticeCoordinates(CHAIN), 2.0, []
    random = np.random.default_rng(1)
    track = WallTrack(line, -1, 1 / CHAIN.time_unit, site_arc(CHAIN), DEFAULTS)
    for frame in range(1500):
        phase = math.pi * barrier * PERIOD * frame
        if frame:
            track.predict(PERIOD)
        site = 30 + amplitude * math.sin(phase) + 0.005 * random.standard_normal()
        track.update(WallMeasurement(site, 0.005, -1, pinning=barrier), PERIOD * frame)
        rate = math.pi * barrier * amplitude * math.cos(phase)
        scores.append((track.rate - rate) / track.rate_deviation)
    assert 0.5 < np.sqrt(np.mean(np.square(scores[100:]))) < 1.5


def test_the_displacement_of_a_pinned_anti_kink_from_its_rest_site_is_uncertain():
    line = LatticeCoordinates(CHAIN)
    for rest, low, high in ((math.nan, 0.0, 0.01), (0.8, 0.0, 0.01), (0.5, 0.28, 0.32)):
        track = WallTrack(line, -1, 1 / CHAIN.time_unit, site_arc(CHAIN), DEFAULTS)
        for frame in range(20):
            if frame:
                track.predict(PERIOD)
            track.update(WallMeasurement(20.8, 0.01, -1, rest=rest), frame * PERIOD)
        assert low < track.deviation < high
