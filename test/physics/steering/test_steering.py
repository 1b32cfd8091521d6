# SPDX-License-Identifier: Apache-2.0
"""Walls are moved to their goals and held; impossible moves are rejected."""

import math
from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, SPINNER, WOBBLER
from driven_walls import (
    PERIOD,
    ROTORS,
    SEEN,
    Loop,
    RigidWall,
    SpringWall,
    move_to,
    rigid_loop,
    steering_of,
)
from orbits import uniform_orbit

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.estimation.relocalisation import fit_anywhere
from soliton_linkage.linear.normal_modes import phonon_energy
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.orbit.orbit import Orbit
from soliton_linkage.steering.reference_trajectory import bandwidth
from soliton_linkage.steering.settings import DEFAULTS, SteeringSettings
from soliton_linkage.steering.steering import Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation

NOISE = 0.01


def spring_wall(chain: Chain, angles: Array, gravity: float = 0.0) -> SpringWall:
    field = Gravity(gravity, 0.3)
    return SpringWall(
        ElasticSimulation(chain, angles, period=PERIOD, tolerance=1e-7, gravity=field)
    )


def place_of(orbit: Orbit, angles: Array) -> float:
    return orbit.site(fit_anywhere(orbit, angles).arc)


def held_within(loop: Loop, place: float, distance: float, seconds: float = 0.5) -> None:
    for _ in range(round(seconds / 0.04)):
        loop.go_on(0.04)
        assert abs(place_of(loop.steering.orbit, loop.wall.frame()) - place) < distance


@pytest.mark.parametrize(
    ('example', 'start', 'goal'),
    [(FLIPPER, 2.2, 7.9), (WOBBLER, 4.0, 2.5), (SPINNER, 7.1, 4.4)],
)
def test_a_wall_among_springs_reaches_the_goal_without_phonons(example, start, goal):
    orbit = uniform_orbit(example, ROTORS)
    wall = spring_wall(orbit.chain, orbit.configuration(orbit.arc_at(start, 1)))
    loop = Loop(steering_of(orbit), wall)
    loop.go_on(SEEN)
    assert loop.steering.move(goal) is None
    loop.go_on(0.3)
    fastest = 0.0
    while loop.ended is None:
        loop.step()
        rates = wall.simulation.rates
        fastest = max(fastest, float(orbit.chain.kinetic_energy(rates)))
    assert loop.ended.outcome is Outcome.REACHED
    assert loop.ended.site == pytest.approx(goal, abs=0.01)
    held_within(loop, goal, 0.01)
    left = phonon_energy(orbit.chain, wall.simulation.angles, wall.simulation.rates)
    assert left < 1e-6 * fastest


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_a_wall_is_held_against_gravity(example):
    orbit = uniform_orbit(example, ROTORS)
    wall = spring_wall(orbit.chain, orbit.configuration(orbit.arc_at(3.0, 0)), gravity=1.0)
    loop = Loop(steering_of(orbit), wall)
    loop.go_on(0.04)
    move_to(loop, 5.0)
    held_within(loop, 5.0, 0.02)
    assert np.abs(loop.steering.torques()).max() > 1e-5


@pytest.mark.parametrize('example', CLASSES)
def test_the_goal_is_reached_with_unmodelled_noise_friction_and_disorder(example):
    orbit = uniform_orbit(example, ROTORS)
    chain = orbit.chain
    drawn = drawn_deviations(
        ROTORS, 1, spacing=0.05, rotor_length=0.05, mass=0.05, stiffness=0.05, damping=0.05
    )
    damping = 0.05 * chain.moment_of_inertia / chain.time_unit
    true = replace(chain, deviations=drawn, damping=damping)
    start = unstretched(true, orbit.configuration(orbit.arc_at(3.0, 0)))
    wall = spring_wall(true, start)
    loop = Loop(steering_of(orbit), wall, noise=NOISE, seed=1)
    loop.go_on(SEEN)
    move_to(loop, 5.5)
    held_within(loop, 5.5, 0.05)
    left = phonon_energy(true, wall.simulation.angles, wall.simulation.rates)
    scale = chain.moment_of_inertia * (loop.steering.adiabatic_speed * orbit.site_arc) ** 2 / 2
    assert left < 1e-2 * scale


@pytest.mark.parametrize('example', CLASSES)
def test_with_known_deviations_the_wall_ends_on_the_orbit_of_that_chain(example):
    even = uniform_orbit(example, ROTORS).chain
    drawn = drawn_deviations(
        ROTORS, 1, spacing=0.05, rotor_length=0.05, rest_length=0.02, mass=0.05, stiffness=0.05
    )
    orbit = orbit_of(replace(even, deviations=drawn))
    wall = spring_wall(orbit.chain, orbit.configuration(orbit.arc_at(3.0, 0)))
    loop = Loop(steering_of(orbit), wall, noise=NOISE)
    loop.go_on(SEEN)
    move_to(loop, 4.5)
    held_within(loop, 4.5, 0.05)


