# SPDX-License-Identifier: Apache-2.0
"""The buffer writes what ROS would, whatever the length of the names and the array."""

from __future__ import annotations

import numpy as np
import pytest
from graphs import Graph
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    default_joint_names,
    frame_to_msg,
    impulses_to_msg,
    time_from_msg,
    time_to_msg,
)
from soliton_linkage_nodes.messages.joint_state_buffer import (
    ImpulseBuffer,
    JointStateBuffer,
    publish_buffer,
)
from soliton_linkage_nodes.runtime import interfaces


def named_chain(rotors: int, length: int) -> NamedChain:
    """A chain whose last joint's name has a length."""
    names = (*default_joint_names(rotors)[:-1], 'x' * length)
    return NamedChain(Chain(number_of_rotors=rotors), names)


@pytest.mark.parametrize('length', range(1, 10))
@pytest.mark.parametrize('rotors', [2, 3, 4, 41, 1000])
def test_what_is_written_reads_as_the_message_and_has_its_size(rotors: int, length: int) -> None:
    named = named_chain(rotors, length)
    buffer = JointStateBuffer(named)
    random = np.random.default_rng(rotors)
    for stamp in (0, 1_700_000_000_999_999_999, 2**31 * 10**9 - 1):
        angles, rates, torques = random.normal(size=(3, rotors))
        message = frame_to_msg(named, Frame(angles, rates), torques, time_to_msg(stamp))
        written = buffer.write(stamp, angles, rates, torques)
        # Not byte for byte: what ROS pads names with is whatever was in memory.
        assert deserialize_message(written, JointState) == message
        assert len(written) == len(buffer) == len(serialize_message(message))


def test_a_message_stays_as_it_was_when_the_next_is_written(named: NamedChain) -> None:
    buffer = JointStateBuffer(named)
    zeros = np.zeros(named.rotors)
    first = buffer.write(0, zeros, zeros, zeros)
    before = bytes(bytearray(first))
    buffer.write(1, zeros + 1, zeros + 2, zeros + 3)
    assert first == before


def test_a_frame_is_filled_in_place_and_written_apart(named: NamedChain) -> None:
    buffer = JointStateBuffer(named)
    zeros = np.zeros(named.rotors)
    written = buffer.write(1, zeros + 1, zeros, zeros)
    filled = buffer.fill(2, zeros, zeros + 1, zeros)
    assert buffer.fill(1, zeros + 1, zeros, zeros) is filled
    assert filled == written


def test_a_buffer_is_published_as_its_bytes_at_that_time(graph: Graph, named: NamedChain) -> None:
    heard = graph.hear(interfaces.JOINT_STATES)
    publisher = graph.speak(interfaces.JOINT_STATES)
    buffer = JointStateBuffer(named)
    zeros = np.zeros(named.rotors)
    for stamp in range(3):
        publish_buffer(publisher, buffer.fill(stamp, zeros + stamp, zeros, zeros))
    graph.until(lambda: len(heard) == 3, 'three messages')
    assert [time_from_msg(message.header.stamp) for message in heard] == [0, 1, 2]
    assert [list(message.position) for message in heard] == [[float(n)] * 8 for n in range(3)]


@pytest.mark.parametrize('length', range(1, 10))
@pytest.mark.parametrize('rotors', [2, 3, 41])
def test_impulses_are_written_as_ros_does(rotors: int, length: int) -> None:
    named = named_chain(rotors, length)
    buffer = ImpulseBuffer(named)
    for stamp in (0, 1_700_000_000_999_999_999):
        impulses = np.random.default_rng(rotors).normal(size=rotors)
        message = impulses_to_msg(named, impulses, time_to_msg(stamp))
        filled = bytes(buffer.fill(stamp, impulses))
        assert deserialize_message(filled, RotorImpulses) == message
        assert len(filled) == len(serialize_message(message))
