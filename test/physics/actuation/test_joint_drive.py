# SPDX-License-Identifier: Apache-2.0
"""Each rotor follows the command that named it last, for as long as that holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.actuation.joint_drive import JointDrive

PERIOD = 0.01


def rotors(*numbers: int) -> np.ndarray:
    return np.array(numbers, dtype=np.intp)


@given(
    st.lists(
        st.tuples(st.sets(st.integers(0, 4), min_size=1), st.floats(-1, 1)),
        min_size=1,
        max_size=8,
    )
)
def test_every_rotor_has_the_last_torque_that_was_asked_for_it(
    commands: list[tuple[set[int], float]],
) -> None:
    drive, expected = JointDrive(5, 0.0), np.zeros(5)
    for number, (named, torque) in enumerate(commands):
        chosen = rotors(*named)
        drive.hold(chosen, np.full(len(chosen), torque), float(number))
        expected[chosen] = torque
    last = float(len(commands))
    np.testing.assert_array_equal(drive.mean_torques(last, last + PERIOD), expected)
    assert drive.active == bool(expected.any())


def test_a_torque_is_held_for_the_timeout_to_the_instant() -> None:
    drive = JointDrive(3, timeout=0.125)
    drive.hold(rotors(1), np.array([2.0]), 1.0)
    starts = 1.0 + PERIOD * np.arange(20)
    given_torques = [drive.mean_torques(start, start + PERIOD) for start in starts]
    np.testing.assert_allclose(np.sum(given_torques, axis=0) * PERIOD, [0, 2.0 * 0.125, 0])
    assert not drive.active


def test_commands_that_go_on_keep_a_torque_alive() -> None:
    drive = JointDrive(2, timeout=0.1)
    for time in np.arange(0.0, 5.0, 0.05):
        drive.hold(rotors(0), np.array([1.0]), time)
        np.testing.assert_array_equal(drive.mean_torques(time, time + PERIOD), [1.0, 0.0])
    assert drive.in_force == 1


def test_without_a_timeout_it_is_held_for_ever() -> None:
    drive = JointDrive(2, timeout=0.0)
    drive.hold(rotors(0), np.array([1.0]), 0.0)
    np.testing.assert_array_equal(drive.mean_torques(1e6, 1e6 + PERIOD), [1.0, 0.0])
    drive.hold(rotors(0), np.array([0.0]), 1e6 + 1)
    assert not drive.active


def test_a_trajectory_goes_straight_from_point_to_point_from_what_there_is() -> None:
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


def test_a_trajectory_is_unfinished_until_its_last_point() -> None:
    drive = JointDrive(2, timeout=0.5)
    drive.follow(rotors(0), np.array([0.5, 1.0]), np.array([[1.0], [2.0]]), 0.0)
    assert drive.unfinished(0.9)
    assert not drive.unfinished(1.1)


def test_a_trajectory_that_has_begun_already_is_entered_where_it_is() -> None:
    drive = JointDrive(1, timeout=0.0)
    drive.follow(rotors(0), np.array([-0.5, 0.5]), np.array([[0.0], [2.0]]), 0.0)
    assert drive.mean_torques(0.0, 0.25)[0] == pytest.approx(1.25)


def test_dropping_ends_all() -> None:
    drive = JointDrive(2, timeout=0.0)
    drive.hold(rotors(0, 1), np.ones(2), 0.0)
    drive.drop()
    assert not drive.active
    assert not drive.mean_torques(0.0, 1.0).any()
