# SPDX-License-Identifier: Apache-2.0
"""Places that compete: weights by evidence, and a mean with the covariance of them all."""

from __future__ import annotations

import math

import numpy as np
import pytest
from chains import FLIPPER, chain_of

from soliton_linkage.estimation.hypotheses import Hypotheses, Hypothesis
from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

ORBIT = UniformOrbit(chain_of(FLIPPER, 20))


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


def test_weights_follow_the_evidence_and_the_mean_follows_the_weights() -> None:
    places = 8.0, 8.5
    made = hypotheses(*(ORBIT.arc_at(each, 0) for each in places))
    odds = 2.0
    made.weigh([0.0, odds])
    share = 1 / (1 + math.exp(-odds))
    wall = made.mixture(0.0, 0.0)
    assert wall.site == pytest.approx(8.0 + 0.5 * share)
    spread = 0.25 * share * (1 - share) + 1e-4 / ORBIT.site_arc**2
    assert wall.site_deviation == pytest.approx(math.sqrt(spread))
    assert ORBIT.site(made.leader.motion.arc) == pytest.approx(8.0)


def test_one_that_is_out_is_forgotten_and_a_better_one_leads() -> None:
    made = hypotheses(ORBIT.arc_at(8.0, 0), ORBIT.arc_at(12.0, 0))
    made.weigh([-5.0, 0.0])
    assert ORBIT.site(made.leader.motion.arc) == pytest.approx(12.0)
    made.weigh([0.0, -8.0])
    assert [ORBIT.site(each.motion.arc) for each in made.all] == pytest.approx([12.0])
    assert made.leader.evidence == 0


def test_the_leg_is_known_once_all_others_are_out() -> None:
    made = hypotheses(*(ORBIT.arc_at(9.0, leg) for leg in (0, 3)))
    assert not made.leg_is_known()
    made.weigh([0.0, -9.0])
    assert made.leg_is_known()


def test_an_edge_rotor_that_is_elsewhere_lets_another_leg_compete() -> None:
    made = hypotheses(ORBIT.arc_at(9.0, 0))
    made.add_toggled()
    assert len(made.all) == 1
    made.leader.view.weights[-1] = 0.0
    made.leader.view = made.leader.view._replace(unbelieved=1)
    made.add_toggled()
    other = made.all[1]
    assert ORBIT.leg(other.motion.arc) == 1
    assert ORBIT.site(other.motion.arc) == pytest.approx(9.0)
    assert other.evidence < -5


def test_the_motion_of_the_mirror_image_goes_the_other_way() -> None:
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
