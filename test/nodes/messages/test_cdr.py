# SPDX-License-Identifier: Apache-2.0
"""Decoders and buffers agree with the serialization of ROS, for any previous message."""

import math
import re

import numpy as np
import pytest
from cdr import CdrWriter
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages import cdr
from soliton_linkage_nodes.messages.cdr import (
    ImpulseBuffer,
    ImpulseDecoder,
    JointStateBuffer,
    JointStateDecoder,
    Layout,
    TorqueBuffer,
    TorqueDecoder,
    publish_buffer,
)
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_to_msg,
    impulses_from_msg,
    impulses_to_msg,
    joint_states_from_msg,
    torques_from_msg,
    torques_to_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.serialization import serialize
from soliton_linkage_nodes.runtime.stamps import stamp_of, time_from_msg, time_to_msg

# Strings of ROS messages end at a zero.
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=9)
FRAMES = st.sampled_from(['', 'linkage', 'two'])
NAMES = st.lists(TEXT, max_size=4)
NUMBERS = st.lists(st.floats(), max_size=5)
ROTORS = {name: rotor for rotor, name in enumerate(('one', 'two', 'three', 'four'))}
LARGEST = 2.0
VALUES = st.floats(-2.5, 2.5) | st.sampled_from([np.nan, np.inf, -LARGEST, LARGEST])
IMPULSES = st.builds(
    RotorImpulses,
    header=st.builds(Header, frame_id=st.sampled_from(['', 'linkage'])),
    name=st.sampled_from(
        [[], ['two'], ['three', 'one'], ['one', 'three'], [*ROTORS], ['one', 'one'], ['five']]
    ),
    impulse=st.lists(VALUES, max_size=4) | st.lists(st.floats(-1, 1), min_size=2, max_size=2),
)


def states(names: st.SearchStrategy[list[str]]) -> st.SearchStrategy[JointState]:
    stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1).map(time_to_msg)
    return st.builds(
        JointState,
        header=st.builds(Header, stamp=stamps, frame_id=FRAMES),
        name=names,
        position=NUMBERS,
        velocity=NUMBERS,
        effort=NUMBERS,
    )


def assert_same(decoder: JointStateDecoder, message: JointState, serialized: bytes) -> None:
    joints = decoder.decode(serialized)
    expected = joint_states_from_msg(message)
    assert joints[:4] == expected[:4]
    assert stamp_of(serialized) == expected.stamp
    np.testing.assert_array_equal(joints.position, expected.position)
    np.testing.assert_array_equal(joints.velocity, expected.velocity)


def assert_as_of_the_message(
    decoder: ImpulseDecoder | TorqueDecoder, message: RotorImpulses | JointState, serialized: bytes
) -> None:
    of_torques = isinstance(message, JointState)
    from_msg = torques_from_msg if of_torques else impulses_from_msg
    try:
        expected = from_msg(ROTORS, message, LARGEST)
    except ValueError as error:
        with pytest.raises(ValueError, match=re.escape(str(error))):
            decoder.decode(serialized)
        return
    np.testing.assert_array_equal(decoder.decode(serialized), expected)


def scribbled(message: JointState, filling: int) -> bytes:
    """The bytes of a message with something between its values, and behind them."""
    writer = CdrWriter(message)
    body = bytearray(writer.serialized)
    for place, meant in enumerate(writer.meant):
        body[4 + place] |= 0 if meant else filling
    return bytes(body) + bytes([filling] * 8)


def named_chain(rotors: int, length: int) -> NamedChain:
    """A chain whose last joint's name has a length."""
    names = (*default_joint_names(rotors)[:-1], 'x' * length)
    return NamedChain(Chain(number_of_rotors=rotors), names)


@pytest.fixture
def deserialized(monkeypatch):
    """Messages that ROS deserialized."""
    made: list[bytes] = []
    deserialize = cdr.deserialize_message
    monkeypatch.setattr(
        cdr,
        'deserialize_message',
        lambda serialized, kind: made.append(serialized) or deserialize(serialized, kind),
    )
    return made


@given(
    FRAMES,
    NAMES | st.just(['a', 'b']),
    st.lists(st.tuples(states(NAMES | st.just(['a', 'b'])), st.integers(0, 255)), max_size=6),
)
def test_a_message_that_fits_a_layout_has_its_frame_names_and_arrays(frame_id, names, messages):
    layout = Layout(frame_id, tuple(names))
    for message, filling in messages:
        serialized = scribbled(message, filling)
        same = message.header.frame_id == frame_id and list(message.name) == names
        assert layout.fits(serialized) == same
        if same:
            for array, expected in zip(
                layout.arrays(serialized, 2), (message.position, message.velocity), strict=True
            ):
                np.testing.assert_array_equal(array, expected)


@given(st.lists(states(NAMES), min_size=1, max_size=4))
def test_any_joint_states_come_back_whatever_came_before(messages):
    decoder = JointStateDecoder()
    for message in messages * 2:
        assert_same(decoder, message, serialize_message(message))


