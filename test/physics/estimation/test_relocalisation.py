# SPDX-License-Identifier: Apache-2.0
"""Relocalisation by one frame, and competing hypotheses."""

import math

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, chain_of
from orbits import uniform_orbit

from soliton_linkage.estimation.hypotheses import Hypotheses, Hypothesis
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.relocalisation import Relocaliser, ScanBudget
from soliton_linkage.estimation.settings import DEFAULTS, TrackingSettings
from soliton_linkage.orbit.uniform_orbit import UniformOrbit


def search_of(orbit: UniformOrbit, **limits: int) -> Relocaliser:
    return Relocaliser(orbit, DEFAULTS.likelihood, **limits)


@pytest.mark.parametrize('example', CLASSES)
def test_one_frame_locates_a_wall_with_the_stated_deviation(example):
    for given in [True, False]:
        orbit, random, noise = uniform_orbit(example, 20), np.random.default_rng(1), 0.02
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


def test_legs_compete_without_edge_rotors():
    orbit = uniform_orbit(FLIPPER, 20)
    frame = orbit.configuration(orbit.arc_at(9.2, 1))
    frame[[0, -1]] = np.nan
    sites = search_of(orbit).find(frame, 0.01).candidates
    alike = [each for each in sites if each.evidence > sites[0].evidence - 1]
    assert sorted(orbit.leg(each.arc) for each in alike) == [0, 1, 2, 3]
    assert [orbit.site(each.arc) for each in alike] == pytest.approx([9.2] * 4, abs=1e-3)


@pytest.mark.parametrize('example', CLASSES)
def test_frames_without_information_give_no_candidate(example):
    orbit, random = uniform_orbit(example, 24), np.random.default_rng(2)
    search = search_of(orbit)
    few = np.full(24, np.nan)
    few[5] = orbit.configuration(orbit.arc_at(12.0, 0))[5]
    assert search.find(few, 0.01).probability < 0.5
    assert not search.find(np.full(24, np.nan), 0.01).candidates
    for _ in range(10):
        found = search.find(random.uniform(-math.pi, math.pi, 24), 0.0)
        assert all(each.view.likelihood < each.view.random for each in found.candidates[:1])


@pytest.mark.parametrize('example', CLASSES)
def test_a_long_orbit_is_scanned_where_the_backgrounds_allow(example):
    orbit, random = uniform_orbit(example, 60), np.random.default_rng(3)
    whole, parts = search_of(orbit), search_of(orbit, most_angles=1)
    for site in (0.2, 7.3, 31.6, 58.9):
        leg = int(random.integers(orbit.number_of_legs))
        frame = orbit.configuration(orbit.arc_at(site, leg)) + 0.01 * random.standard_normal(60)
        one, other = (each.find(frame, 0.01).candidates[0] for each in (whole, parts))
        assert math.remainder(one.arc - other.arc, orbit.length) == pytest.approx(0, abs=1e-4)


def test_distant_rotors_do_not_reduce_the_probability():
    orbit, random = UniformOrbit(chain_of(FLIPPER, 10_000)), np.random.default_rng(4)
    frame = orbit.configuration(orbit.arc_at(2500.0, 0)) + 0.01 * random.standard_normal(10_000)
    found = search_of(orbit).find(frame, 0.0)
    assert found.probability > 0.999
    assert orbit.site(found.candidates[0].arc) == pytest.approx(2500, abs=0.05)


def test_the_budget_limits_searches_per_second_of_stamps():
    budget = ScanBudget(TrackingSettings(scan_rate=10.0, confirming_frames=3))
    spent = [budget.spend(0.002 * frame) for frame in range(1000)]
    assert spent[:4] == [True, True, True, False]
    assert sum(spent) == pytest.approx(10 * 2 + 3, abs=1)
    budget.restart()
    assert budget.spend(0.0)


ORBIT = uniform_orbit(FLIPPER, 20)


