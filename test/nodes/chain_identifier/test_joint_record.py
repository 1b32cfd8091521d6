# SPDX-License-Identifier: Apache-2.0
"""The record keeps frames with their standard deviations, thinned out, and what pushed rotors."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

NAMES = ('a', 'b', 'c')
NOTHING = np.zeros(0)


def states(stamp: int, *values: float) -> JointStates:
    return JointStates(*divmod(stamp, SECOND), '', NAMES, np.array(values, dtype=float), NOTHING)


def test_frames_keep_their_deviations_whichever_comes_first_and_are_thinned() -> None:
    record = JointRecord(NAMES, 10)
    for number in range(500):
        angles, deviations = states(number, number, 0, 0), states(number, number, np.nan, 1)
        if number % 2:
            record.add(angles)
            record.add_deviations(deviations)
        else:
            record.add_deviations(deviations)
            record.add(angles)
    readings = record.readings()
    assert record.frames == 500
    assert 5 <= len(record) <= 10
    assert (np.diff(readings.angles[:, 0]) > 0).all()
    assert readings.angles[-1, 0] == 499
    assert readings.deviations is not None
    np.testing.assert_array_equal(readings.deviations[:, 0], readings.angles[:, 0])
    assert np.isnan(readings.deviations[:, 1]).all()


def test_the_first_frame_has_its_deviations_which_come_before_it_and_name_the_joints() -> None:
    record = JointRecord((), 10)
    record.add_push(RotorImpulses(name=['a'], impulse=[1.0]), 0)
    record.add_deviations(states(SECOND, 0.1, 0.2, np.nan))
    record.add(states(SECOND, 1, 2, 3))
    readings = record.readings()
    assert record.joint_names == NAMES
    assert readings.deviations is not None
    np.testing.assert_array_equal(readings.deviations, [[0.1, 0.2, np.nan]])
    assert not readings.pushes


def test_pushes_are_kept_with_impulses_in_the_order_of_the_rotors() -> None:
    record = JointRecord(NAMES, 10)
    record.add(states(SECOND, 0, 0, 0))
    impulses = RotorImpulses(name=['c', 'a'], impulse=[2.0, 1.0])
    record.add_push(impulses, 3 * SECOND)
    impulses.header.stamp = time_to_msg(2 * SECOND)
    record.add_push(impulses, 3 * SECOND)
    record.add_push(RotorImpulses(name=['c'], impulse=[0.0]), 3 * SECOND)
    record.add_push(JointState(name=['b'], effort=[0.1]), 4 * SECOND)
    pushes = record.readings().pushes
    assert [push.time for push in pushes] == [2.0, 1.0, 3.0]
    for push in pushes[:2]:
        np.testing.assert_array_equal(push.impulses, [1.0, 0.0, 2.0])
    assert pushes[2].impulses is None


def test_what_was_delivered_counts_in_place_of_commands() -> None:
    record = JointRecord(NAMES, 10)
    record.add(states(SECOND, 0, 0, 0))
    impulses = RotorImpulses(name=['a'], impulse=[1.0])
    record.add_push(impulses, 5 * SECOND)
    record.add_push(JointState(name=['b'], effort=[0.1]), 6 * SECOND)
    impulses.header.stamp = time_to_msg(2 * SECOND)
    record.add_delivered(impulses)
    assert [push.time for push in record.readings().pushes] == [1.0]
    for stamp, given in ((3, 0.5), (4, 0.7), (5, 0.7)):
        delivery = Delivery(impulse_of_torques=[0.0, given, 0.0])
        delivery.header.stamp = time_to_msg(stamp * SECOND)
        record.add_delivery(delivery)
    pushes = record.readings().pushes
    assert [push.time for push in pushes] == [1.0, 3.0]
    np.testing.assert_allclose(pushes[1].impulses, [0.0, 0.2, 0.0])
