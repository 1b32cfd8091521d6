# SPDX-License-Identifier: Apache-2.0
"""Joint states are decoded as ROS does, whatever message came before and whoever wrote it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cdr import CdrWriter
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage_nodes.messages import joint_states
from soliton_linkage_nodes.messages.conversions import time_to_msg
from soliton_linkage_nodes.messages.joint_states import JointStateDecoder, joint_states_from_msg

# Strings of ROS messages end at a zero.
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=9)
NUMBERS = st.lists(st.floats(), max_size=5)


def states(names: st.SearchStrategy[list[str]]) -> st.SearchStrategy[JointState]:
    stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1).map(time_to_msg)
    return st.builds(
        JointState,
        header=st.builds(Header, stamp=stamps, frame_id=st.sampled_from(['', 'linkage', 'two'])),
        name=names,
        position=NUMBERS,
        velocity=NUMBERS,
        effort=NUMBERS,
    )


def assert_same(decoder: JointStateDecoder, message: JointState, serialized: bytes) -> None:
    joints = decoder.decode(serialized)
    expected = joint_states_from_msg(message)
    assert joints[:4] == expected[:4]
    assert decoder.stamp(serialized) == expected.stamp
    np.testing.assert_array_equal(joints.position, expected.position)
    np.testing.assert_array_equal(joints.velocity, expected.velocity)


def scribbled(message: JointState, filling: int) -> bytes:
    """The bytes of a message with something between its values, and behind them."""
    writer = CdrWriter(message)
    body = bytearray(writer.serialized)
    for place, meant in enumerate(writer.meant):
        body[4 + place] |= 0 if meant else filling
    return bytes(body) + bytes([filling] * 8)


@given(st.lists(states(st.lists(TEXT, max_size=4)), min_size=1, max_size=4))
def test_any_messages_come_back_whatever_came_before(messages: list[JointState]) -> None:
    decoder = JointStateDecoder()
    for message in messages * 2:
        assert_same(decoder, message, serialize_message(message))


@given(st.lists(TEXT, max_size=4).flatmap(lambda n: st.lists(states(st.just(n)), min_size=2)))
def test_messages_of_the_same_joints_come_back(messages: list[JointState]) -> None:
    decoder = JointStateDecoder()
    for filling, message in enumerate(messages):
        assert_same(decoder, message, scribbled(message, filling % 256))


def test_messages_of_the_same_joints_are_not_deserialized_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = []
    deserialize = joint_states.deserialize_message
    monkeypatch.setattr(
        joint_states, 'deserialize_message', lambda *given: made.append(1) or deserialize(*given)
    )
    decoder = JointStateDecoder()
    for filling in range(20):
        message = JointState(name=['one', 'other'], position=[1.0, filling])
        assert_same(decoder, message, scribbled(message, filling))
    assert len(made) == 1
    other = JointState(name=['one', 'Other'])
    assert_same(decoder, other, serialize_message(other))
    assert len(made) == 2
    in_another_encoding = b'\x00\x07' + serialize_message(other)[2:]
    decoder.decode(in_another_encoding)
    assert len(made) == 3


def test_big_endian_messages_come_back() -> None:
    message = JointState(name=['a'], position=[2.5])
    decoder = JointStateDecoder()
    assert_same(decoder, message, serialize_message(message))
    swapped = bytes.fromhex('00000000 00000000 00000000 00000001 00000000')
    swapped += bytes.fromhex('00000001 00000002 61000000 00000001 4004000000000000')
    assert_same(decoder, message, swapped + bytes(8))


@pytest.mark.parametrize('known', [False, True])
def test_bytes_that_are_no_joint_states_are_refused(known: bool) -> None:
    message = JointState(name=['a', 'b'], position=[1.0, math.nan], velocity=[3.0, 4.0])
    whole = CdrWriter(message).serialized
    decoder = JointStateDecoder()
    if known:
        decoder.decode(whole)
    for size in range(len(whole) - 12):
        with pytest.raises(ValueError, match=f'joint_states of {size} bytes are no sensor_msgs'):
            decoder.decode(whole[:size])
    assert_same(decoder, message, whole)
