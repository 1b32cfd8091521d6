# SPDX-License-Identifier: Apache-2.0
"""Experiments give the stated kick, and measure walls with known properties correctly."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import Edge, mode_centre, zero_mode
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.recording import Recording
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.experiments import (
    arctanh_width,
    kick_rates,
    record_kick,
    record_moving_wall,
    slow_crossing_time,
    snapshots,
    wall_positions,
    zero_crossing,
)

FLIPPER = Chain(30, spacing=0.1, rotor_length=0.05, rest_angle=0.6)
SPINNER = Chain(30, spacing=0.1, rotor_length=0.3, rest_angle=1.0)


def walls_at(chain: Chain, positions: Array, period: float) -> Recording:
    """Return a recording of static walls at successive positions."""
    angles = np.array([static_wall(chain, position) for position in positions])
    times = period * np.arange(len(positions))
    return Recording(times, angles, np.empty((0, chain.number_of_rotors)))


def test_a_kick_gives_the_masses_its_speed_and_stretches_no_spring():
    for edge in [Edge.FIRST, Edge.LAST]:
        for chain in [FLIPPER, SPINNER]:
            rest = chain.uniform_state(-1 if edge is Edge.FIRST else 1)
            rates = kick_rates(chain, rest, 0.3, edge)
            speed = chain.rotor_length * np.linalg.norm(rates)
            assert speed == pytest.approx(0.3 * chain.spacing / chain.time_unit, rel=1e-14)
            assert np.abs(rates @ zero_mode(chain, rest)) == pytest.approx(np.linalg.norm(rates))
            moved = RigidSimulation(chain, rest, rates, period=0.2 / float(np.linalg.norm(rates)))
            start = mode_centre(zero_mode(chain, rest))
            for _ in range(60):
                moved.advance()
            inwards = 1 if edge is Edge.FIRST else -1
            assert inwards * (mode_centre(zero_mode(chain, moved.angles)) - start) > 1


@given(position=st.floats(1.5, 8.25), width=st.floats(0.5, 3))
def test_a_zero_is_interpolated_linearly_between_two_rotors(position, width):
    field = (position - np.arange(11)) / width
    assert zero_crossing(field) == pytest.approx(position, abs=1e-12)


def test_a_field_without_a_zero_gives_nan_and_edge_rotors_are_ignored():
    assert math.isnan(zero_crossing(np.ones(6)))
    assert math.isnan(zero_crossing(np.array([-1.0, 1, 1, 1, 1, -1])))


def test_the_arctanh_width_of_a_tanh_is_its_width():
    for width in [0.8, 3.0]:
        positions = np.linspace(-12, 12, 40)
        assert arctanh_width(positions, -np.tanh(positions / width)) == pytest.approx(
            width, rel=1e-12
        )


def test_snapshots_have_the_known_speed_and_position_of_walls():
    for direction in [1, -1]:
        positions = np.linspace(3, 26, 47)[::direction]
        recording = walls_at(FLIPPER, positions, period=0.02)
        assert wall_positions(FLIPPER, recording) == pytest.approx(positions, abs=0.02)
        seen = snapshots(FLIPPER, recording, 5)
        assert seen.speed == pytest.approx(0.5 / 0.02, rel=2e-3)
        assert seen.distances.shape == seen.fields.shape == seen.angles.shape == (5, 30)
        # Rotors on the two sides of the wall lean in opposite directions.
        assert (np.sign(seen.fields[seen.distances < -0.1]) == 1).all()
        assert (np.sign(seen.fields[seen.distances > 0.1]) == -1).all()


def test_a_wall_that_never_reaches_the_middle_is_rejected():
    recording = walls_at(FLIPPER, np.array([1.0, 1.5, 2.0]), period=1.0)
    with pytest.raises(
        ValueError, match='in 0 frames, but 2 are required; kick the wall, or record'
    ):
        snapshots(FLIPPER, recording, 2)


@pytest.mark.parametrize(('chain', 'kick'), [(FLIPPER, 0.004), (SPINNER, 0.02)])
def test_a_slow_wall_crosses_in_the_time_of_rigid_bars(chain, kick):
    recording, speed = record_moving_wall(chain, kick)
    slow = (chain.number_of_rotors - 1) / (slow_crossing_time(chain, kick) * chain.time_unit)
    assert speed == pytest.approx(slow, rel=5e-3)
    assert len(recording.times) == 601


def test_a_recording_has_the_requested_duration_and_frames():
    recording = record_kick(FLIPPER, 0.05, duration=20.0, frames=40)
    assert len(recording.times) == 41
    assert recording.times[-1] == pytest.approx(20 * FLIPPER.time_unit, rel=1e-12)
