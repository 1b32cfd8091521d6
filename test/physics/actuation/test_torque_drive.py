# SPDX-License-Identifier: Apache-2.0
"""Edge torques act along the current zero mode, and joint torques add to them."""

import numpy as np
import pytest
from chains import FLIPPER, chain_of
from hypothesis import given
from hypothesis import strategies as st
from linkage_motion import wall_between

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.profile import trapezoid
from soliton_linkage.actuation.torque_drive import EdgeDrive, JointDrive, TorqueDrive
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array

CHAIN = chain_of(FLIPPER, 12)
PULSE = EdgeCommand(Edge.LAST, CommandKind.PULSE, 0.03, 1.0)


def test_torques_follow_the_mode_of_the_configuration_away_from_their_edge():
    drive = TorqueDrive(CHAIN, PneumaticActuator(), timeout=0.0)
    drive.edges.command(PULSE, Edge.LAST, 0.0)
    for number, rotor in enumerate((9, 5, 2)):
        angles = wall_between(CHAIN, rotor)
        time = 0.1 * number
        given = drive.torques(angles, time, time + 0.01).torques
        expected = 0.03 * edge_mode(CHAIN, angles, Edge.LAST, anywhere=True)
        np.testing.assert_allclose(given, expected, rtol=1e-12)


def test_joint_and_edge_torques_add():
    drive = TorqueDrive(CHAIN, PneumaticActuator(), timeout=0.0)
    angles = CHAIN.uniform_state(1)
    drive.edges.command(PULSE, Edge.LAST, 0.0)
    drive.joints.hold(np.array([3, 7]), np.array([1e-3, -2e-3]), 0.0)
    given = drive.torques(angles, 0.0, 0.01).torques
    expected = 0.03 * edge_mode(CHAIN, angles, Edge.LAST)
    expected[[3, 7]] += [1e-3, -2e-3]
    np.testing.assert_allclose(given, expected, rtol=1e-12)


ACTUATOR = PneumaticActuator(filling_time=0.03, venting_time=0.05, saturation_torque=1.0)
PERIOD = 0.004


def torques(drive: EdgeDrive, start: float, end: float) -> Array:
    count = round((end - start) / PERIOD)
    starts = [start + PERIOD * number for number in range(count)]
    return np.array([drive.mean_torque(t, t + PERIOD).torque for t in starts])


def test_a_short_pulse_gives_its_full_impulse():
    for ramps in [(0.0, 0.0), (0.0017, 0.0), (0.02, 0.05)]:
        for duration in [0.0005, 0.0301]:
            for side in [Edge.FIRST, Edge.LAST]:
                drive = EdgeDrive(ACTUATOR)
                command = EdgeCommand(side, CommandKind.PULSE, -0.05, duration, *ramps)
                drive.command(command, side, 1.0)
                given = torques(drive, 1.0, 1.3).sum() * PERIOD
                sense = 1 if side is Edge.FIRST else -1
                assert given == pytest.approx(
                    -0.05 * sense * (duration + sum(ramps) / 2), rel=1e-9
                )
                assert not drive.active


def test_a_pressure_command_gives_the_torque_of_the_chamber():
    for side in [Edge.FIRST, Edge.LAST]:
        drive = EdgeDrive(ACTUATOR)
        drive.command(EdgeCommand(side, CommandKind.PRESSURE, 1e5, 0.1, 0.02, 0.03), side, 2.0)
        given = torques(drive, 2.0, 2.3)
        command = trapezoid(1e5, 0.02, 0.1, 0.03)
        integrals = [ACTUATOR.response(0.0, command, 0.0, PERIOD * n)[1] for n in range(76)]
        sense = 1 if side is Edge.FIRST else -1
        expected = sense * ACTUATOR.torque_per_pressure * np.diff(integrals) / PERIOD
        np.testing.assert_allclose(given, expected, atol=1e-13)


def test_missing_frames_do_not_change_the_later_pressure():
    drives = [EdgeDrive(ACTUATOR), EdgeDrive(ACTUATOR)]
    for drive in drives:
        drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 0.1), Edge.FIRST, 0.0)
    torques(drives[0], 0.0, 0.2)
    late = [drive.mean_torque(0.2, 0.2 + PERIOD).torque for drive in drives]
    assert late[0] == pytest.approx(late[1], rel=1e-9)


def test_a_pressure_without_duration_is_held_until_it_is_vented():
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.LAST, CommandKind.PRESSURE, 1e5), Edge.LAST, 0.0)
    held = drive.mean_torque(50.0, 50.0 + PERIOD)
    assert held.torque == pytest.approx(-1e5 * ACTUATOR.torque_per_pressure)
    assert not drive.unfinished(50.0)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 0.0), Edge.FIRST, 51.0)
    area = torques(drive, 51.0, 52.0).sum() * PERIOD
    venting = -1e5 * ACTUATOR.torque_per_pressure * ACTUATOR.venting_time
    assert area == pytest.approx(venting, rel=1e-5)
    assert not drive.active
    assert drive.levels == (0.0, 0.0)