def hypotheses(*arcs: float) -> Hypotheses:
    made = Hypotheses(ORBIT, DEFAULTS)
    for arc in arcs:
        about = ORBIT.segment(arc)
        view = FrameLikelihood(2.0, DEFAULTS.likelihood).linearise(
            arc, about.first, about.tangent, np.zeros(20), 1e-4
        )
        motion = MultipleModelFilter(arc, 1e-4, 50.0, ORBIT.site_arc)
        made.all.append(Hypothesis(motion, False, view, 0.0))
    return made


def test_the_mixture_is_weighted_by_the_evidence():
    sites = 8.0, 8.5
    made = hypotheses(*(ORBIT.arc_at(each, 0) for each in sites))
    odds = 2.0
    made.weigh([0.0, odds])
    share = 1 / (1 + math.exp(-odds))
    wall = made.mixture(0.0, 0.0)
    assert wall.site == pytest.approx(8.0 + 0.5 * share)
    spread = 0.25 * share * (1 - share) + 1e-4 / ORBIT.site_arc**2
    assert wall.site_deviation == pytest.approx(math.sqrt(spread))
    assert ORBIT.site(made.leader.motion.arc) == pytest.approx(8.0)


def test_refuted_hypotheses_are_removed_and_the_best_one_leads():
    made = hypotheses(ORBIT.arc_at(8.0, 0), ORBIT.arc_at(12.0, 0))
    made.weigh([-5.0, 0.0])
    assert ORBIT.site(made.leader.motion.arc) == pytest.approx(12.0)
    made.weigh([0.0, -DEFAULTS.filter.decisive_odds])
    assert [ORBIT.site(each.motion.arc) for each in made.all] == pytest.approx([12.0])
    assert made.leader.evidence == 0


def test_the_leg_is_known_after_all_others_are_refuted():
    made = hypotheses(*(ORBIT.arc_at(9.0, leg) for leg in (0, 3)))
    assert not made.leg_is_known()
    made.weigh([0.0, -9.0])
    assert made.leg_is_known()


def test_a_disagreeing_edge_rotor_adds_a_leg():
    made = hypotheses(ORBIT.arc_at(9.0, 0))
    made.add_toggled()
    assert len(made.all) == 1
    made.leader.view.weights[-1] = 0.0
    made.leader.view = made.leader.view._replace(outliers=1)
    made.add_toggled()
    other = made.all[1]
    assert ORBIT.leg(other.motion.arc) == 1
    assert ORBIT.site(other.motion.arc) == pytest.approx(9.0)
    assert other.evidence < -5


def test_the_mirror_image_moves_in_the_opposite_direction():
    motion = MultipleModelFilter(3.0, 1e-4, 50.0, 1.0)
    for frame in range(1, 200):
        motion.predict(1e-3, False)
        motion.update(3.0 + 9.6e-3 * frame, 1e-4)
    arc, rate, *covariance = motion.summary
    mirrored = motion.mirrored(-arc).summary
    assert mirrored == pytest.approx((-arc, -rate, *covariance), rel=1e-9)
    for frame in range(200, 300):
        for sense, each in ((1, motion), (-1, motion.mirrored(-motion.arc))):
            each.predict(1e-3, False)
            assert each.expected == pytest.approx(sense * (3.0 + 9.6e-3 * frame), abs=0.01)
            if sense == 1:
                each.update(3.0 + 9.6e-3 * frame, 1e-4)


@pytest.mark.parametrize('unknown', [1e6, 1e300, math.nan])
def test_a_hypothesis_without_a_known_position_is_dropped(unknown):
    made = hypotheses(3.0, 9.0, 12.0)
    for each in made.all:
        each.motion.predict(1e-3, False)
    made.all[1].motion.add_rate_noise(unknown, 1e3)
    made.all[1].motion.predict(1e-3, False)
    expected = [made.all[0], made.all[2]]
    made.drop_unknown(ORBIT.length**2)
    assert made.all == expected
