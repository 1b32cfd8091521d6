# SPDX-License-Identifier: Apache-2.0
"""Messages of one stamp with disjoint joints are one frame."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.messages.conversions import JointStates, default_joint_names
from soliton_linkage_nodes.messages.frames import FrameAssembler, SerializedFrames

NAMES = default_joint_names(6)


def part(frame: int, joints: Sequence[int], rates: bool = True) -> JointStates:
    """A message with some joints, whose angles identify the frame and the joint."""
    angles = np.array([10.0 * frame + joint for joint in joints])
    names = tuple(NAMES[joint] for joint in joints)
    return JointStates(frame, 0, 'linkage', names, angles, angles + 0.5 if rates else angles[:0])


def read(frame: JointStates) -> dict[str, float]:
    return dict(zip(frame.name, frame.position.tolist(), strict=True))


def whole(frame: int, joints: Sequence[int] = range(6)) -> dict[str, float]:
    return {NAMES[joint]: 10.0 * frame + joint for joint in joints}


@given(st.permutations(range(6)), st.sets(st.integers(1, 5)), st.booleans())
def test_parts_of_a_frame_in_any_division_and_order_are_one_frame(order, cuts, known):
    assembler = FrameAssembler(NAMES if known else ())
    ends = [0, *sorted(cuts), 6]
    messages = [
        part(frame, order[begin:end]) for frame in range(1, 5) for begin, end in pairwise(ends)
    ]
    frames = list(assembler.add_all(messages))
    assert [read(frame) for frame in frames] == [whole(n) for n in range(1, 5)]
    assert all((frame.velocity == frame.position + 0.5).all() for frame in frames)


def test_a_frame_is_returned_as_soon_as_it_is_complete():
    assembler = FrameAssembler(NAMES)
    for frame in range(1, 4):
        assert assembler.add(part(frame, [0, 1, 2])) == []
        (found,) = assembler.add(part(frame, [3, 4, 5]))
        assert read(found) == whole(frame)


def test_a_joint_that_never_comes_delays_the_first_frame_only():
    assembler = FrameAssembler(NAMES)
    assert assembler.add(part(1, [0, 1])) == []
    assert [read(each) for each in assembler.add(part(2, [0, 1]))] == [
        whole(1, [0, 1]),
        whole(2, [0, 1]),
    ]
    assert len(assembler.add(part(3, [4]))) == 1


def test_a_lost_part_costs_only_its_joints():
    assembler = FrameAssembler(NAMES)
    messages = [part(n, at) for n in range(1, 6) for at in ([0, 1, 2], [3, 4, 5])]
    del messages[5]
    frames = list(assembler.add_all(messages))
    assert [read(frame) for frame in frames] == [
        whole(1),
        whole(2),
        whole(3, [0, 1, 2]),
        whole(4),
        whole(5),
    ]


def test_a_part_that_stays_away_is_no_longer_awaited():
    assembler = FrameAssembler(NAMES)
    for joints in ([0, 1, 2], [3, 4, 5]):
        assembler.add(part(1, joints))
    returned = [len(assembler.add(part(frame, [0, 1, 2]))) for frame in range(2, 30)]
    assert returned[0] == 0
    assert returned[-10:] == [1] * 10
    assert sum(returned) == 28


def test_a_part_that_comes_after_its_frame_is_awaited_in_the_next_one():
    assembler = FrameAssembler(NAMES)
    frames = list(assembler.add_all([part(1, [0]), part(2, [0]), part(2, [1])]))
    assert [read(frame) for frame in frames] == [whole(1, [0]), whole(2, [0]), whole(2, [1])]
    assert assembler.add(part(3, [0])) == []
    assert [read(each) for each in assembler.add(part(3, [1]))] == [whole(3, [0, 1])]


def test_rates_of_some_parts_are_kept():
    assembler = FrameAssembler(NAMES)
    assembler.add(part(1, [0, 1, 2], rates=False))
    (frame,) = assembler.add(part(1, [3, 4, 5]))
    assert np.isnan(frame.velocity[:3]).all()
    assert frame.velocity[3:].tolist() == [13.5, 14.5, 15.5]


def test_joints_of_other_robots_are_no_part_of_a_frame():
    assembler = FrameAssembler(NAMES)
    for stamp in (1, 2):
        gripper = part(stamp, [0])._replace(name=('gripper',))
        assert assembler.add(gripper) == [gripper]
        assert [read(each) for each in assembler.add(part(stamp, range(6)))] == [whole(stamp)]


def test_a_part_whose_angles_and_names_differ_in_number_is_rejected_alone():
    assembler = FrameAssembler(NAMES)
    assembler.add(part(1, [0, 1, 2]))
    with pytest.raises(ValueError, match='has 1 values for 2 names'):
        assembler.add(part(1, [3, 4])._replace(position=np.zeros(1)))
    (frame,) = assembler.add(part(1, [3, 4, 5]))
    assert read(frame) == whole(1)


def serialized(frame: int, joints: Sequence[int]) -> bytes:
    message = JointState(name=[NAMES[n] for n in joints], position=list(map(float, joints)))
    message.header.stamp.sec = frame
    return serialize_message(message)


def test_serialized_frames_are_passed_on_or_assembled():
    frames = SerializedFrames()
    frames.set_joints(NAMES)
    for stamp in (1, 2):
        whole_frame = serialized(stamp, range(6))
        assert frames.add(whole_frame) == [whole_frame]
    assert frames.add(serialized(3, [0, 1, 2])) == []
    (joined,) = frames.add(serialized(3, [3, 4, 5]))
    assert deserialize_message(joined, JointState) == deserialize_message(
        serialized(3, range(6)), JointState
    )
    assert frames.add(b'nothing') == [b'nothing']
    assert frames.parts(serialized(4, [2])) == (NAMES[2],)
    assert frames.parts(b'nothing') == ()