@pytest.mark.parametrize('example', CLASSES)
def test_a_wall_is_moved_out_of_its_edge_and_back(example):
    orbit = uniform_orbit(example, ROTORS)
    loop, wall = rigid_loop(example, 0.0)
    wall.arc = fit_anywhere(orbit, orbit.chain.uniform_state(-1)).arc
    loop.steering = steering_of(orbit)
    loop.go_on(SEEN)
    for goal in (4.5, 9.0, 0.0):
        move_to(loop, goal)
        assert wall.place == pytest.approx(goal, abs=0.01)


def test_the_wall_follows_its_reference():
    loop, wall = rigid_loop(FLIPPER, 2.0)
    assert loop.steering.move(7.0) is None
    trajectory = loop.steering.trajectory
    assert trajectory is not None
    for _ in range(round(trajectory.duration / PERIOD)):
        loop.step()
        assert wall.arc == pytest.approx(trajectory.at(loop.time).arc, abs=0.02)


@pytest.mark.parametrize('example', CLASSES)
def test_a_constant_force_causes_no_steady_error(example):
    loop, wall = rigid_loop(example, 4.0, disturbance=2.0)
    move_to(loop, 4.0)
    loop.go_on(2.0)
    assert wall.place == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize('example', CLASSES)
def test_the_error_after_an_impulse_decays_with_the_bandwidth(example):
    loop, wall = rigid_loop(example, 4.0)
    loop.steering.move(4.0)
    loop.until_ended()
    rest = wall.arc
    wall.rate = 1.0
    b = bandwidth(loop.steering.orbit, PERIOD)
    offsets = []
    for _ in range(round(20 / b / PERIOD)):
        loop.step()
        offsets.append(abs(wall.arc - rest))
    # A critically damped error after an impulse w peaks at w / (e b); the observer adds a delay.
    assert 1 / (math.e * b) < max(offsets) < 3 / (math.e * b)
    assert max(offsets[-100:]) < 1e-3 * max(offsets)


@pytest.mark.parametrize('example', CLASSES)
def test_the_loop_is_stable_with_delayed_torques(example):
    loop, wall = rigid_loop(example, 4.0, delay=8)
    move_to(loop, 6.0)
    assert wall.place == pytest.approx(6.0, abs=0.05)


@pytest.mark.parametrize('period', [0.001, 0.04])
def test_the_loop_is_stable_at_any_frame_rate(period):
    loop, wall = rigid_loop(FLIPPER, 4.0, period=period)
    loop.go_on(1.0 - SEEN)
    move_to(loop, 6.0)
    assert wall.place == pytest.approx(6.0, abs=0.05)


def test_the_speed_limit_of_a_move_is_respected():
    loop, _ = rigid_loop(FLIPPER, 2.0)
    assert loop.steering.move(7.0, 1.0) is None
    speeds = []
    while loop.ended is None:
        loop.step()
        wall = loop.steering.wall
        assert wall is not None
        speeds.append(wall.speed)
    assert max(speeds) == pytest.approx(1.0, rel=0.02)
    assert min(speeds) > -0.02


def test_stop_brakes_within_the_shortest_time_and_holds():
    loop, wall = rigid_loop(FLIPPER, 1.0)
    loop.steering.move(8.0)
    loop.go_on(1.5)
    place, rate = wall.place, wall.rate
    shortest = DEFAULTS.min_duration / bandwidth(loop.steering.orbit, PERIOD)
    way = rate * shortest / 2 / loop.steering.orbit.site_arc
    loop.steering.stop()
    ended = loop.until_ended()
    assert rate > 1
    assert ended.outcome is Outcome.STOPPED
    assert wall.place == pytest.approx(place + way, rel=0.1)
    assert loop.steering.holding
    stopped = wall.place
    loop.go_on(1.0)
    assert wall.place == pytest.approx(stopped, abs=1e-3)


def test_a_new_goal_during_a_move_changes_the_reference_smoothly():
    loop, wall = rigid_loop(FLIPPER, 1.0)
    loop.steering.move(8.0)
    loop.go_on(1.0)
    before = np.abs(loop.steering.torques()).max()
    rate = wall.rate
    assert loop.steering.move(2.0) is None
    loop.step()
    assert np.abs(loop.steering.torques()).max() < 2 * before + 1e-5
    assert wall.rate == pytest.approx(rate, rel=0.05)
    assert loop.until_ended().outcome is Outcome.REACHED
    assert wall.place == pytest.approx(2.0, abs=0.01)


