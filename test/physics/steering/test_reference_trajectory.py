# SPDX-License-Identifier: Apache-2.0
"""Trajectories have their start and end, and the adiabatic rate excites no phonons."""

import math
from dataclasses import replace

import numpy as np
import pytest
from chains import CLASSES, FLIPPER, chain_of
from hypothesis import given, settings
from hypothesis import strategies as st
from orbits import uniform_orbit

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linear.bands import gap
from soliton_linkage.linear.normal_modes import phonon_energy
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.steering.reference_trajectory import (
    ReferencePoint,
    adiabatic_rate,
    bandwidth,
    trajectory_to,
    trajectory_to_rest,
)

points = st.builds(ReferencePoint, st.floats(-50, 50), st.floats(-10, 10), st.floats(-20, 20))


@settings(max_examples=30)
@given(points, st.floats(-50, 50), st.floats(-5, 5), st.floats(0.1, 20), st.floats(0.1, 10))
def test_a_trajectory_joins_its_point_to_rest_at_the_goal(point, goal, start, rate, shortest):
    trajectory = trajectory_to(goal, start, point, rate, shortest)
    begun, ended = trajectory.at(start), trajectory.at(trajectory.end)
    assert trajectory.duration >= shortest
    assert begun.arc == pytest.approx(point.arc, abs=1e-9)
    assert begun.rate == pytest.approx(point.rate, abs=1e-9)
    assert begun.acceleration == pytest.approx(point.acceleration, abs=1e-9)
    scale = 1 + abs(goal - point.arc) + abs(point.rate) * trajectory.duration
    scale += abs(point.acceleration) * trajectory.duration**2
    assert trajectory.goal == pytest.approx(goal, abs=1e-11 * scale)
    assert ended.arc == pytest.approx(goal, abs=1e-11 * scale)
    assert ended.rate * trajectory.duration == pytest.approx(0, abs=1e-11 * scale)
    assert ended.acceleration * trajectory.duration**2 == pytest.approx(0, abs=1e-10 * scale)
    assert trajectory.at(trajectory.end + 7) == trajectory.at(trajectory.end + 9)


@given(points, st.floats(-50, 50), st.floats(0.02, 0.98))
def test_rate_and_acceleration_are_derivatives_of_the_arc(point, goal, share):
    trajectory = trajectory_to(goal, 0.0, point, 5.0, 2.0)
    time, step = share * trajectory.duration, 1e-4 * trajectory.duration
    before, here, after = (trajectory.at(time + shift) for shift in (-step, 0, step))
    scale = max(trajectory.max_rate, trajectory.max_acceleration * trajectory.duration, 1.0)
    assert here.rate == pytest.approx((after.arc - before.arc) / (2 * step), abs=1e-5 * scale)
    slope = (after.rate - before.rate) / (2 * step)
    assert here.acceleration == pytest.approx(slope, abs=1e-5 * scale / trajectory.duration)


@given(st.floats(0.01, 100), st.floats(0.1, 10), st.floats(0.1, 10))
def test_from_rest_the_trajectory_has_minimum_jerk(way, rate, shortest):
    trajectory = trajectory_to(-way, 0.0, ReferencePoint(0.0, 0.0, 0.0), rate, shortest)
    time = trajectory.duration
    assert trajectory.max_rate == pytest.approx(1.875 * way / time, rel=1e-9)
    assert trajectory.max_acceleration == pytest.approx(
        10 / math.sqrt(3) * way / time**2, rel=1e-3
    )
    assert trajectory.max_rate <= rate * (1 + 1e-9)
    assert time == pytest.approx(max(shortest, 1.875 * way / rate))


@given(st.floats(-10, 10), st.floats(0.1, 5))
def test_braking_takes_half_the_distance_of_constant_speed(rate, shortest):
    trajectory = trajectory_to_rest(3.0, ReferencePoint(2.0, rate, 0.0), shortest)
    assert trajectory.goal - 2.0 == pytest.approx(rate * shortest / 2)
    rates = [trajectory.at(3.0 + share * shortest).rate for share in np.linspace(0, 1, 50)]
    speeds = np.sign(rate) * np.array(rates)
    assert speeds[0] == pytest.approx(abs(rate))
    assert (np.diff(speeds) <= 1e-12).all()


@pytest.mark.parametrize('example', CLASSES)
def test_a_free_wall_at_the_adiabatic_rate_radiates_nothing(example):
    orbit = uniform_orbit(example, 12)
    chain, rate = orbit.chain, adiabatic_rate(orbit)
    start = orbit.arc_at(3.5, 0)
    rates = rate * orbit.tangent(start)
    simulation = ElasticSimulation(
        chain, orbit.configuration(start), rates, orbit.site_arc / rate, tolerance=1e-9
    )
    whole = simulation.energy
    # A moving wall compresses its springs; they vibrate because they start uncompressed.
    before = phonon_energy(chain, simulation.angles, simulation.rates)
    for _ in range(4):
        simulation.advance()
    after = phonon_energy(chain, simulation.angles, simulation.rates)
    assert before < 1e-12 * whole
    assert after < 0.02 * whole


@pytest.mark.parametrize('example', CLASSES)
def test_the_adiabatic_rate_does_not_depend_on_the_length_of_the_chain(example):
    assert adiabatic_rate(uniform_orbit(example, 60)) == pytest.approx(
        adiabatic_rate(uniform_orbit(example, 150)), rel=0.1
    )


@pytest.mark.parametrize('example', CLASSES)
def test_the_adiabatic_rate_scales_with_the_time_unit_of_the_springs(example):
    for size, mass, stiffness in [(3.0, 1.0, 1.0), (1.0, 0.01, 400.0)]:
        chain = chain_of(example, 12)
        scaled = replace(
            chain,
            spacing=size * chain.spacing,
            rotor_length=size * chain.rotor_length,
            mass=mass * chain.mass,
            stiffness=stiffness * chain.stiffness,
        )
        rates = (
            adiabatic_rate(UniformOrbit(scaled)) * scaled.time_unit,
            adiabatic_rate(UniformOrbit(chain)),
        )
        assert rates[0] == pytest.approx(rates[1] * chain.time_unit, rel=1e-3)


def test_the_bandwidth_is_below_the_gap_and_the_frame_rate():
    orbit = uniform_orbit(FLIPPER, 12)
    for period in (1e-4, 1e-2, 0.1):
        assert bandwidth(orbit, period) <= gap(orbit.chain) / 8
        assert bandwidth(orbit, period) * period <= 0.1 * (1 + 1e-12)
    assert bandwidth(orbit, 1e-4) == gap(orbit.chain) / 8
    assert bandwidth(orbit, math.nan) == gap(orbit.chain) / 8


def test_a_wall_that_radiates_at_every_wave_number_moves_slowly():
    chain = replace(chain_of(FLIPPER, 8), rotor_length=1000.0, rest_angle=0.001)
    assert 0 < adiabatic_rate(UniformOrbit(chain)) < 1e-5
