# SPDX-License-Identifier: Apache-2.0
"""Torques of actuators on some rotors: their force, deflection and reach."""

import math

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, WIDE_SPINNER
from hypothesis import given, settings
from hypothesis import strategies as st
from orbits import uniform_orbit

from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linear.rigidity import rigidity_matrix
from soliton_linkage.steering.torque_allocation import TorqueAllocation

ROTORS = 12

rotor_sets = st.sets(st.integers(0, ROTORS - 1), max_size=ROTORS).map(lambda each: tuple(each))


@settings(max_examples=30)
@given(st.sampled_from(CLASSES), rotor_sets, st.floats(2, 9), st.integers(0, 1), st.floats(-1, 1))
def test_torques_act_on_actuated_rotors_only_with_minimum_norm(example, rotors, place, leg, force):
    orbit = uniform_orbit(example, ROTORS)
    arc = orbit.arc_at(place, leg)
    torques, given_force = TorqueAllocation(orbit, rotors).torques(arc, force)
    tangent = orbit.tangent(arc)
    actuated = np.isin(np.arange(ROTORS), rotors) if rotors else np.ones(ROTORS, dtype=bool)
    assert not torques[~actuated].any()
    assert tangent @ torques == pytest.approx(given_force, rel=1e-9, abs=1e-15)
    if tangent[actuated] @ tangent[actuated] > 1e-11:
        assert given_force == pytest.approx(force)
        least = force * tangent[actuated] / (tangent[actuated] @ tangent[actuated])
        np.testing.assert_allclose(torques[actuated], least, rtol=1e-9, atol=1e-300)


def test_actuators_on_all_rotors_strain_no_spring():
    for example in CLASSES:
        orbit = uniform_orbit(example, ROTORS)
        for place in (0.0, 3.3, 6.0, 11.0):
            arc = orbit.arc_at(place, 0)
            torques, _ = TorqueAllocation(orbit).torques(arc, 2.0)
            work = rigidity_matrix(orbit.chain, orbit.configuration(arc)) @ torques
            assert np.abs(work).max() < 1e-5 * orbit.chain.rotor_length
            effort = TorqueAllocation(orbit).effort(arc, 2.0)
            assert effort.strain == 0
            assert effort.torque == pytest.approx(np.abs(torques).max())


def test_the_deflection_agrees_with_the_stiffness_matrix():
    for rotors in [(0,), (0, 1, 2), (1, 4, 7, 10)]:
        for example in CLASSES:
            orbit = uniform_orbit(example, ROTORS)
            arc, force = orbit.arc_at(1.4, 0), 1e-3
            allocation = TorqueAllocation(orbit, rotors)
            torques, _ = allocation.torques(arc, force)
            matrix = rigidity_matrix(orbit.chain, orbit.configuration(arc)).toarray()
            stiffness = orbit.chain.stiffness * matrix.T @ matrix
            left = torques - force * orbit.tangent(arc)
            given_way = np.linalg.pinv(stiffness, rcond=1e-9) @ left
            assert allocation.effort(arc, force).strain == pytest.approx(
                np.abs(given_way).max(), rel=1e-3
            )


@pytest.mark.parametrize('example', CLASSES)
def test_the_torque_of_an_edge_actuator_grows_as_the_zero_mode_decays(example):
    orbit = uniform_orbit(example, 24)
    allocation = TorqueAllocation(orbit, (0,))
    depth = penetration_depth(orbit.chain) / orbit.chain.spacing
    # Two rotors further the wall is the same; the effect of the edge decays with each rotor.
    places = 3 * depth + 2 + np.array([0, 2])
    nearer, farther = (
        allocation.effort(orbit.arc_at(place, 0), 1e-9).torque for place in places.tolist()
    )
    assert farther / nearer == pytest.approx(math.exp(2 / depth), rel=0.05)


def test_actuators_move_a_wall_within_their_reach_and_no_farther():
    orbit = uniform_orbit(WIDE_SPINNER, 40)
    allocation = TorqueAllocation(orbit, (0, 1), torque_limit=0.1)
    start, force = orbit.arc_at(1.0, 0), 1e-3
    reach = allocation.reach(start, force)
    assert 1 < reach.last < 20
    assert allocation.can_move(start, orbit.arc_at(reach.last, 0), force)
    assert not allocation.can_move(start, orbit.arc_at(reach.last + 0.5, 0), force)
    # A wall far from every actuator cannot be held, for any goal.
    assert math.isnan(allocation.reach(orbit.arc_at(30.0, 0), force).first)
    assert not allocation.can_move(orbit.arc_at(30.0, 0), orbit.arc_at(1.0, 0), force)


def test_the_minimum_coupling_is_at_the_farthest_site():
    orbit = uniform_orbit(WIDE_SPINNER, 40)
    start, goal = orbit.arc_at(1.0, 0), orbit.arc_at(9.0, 0)
    share = float(orbit.tangent(goal)[0] ** 2 + orbit.tangent(goal)[1] ** 2)
    assert TorqueAllocation(orbit, (0, 1)).min_coupling(start, goal) == pytest.approx(
        share, rel=1e-6
    )
    assert TorqueAllocation(orbit, (0, 1)).min_coupling(goal, start) == pytest.approx(
        share, rel=1e-6
    )
    assert TorqueAllocation(orbit).min_coupling(start, goal) == 1


def test_actuators_on_all_rotors_reach_all_sites():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    allocation = TorqueAllocation(orbit, torque_limit=0.1)
    arc = orbit.arc_at(4.0, 0)
    assert allocation.can_move(arc, orbit.arc_at(11.0, 0), 0.1)
    reach = allocation.reach(arc, 0.1)
    assert (reach.first, reach.last) == (0, 11)
    assert not allocation.can_move(arc, orbit.arc_at(5.0, 0), 1.0)


@given(st.floats(-10, 10))
def test_torques_beyond_the_limit_are_scaled_together(force):
    orbit = uniform_orbit(FLIPPER, ROTORS)
    arc = orbit.arc_at(4.3, 0)
    free, _ = TorqueAllocation(orbit).torques(arc, force)
    limited, given_force = TorqueAllocation(orbit, torque_limit=0.5).torques(arc, force)
    assert np.abs(limited).max() <= 0.5 * (1 + 1e-12)
    kept = min(1.0, 0.5 / max(np.abs(free).max(), 1e-300))
    np.testing.assert_allclose(limited, kept * free, rtol=1e-12, atol=0)
    assert given_force == pytest.approx(kept * force)


def test_an_actuated_rotor_outside_the_chain_is_rejected():
    with pytest.raises(ValueError, match='actuated rotor 12 must be one of 0 to 11'):
        TorqueAllocation(uniform_orbit(FLIPPER, ROTORS), (3, 12))
