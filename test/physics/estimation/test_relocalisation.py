# SPDX-License-Identifier: Apache-2.0
"""The places that one frame shows: true deviations, and none where nothing tells them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.estimation import relocalisation
from soliton_linkage.estimation.relocalisation import Relocaliser, ScanBudget
from soliton_linkage.estimation.settings import DEFAULTS, TrackingSettings
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

EXAMPLES = [FLIPPER, WOBBLER, SPINNER]


def search_of(orbit: UniformOrbit) -> Relocaliser:
    return Relocaliser(orbit, DEFAULTS.likelihood)


@pytest.mark.parametrize('example', EXAMPLES)
@pytest.mark.parametrize('given', [True, False])
def test_one_frame_places_a_wall_as_well_as_it_states(
    example: tuple[float, float], given: bool
) -> None:
    orbit, random, noise = UniformOrbit(chain_of(example, 20)), np.random.default_rng(1), 0.02
    search, scores = search_of(orbit), []
    for _ in range(60):
        arc = random.uniform(0, orbit.length)
        frame = orbit.configuration(arc) + noise * random.standard_normal(20)
        found = search.find(frame, noise if given else 0.0)
        assert found.probability > 0.9
        site = found.candidates[0]
        assert not site.upside_down
        off = math.remainder(site.arc - arc, orbit.length)
        scores.append(off * math.sqrt(site.view.information) / noise)
    assert 0.7 < math.sqrt(np.mean(np.square(scores))) < 1.3
    assert np.abs(scores).max() < 4.5


def test_legs_compete_where_the_edges_are_not_seen() -> None:
    orbit = UniformOrbit(chain_of(FLIPPER, 20))
    frame = orbit.configuration(orbit.arc_at(9.2, 1))
    frame[[0, -1]] = np.nan
    places = search_of(orbit).find(frame, 0.01).candidates
    alike = [each for each in places if each.evidence > places[0].evidence - 1]
    assert sorted(orbit.leg(each.arc) for each in alike) == [0, 1, 2, 3]
    assert [orbit.site(each.arc) for each in alike] == pytest.approx([9.2] * 4, abs=1e-3)


@pytest.mark.parametrize('example', EXAMPLES)
def test_nothing_is_told_of_what_tells_nothing(example: tuple[float, float]) -> None:
    orbit, random = UniformOrbit(chain_of(example, 24)), np.random.default_rng(2)
    search = search_of(orbit)
    few = np.full(24, np.nan)
    few[5] = orbit.configuration(orbit.arc_at(12.0, 0))[5]
    assert search.find(few, 0.01).probability < 0.5
    assert not search.find(np.full(24, np.nan), 0.01).candidates
    for _ in range(10):
        found = search.find(random.uniform(-math.pi, math.pi, 24), 0.0)
        assert all(each.view.likelihood < each.view.random for each in found.candidates[:1])


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_long_orbit_is_scanned_where_its_uniform_parts_let_it(
    example: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    orbit, random = UniformOrbit(chain_of(example, 60)), np.random.default_rng(3)
    whole = search_of(orbit)
    monkeypatch.setattr(relocalisation, '_MOST_NUMBERS', 1)
    parts = search_of(orbit)
    for site in (0.2, 7.3, 31.6, 58.9):
        leg = int(random.integers(orbit.number_of_legs))
        frame = orbit.configuration(orbit.arc_at(site, leg)) + 0.01 * random.standard_normal(60)
        one, other = (each.find(frame, 0.01).candidates[0] for each in (whole, parts))
        assert math.remainder(one.arc - other.arc, orbit.length) == pytest.approx(0, abs=1e-4)


def test_rotors_far_from_a_wall_do_not_make_it_less_sure() -> None:
    orbit, random = UniformOrbit(chain_of(FLIPPER, 10_000)), np.random.default_rng(4)
    frame = orbit.configuration(orbit.arc_at(2500.0, 0)) + 0.01 * random.standard_normal(10_000)
    found = search_of(orbit).find(frame, 0.0)
    assert found.probability > 0.999
    assert orbit.site(found.candidates[0].arc) == pytest.approx(2500, abs=0.05)


def test_a_budget_is_of_scans_in_a_second_of_stamps() -> None:
    budget = ScanBudget(TrackingSettings(scan_rate=10.0, scan_burst=3.0))
    spent = [budget.spend(0.002 * frame) for frame in range(1000)]
    assert spent[:4] == [True, True, True, False]
    assert sum(spent) == pytest.approx(10 * 2 + 3, abs=1)
    budget.restart()
    assert budget.spend(0.0)