def test_a_command_replaces_the_previous_one_which_vents():
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 1.0), Edge.FIRST, 0.0)
    drive.mean_torque(0.4, 0.4 + PERIOD)
    assert drive.unfinished(0.5)
    drive.command(EdgeCommand(Edge.LAST, CommandKind.PRESSURE, 5e4), Edge.LAST, 0.5)
    drive.mean_torque(0.5, 0.5 + PERIOD)
    drive.mean_torque(3.0, 3.0 + PERIOD)
    assert drive.levels == (0.0, pytest.approx(5e4))
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.01, 0.1), Edge.FIRST, 3.1)
    venting = ACTUATOR.follow(5e4, 0.0, 0.0, PERIOD)[1] / PERIOD
    expected = 0.01 - ACTUATOR.torque_per_pressure * venting
    assert drive.mean_torque(3.1, 3.1 + PERIOD).torque == pytest.approx(expected)


def test_a_torque_beyond_saturation_is_limited_and_reported():
    actuator = PneumaticActuator(torque_per_pressure=1e-7, saturation_torque=0.005)
    drive = EdgeDrive(actuator)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5), Edge.FIRST, 0.0)
    first = drive.mean_torque(0.0, PERIOD)
    late = drive.mean_torque(1.0, 1.0 + PERIOD)
    assert (first.saturated, late.saturated) == (False, True)
    assert late.torque == 0.005


def test_drop_ends_a_pulse_and_vents():
    drive = EdgeDrive(ACTUATOR)
    drive.command(EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.05, 1.0), Edge.FIRST, 0.0)
    assert drive.unfinished(0.1)
    drive.drop(0.1)
    assert not drive.active
    assert not drive.unfinished(0.1)


FRAME = 0.01


def rotors(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.intp)


@given(
    st.lists(
        st.tuples(st.sets(st.integers(0, 4), min_size=1), st.floats(-1, 1)), min_size=1, max_size=8
    )
)
def test_every_rotor_has_its_last_commanded_torque(commands):
    drive, expected = JointDrive(5, 0.0), np.zeros(5)
    for number, (named, torque) in enumerate(commands):
        chosen = rotors(*named)
        drive.hold(chosen, np.full(len(chosen), torque), float(number))
        expected[chosen] = torque
    last = float(len(commands))
    np.testing.assert_array_equal(drive.mean_torques(last, last + FRAME), expected)
    assert drive.active == bool(expected.any())


def test_a_torque_is_held_exactly_for_the_timeout():
    drive = JointDrive(3, timeout=0.125)
    drive.hold(rotors(1), np.array([2.0]), 1.0)
    starts = 1.0 + FRAME * np.arange(20)
    given_torques = [drive.mean_torques(start, start + FRAME) for start in starts]
    np.testing.assert_allclose(np.sum(given_torques, axis=0) * FRAME, [0, 2.0 * 0.125, 0])
    assert not drive.active


def test_repeated_commands_keep_a_torque_active():
    drive = JointDrive(2, timeout=0.1)
    for time in np.arange(0.0, 5.0, 0.05):
        drive.hold(rotors(0), np.array([1.0]), time)
        np.testing.assert_array_equal(drive.mean_torques(time, time + FRAME), [1.0, 0.0])
    drive.hold(rotors(0), np.array([0.0]), 5.0)
    assert not drive.active


def test_without_a_timeout_a_torque_is_held_forever():
    drive = JointDrive(2, timeout=0.0)
    drive.hold(rotors(0), np.array([1.0]), 0.0)
    np.testing.assert_array_equal(drive.mean_torques(1e6, 1e6 + FRAME), [1.0, 0.0])
    drive.hold(rotors(0), np.array([0.0]), 1e6 + 1)
    assert not drive.active


def test_a_trajectory_is_linear_between_points_and_starts_from_the_current_torques():
    drive = JointDrive(3, timeout=0.5)
    drive.hold(rotors(0, 1), np.array([4.0, 7.0]), 0.0)
    points = np.array([[0.0, 2.0], [6.0, 2.0]])
    drive.follow(rotors(0, 2), np.array([0.2, 0.4]), points, 0.1)
    for time, expected in (
        (0.1, [4.0, 7.0, 0.0]),
        (0.2, [2.0, 7.0, 1.0]),
        (0.3, [0.0, 7.0, 2.0]),
        (0.4, [3.0, 7.0, 2.0]),
        (0.6, [6.0, 0.0, 2.0]),
        (1.1, [0.0, 0.0, 0.0]),
    ):
        middle = drive.mean_torques(time, time + 1e-9)
        np.testing.assert_allclose(middle, expected, atol=1e-6)
    assert not drive.active


def test_a_trajectory_with_past_points_skips_them():
    drive = JointDrive(1, timeout=0.0)
    drive.follow(rotors(0), np.array([-0.5, 0.5]), np.array([[0.0], [2.0]]), 0.0)
    assert drive.mean_torques(0.0, 0.25)[0] == pytest.approx(1.25)