def test_a_released_wall_moves_freely():
    loop, wall = rigid_loop(FLIPPER, 1.0)
    loop.steering.move(8.0)
    loop.go_on(1.0)
    loop.steering.release()
    loop.step()
    rate = wall.rate
    assert not loop.steering.holding
    assert not loop.steering.torques().any()
    loop.go_on(0.2)
    assert wall.rate == rate
    assert loop.ended is None


def test_an_upside_down_chain_is_steered_as_well():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    wall = spring_wall(orbit.chain, math.pi - orbit.configuration(orbit.arc_at(3.0, 0)))
    loop = Loop(steering_of(orbit), wall)
    loop.go_on(SEEN)
    move_to(loop, 4.0)
    assert place_of(orbit, math.pi - wall.frame()) == pytest.approx(4.0, abs=0.01)


def test_a_goal_outside_the_chain_and_an_invalid_speed_are_rejected():
    loop, _ = rigid_loop(FLIPPER, 3.0)
    for place in [-0.1, 9.1, math.nan, math.inf]:
        refused = loop.steering.move(place)
        assert refused is not None
        assert refused.outcome is Outcome.OUT_OF_CHAIN
        assert 'range 0 to 9' in refused.message
        assert refused.site == pytest.approx(3.0, abs=1e-3)
        assert not loop.steering.holding
    for speed in [-1.0, math.nan, math.inf]:
        refused = loop.steering.move(4.0, speed)
        assert refused is not None
        assert refused.outcome is Outcome.INVALID_SPEED
        assert '0 or more' in refused.message


def test_a_move_without_a_wall_is_rejected():
    steering = steering_of(uniform_orbit(FLIPPER, ROTORS))
    for angles in (None, np.full(ROTORS, 2.0)):
        if angles is not None:
            steering.observe(0.0, angles)
        refused = steering.move(4.0)
        assert refused is not None
        assert refused.outcome is Outcome.NO_SOLITON
        assert math.isnan(refused.site)
        assert steering.wall is None
        assert not steering.torques().any()


def test_a_rejected_move_does_not_change_the_current_one():
    loop, wall = rigid_loop(FLIPPER, 2.0)
    loop.steering.move(6.0)
    loop.go_on(0.5)
    assert loop.steering.move(100.0) is not None
    assert loop.until_ended().outcome is Outcome.REACHED
    assert wall.place == pytest.approx(6.0, abs=0.01)


def test_an_edge_actuator_reaches_as_far_as_the_edge_mode():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    steering = Steering(orbit, TorqueAllocation(orbit, (0,), torque_limit=0.1))
    wall = spring_wall(orbit.chain, orbit.configuration(orbit.arc_at(0.5, 0)))
    loop = Loop(steering, wall)
    loop.go_on(SEEN)
    refused = steering.move(7.0)
    assert refused is not None
    assert refused.outcome is Outcome.OUT_OF_REACH
    assert 'they can move a soliton at rotor 0.50 between rotors 0.00 and ' in refused.message
    reach = float(refused.message.partition(' and ')[2].split()[0])
    assert 0.5 < reach < 7
    move_to(loop, 1.2)
    held_within(loop, 1.2, 0.02)
    assert not steering.torques()[1:].any()


def test_far_from_the_actuators_the_bandwidth_decreases_to_limit_noise_torques():
    orbit = uniform_orbit(SPINNER, ROTORS)
    goal = orbit.arc_at(3.0, 0)
    times, torques = [], []
    for rotors in ((), (0,)):
        steering = Steering(orbit, TorqueAllocation(orbit, rotors, torque_limit=0.1))
        loop = Loop(steering, RigidWall(orbit, orbit.arc_at(0.5, 0)), noise=NOISE)
        loop.go_on(SEEN)
        move_to(loop, 3.0)
        times.append(loop.time)
        held = []
        for _ in range(800):
            loop.step()
            held.append(np.linalg.norm(loop.torques))
        torques.append(float(np.sqrt(np.mean(np.square(held)))))
    share = TorqueAllocation(orbit, (0,)).min_coupling(orbit.arc_at(0.5, 0), goal)
    assert share < 0.05
    assert times[1] / times[0] == pytest.approx(share**-0.2, rel=0.3)
    assert torques[1] / torques[0] == pytest.approx(1, rel=0.5)


def test_a_wall_that_jumps_is_lost_and_released():
    loop, wall = rigid_loop(FLIPPER, 2.0)
    loop.steering.move(6.0)
    loop.go_on(0.5)
    wall.arc += 4 * loop.steering.orbit.site_arc
    ended = loop.until_ended()
    assert ended.outcome is Outcome.SOLITON_LOST
    assert not loop.steering.holding
    assert not loop.steering.torques().any()