def test_joint_states_of_the_same_joints_are_not_deserialized_again(deserialized):
    decoder = JointStateDecoder()
    for filling in range(20):
        message = JointState(name=['one', 'other'], position=[1.0, filling])
        assert_same(decoder, message, scribbled(message, filling))
    assert len(deserialized) == 1
    other = JointState(name=['one', 'Other'])
    assert_same(decoder, other, serialize_message(other))
    assert len(deserialized) == 2
    in_another_encoding = b'\x00\x07' + serialize_message(other)[2:]
    decoder.decode(in_another_encoding)
    assert len(deserialized) == 3


def test_big_endian_messages_come_back():
    message = JointState(name=['a'], position=[2.5])
    decoder = JointStateDecoder()
    assert_same(decoder, message, serialize_message(message))
    swapped = bytes.fromhex('00000000 00000000 00000000 00000001 00000000')
    swapped += bytes.fromhex('00000001 00000002 61000000 00000001 4004000000000000')
    assert_same(decoder, message, swapped + bytes(8))


def test_bytes_that_are_no_message_are_rejected():
    joints = JointState(name=['a', 'b'], position=[1.0, math.nan], velocity=[3.0, 4.0])
    impulses = RotorImpulses(name=['two', 'one'], impulse=[1.0, -1.0])
    for known in [False, True]:
        for decoder, message, what, efforts, check in (
            (JointStateDecoder(), joints, 'joint_states', 12, assert_same),
            (
                ImpulseDecoder(ROTORS, LARGEST),
                impulses,
                'rotor_impulses',
                0,
                assert_as_of_the_message,
            ),
        ):
            whole = CdrWriter(message).serialized
            if known:
                decoder.decode(whole)
            for size in range(len(whole) - efforts):
                with pytest.raises(ValueError, match=f'{what} of {size} bytes is no valid'):
                    decoder.decode(whole[:size])
            check(decoder, message, whole)


@given(st.lists(IMPULSES, min_size=2, max_size=5))
def test_impulses_are_decoded_independently_of_earlier_ones(messages):
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    for message in messages * 2:
        assert_as_of_the_message(decoder, message, serialize_message(message))


def test_impulses_of_the_same_joints_are_not_deserialized_again(deserialized):
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    for value in np.linspace(-LARGEST, LARGEST, 9):
        message = RotorImpulses(name=['three', 'one'], impulse=[value, 0.5])
        assert_as_of_the_message(decoder, message, serialize_message(message))
    assert len(deserialized) == 1


@given(st.lists(IMPULSES, min_size=2, max_size=5), st.lists(st.floats(), max_size=3))
def test_torques_are_decoded_independently_of_earlier_ones(values, angles):
    decoder = TorqueDecoder(ROTORS, LARGEST)
    for value in values * 2:
        message = JointState(name=value.name, position=angles, effort=value.impulse)
        assert_as_of_the_message(decoder, message, serialize_message(message))


def test_a_buffer_writes_the_message_with_its_size():
    for rotors in [2, 3, 4, 41, 1000]:
        for length in range(1, 10):
            named = named_chain(rotors, length)
            buffer, impulse_buffer = JointStateBuffer(named), ImpulseBuffer(named)
            torque_buffer = TorqueBuffer(named)
            random = np.random.default_rng(rotors)
            for stamp in (0, 1_700_000_000_999_999_999, 2**31 * 10**9 - 1):
                angles, rates, torques = random.normal(size=(3, rotors))
                message = frame_to_msg(named, Frame(angles, rates), torques, time_to_msg(stamp))
                written = buffer.fill(stamp, angles, rates, torques)
                # Not byte for byte: what ROS pads names with is whatever was in memory.
                assert deserialize_message(bytes(written), JointState) == message
                assert len(written) == len(buffer) == len(serialize_message(message))
                impulses = impulses_to_msg(named, angles, time_to_msg(stamp))
                filled = bytes(impulse_buffer.fill(stamp, angles))
                assert deserialize_message(filled, RotorImpulses) == impulses
                assert len(filled) == len(serialize_message(impulses))
                efforts = torques_to_msg(named, torques, time_to_msg(stamp))
                filled = bytes(torque_buffer.fill(stamp, torques))
                assert deserialize_message(filled, JointState) == efforts
                assert len(filled) == len(serialize(efforts))


def test_a_frame_is_filled_in_place(named):
    buffer = JointStateBuffer(named)
    zeros = np.zeros(named.rotors)
    written = bytes(buffer.fill(1, zeros + 1, zeros, zeros))
    filled = buffer.fill(2, zeros, zeros + 1, zeros)
    assert bytes(filled) != written
    assert buffer.fill(1, zeros + 1, zeros, zeros) is filled
    assert filled == written


def test_a_buffer_is_published_as_its_bytes_at_that_time(graph, named):
    heard = graph.hear(interfaces.JOINT_STATES)
    publisher = graph.speak(interfaces.JOINT_STATES)
    buffer = JointStateBuffer(named)
    zeros = np.zeros(named.rotors)
    for stamp in range(3):
        publish_buffer(publisher, buffer.fill(stamp, zeros + stamp, zeros, zeros))
    graph.until(lambda: len(heard) == 3, 'three messages')
    assert [time_from_msg(message.header.stamp) for message in heard] == [0, 1, 2]
    assert [list(message.position) for message in heard] == [[float(n)] * 8 for n in range(3)]
