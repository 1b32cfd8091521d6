# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from soliton_linkage.identification.identification import identify
from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.chain_identifier.joint_record import JointRecord
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

sys.path.append(str(Path(__file__).parents[2] / 'physics'))

from passages import FLIPPER, SPINNER, passage, read

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


def recorded(
    parts: list[np.ndarray], most: int = 10_000, period: int = SECOND // 250
) -> JointRecord:
    record = JointRecord((), most)
    frames = np.concatenate(parts)
    names = tuple(f'rotor_{n}' for n in range(frames.shape[1]))
    for number, angles in enumerate(frames):
        record.add(
            JointStates(*divmod(SECOND + number * period, SECOND), '', names, angles, angles[:0])
        )
    record.finish()
    return record


@pytest.mark.parametrize('most', [10_000, 500])
def test_a_reset_of_the_chain_divides_the_record(most):
    whole, _ = read(passage(FLIPPER, 200), 1, noise=0.003)
    readings = recorded([whole[:125], whole], most).readings()
    first, second = readings.recordings
    assert first.times[-1] < second.times[0] == pytest.approx(0.5)
    assert first.angles[-1] == pytest.approx(whole[124])
    assert second.angles[0] == pytest.approx(whole[0])
    found = identify(readings, FLIPPER)
    assert found.chain.rotor_lengths[1:-1] == pytest.approx(FLIPPER.rotor_lengths[1:-1], rel=0.02)


def test_moving_walls_and_a_slipping_encoder_do_not_divide_the_record():
    whole = passage(SPINNER, 40)
    slipped = whole + 0.5 * np.outer(np.arange(40) > 20, np.arange(10) == 4)
    for frames in (whole, slipped):
        assert len(recorded([frames, frames[::-1]]).readings().recordings) == 1