@pytest.mark.parametrize('period', [0.02, 0.05])
@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_after_a_jump_the_speed_is_that_of_a_new_estimate(example, period):
    orbit = uniform_orbit(example, 20)
    steering, other = steering_of(orbit), steering_of(orbit)
    times = period * np.arange(40)
    for time in times:
        steering.observe(
            time, orbit.configuration(orbit.arc_at(8.0, 0) + 5.0 * (time - times[-1]))
        )
    for frame, time in enumerate(times[-1] + period + times):
        angles = orbit.configuration(orbit.arc_at(3.0, 0) + 5.0 * period * frame)
        for each in (steering, other):
            each.observe(time, angles)
        # The first frames after a jump may be outliers.
        if frame >= 4:
            assert steering.wall is not None
            assert other.wall is not None
            assert steering.wall.speed == pytest.approx(other.wall.speed, rel=0.01)
            assert steering.wall.site == pytest.approx(other.wall.site, abs=0.01)


def test_a_wall_that_leaves_its_hold_is_lost():
    loop, wall = rigid_loop(FLIPPER, 2.0)
    loop.steering.move(3.0)
    loop.until_ended()
    wall.rate = 200.0
    ended = loop.until_ended()
    assert ended.outcome is Outcome.SOLITON_LOST
    assert not loop.steering.holding
    loop.ended = None
    loop.go_on(0.5)
    assert loop.ended is None


def test_a_wall_under_excessive_load_leaves_its_reference_and_is_lost():
    orbit = uniform_orbit(FLIPPER, ROTORS)
    wall = RigidWall(orbit, orbit.arc_at(4.0, 0))
    loop = Loop(Steering(orbit, TorqueAllocation(orbit, torque_limit=1e-3)), wall, PERIOD)
    loop.go_on(SEEN)
    loop.steering.move(5.0)
    loop.go_on(0.5)
    wall.disturbance = -1e-2 / orbit.chain.moment_of_inertia
    ended = loop.until_ended()
    assert ended.outcome is Outcome.SOLITON_LOST
    assert 'differs from its reference' in ended.message
    assert not loop.steering.holding


def test_a_wall_that_does_not_settle_is_reported_as_not_held():
    loop, _ = rigid_loop(FLIPPER, 4.0, SteeringSettings(tolerance=1e-3), noise=0.05)
    loop.steering.move(5.0)
    ended = loop.until_ended()
    assert ended.outcome is Outcome.NOT_HELD
    assert 'within 0.001 rotor spacings' in ended.message
    assert loop.steering.holding


def test_decreasing_stamps_lose_the_wall():
    loop, _ = rigid_loop(FLIPPER, 2.0)
    loop.steering.move(6.0)
    loop.go_on(1.0)
    loop.frames = 0
    ended = loop.until_ended()
    assert ended.outcome is Outcome.SOLITON_LOST
    assert 'the stamps decreased by 1.' in ended.message


@pytest.mark.parametrize(
    ('example', 'hurry', 'seconds'),
    [(FLIPPER, 5, 0.45), (SPINNER, 10, 0.05), (WOBBLER, 10, 0.45)],
)
def test_a_moving_wall_is_braked_and_moved_despite_missing_frames(example, hurry, seconds):
    orbit = uniform_orbit(example, 20)
    steering = Steering(orbit, TorqueAllocation(orbit, torque_limit=0.1))
    rate = hurry * steering.adiabatic_speed * orbit.site_arc
    wall = RigidWall(orbit, orbit.arc_at(2.0, 0), rate)
    loop = Loop(steering, wall, PERIOD, noise=0.01)
    loop.go_on(0.3)
    assert loop.steering.move(12.0) is None
    for _ in range(3):
        loop.go_on(0.1)
        loop.miss(seconds)
    assert loop.until_ended().outcome is Outcome.REACHED
    assert wall.place == pytest.approx(12.0, abs=0.15)


def test_a_gap_between_frames_does_not_lower_the_bandwidth():
    loop, _ = rigid_loop(FLIPPER, 2.0)
    loop.steering.move(6.0)
    loop.until_ended()
    loop.frames += 15
    loop.go_on(0.1)
    assert loop.steering.move(6.0) is None
    assert loop.steering.trajectory is not None
    usual = DEFAULTS.min_duration / bandwidth(loop.steering.orbit, PERIOD)
    assert loop.steering.trajectory.duration == pytest.approx(usual)


def test_after_a_reset_the_estimate_equals_a_new_one():
    loop, wall = rigid_loop(WOBBLER, 3.0)
    assert loop.steering.move(6.0) is None
    loop.go_on(0.5)
    loop.steering.reset()
    assert (loop.steering.wall, loop.steering.holding) == (None, False)
    other = steering_of(loop.steering.orbit)
    for time in np.arange(1.0, 1.3, PERIOD):
        angles = wall.frame()
        for each in (loop.steering, other):
            each.observe(time, angles)
            assert not each.torques().any()
        assert loop.steering.wall == other.wall
