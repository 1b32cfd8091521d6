# SPDX-License-Identifier: Apache-2.0
import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

NAMES = ('a', 'b', 'c')


def states(stamp: int, *values: float) -> JointStates:
    return JointStates(*divmod(stamp, SECOND), '', NAMES, np.array(values, float), np.zeros(0))


def test_frames_keep_their_deviations_in_either_order_of_arrival_when_frames_are_dropped():
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


def test_deviations_that_arrive_before_the_first_frame_name_the_joints():
    record = JointRecord((), 10)
    record.add_command(RotorImpulses(name=['a'], impulse=[1.0]), 0)
    record.add_deviations(states(SECOND, 0.1, 0.2, np.nan))
    record.add(states(SECOND, 1, 2, 3))
    readings = record.readings()
    assert record.joint_names == NAMES
    assert readings.deviations is not None
    np.testing.assert_array_equal(readings.deviations, [[0.1, 0.2, np.nan]])
    assert not readings.impulses


def test_commanded_impulses_are_kept_in_the_order_of_the_rotors():
    record = JointRecord(NAMES, 10)
    record.add(states(SECOND, 0, 0, 0))
    impulses = RotorImpulses(name=['c', 'a'], impulse=[2.0, 1.0])
    record.add_command(impulses, 3 * SECOND)
    impulses.header.stamp = time_to_msg(2 * SECOND)
    record.add_command(impulses, 3 * SECOND)
    record.add_command(RotorImpulses(name=['c'], impulse=[0.0]), 3 * SECOND)
    record.add_command(JointState(name=['b'], effort=[0.1]), 4 * SECOND)
    kept = record.readings().impulses
    assert [each.time for each in kept] == [2.0, 1.0, 3.0]
    for each in kept[:2]:
        np.testing.assert_array_equal(each.values, [1.0, 0.0, 2.0])
    assert kept[2].values is None


def test_delivered_impulses_replace_commanded_ones():
    record = JointRecord(NAMES, 10)
    record.add(states(SECOND, 0, 0, 0))
    impulses = RotorImpulses(name=['a'], impulse=[1.0])
    record.add_command(impulses, 5 * SECOND)
    record.add_command(JointState(name=['b'], effort=[0.1]), 6 * SECOND)
    impulses.header.stamp = time_to_msg(2 * SECOND)
    record.add_delivered_impulses(impulses)
    assert [each.time for each in record.readings().impulses] == [1.0]
    for stamp, impulse in ((3, 0.5), (4, 0.7), (5, 0.7)):
        delivery = Delivery(impulse_of_torques=[0.0, impulse, 0.0])
        delivery.header.stamp = time_to_msg(stamp * SECOND)
        record.add_delivery(delivery)
    kept = record.readings().impulses
    assert [each.time for each in kept] == [1.0, 3.0]
    np.testing.assert_allclose(kept[1].values, [0.0, 0.2, 0.0])


def test_frames_in_halves_name_all_joints():
    record = JointRecord((), 100)
    for stamp in range(1, 4):
        for names in (('a', 'b'), ('c', 'd')):
            angles = np.full(2, float(stamp))
            record.add(JointStates(stamp, 0, '', names, angles, angles[:0]))
    record.finish()
    assert record.joint_names == ('a', 'b', 'c', 'd')
    np.testing.assert_array_equal(record.readings().angles, np.outer([1, 2, 3], np.ones(4)))
