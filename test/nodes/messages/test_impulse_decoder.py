# SPDX-License-Identifier: Apache-2.0
"""Impulses from bytes are those of the message, and are refused for the same reasons."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cdr import CdrWriter
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages import impulse_decoder
from soliton_linkage_nodes.messages.conversions import impulses_from_msg
from soliton_linkage_nodes.messages.impulse_decoder import ImpulseDecoder

ROTORS = {name: rotor for rotor, name in enumerate(('one', 'two', 'three', 'four'))}
LARGEST = 2.0
VALUES = st.floats(-2.5, 2.5) | st.sampled_from([np.nan, np.inf, -LARGEST, LARGEST])
MESSAGES = st.builds(
    RotorImpulses,
    header=st.builds(Header, frame_id=st.sampled_from(['', 'linkage'])),
    name=st.sampled_from(
        [[], ['two'], ['three', 'one'], ['one', 'three'], [*ROTORS], ['one', 'one'], ['five']]
    ),
    impulse=st.lists(VALUES, max_size=4) | st.lists(st.floats(-1, 1), min_size=2, max_size=2),
)


def assert_as_of_the_message(
    decoder: ImpulseDecoder, message: RotorImpulses, serialized: bytes
) -> None:
    try:
        expected = impulses_from_msg(ROTORS, message, LARGEST)
    except ValueError as error:
        with pytest.raises(ValueError, match=re.escape(str(error))):
            decoder.decode(serialized)
        return
    np.testing.assert_array_equal(decoder.decode(serialized), expected)


@given(st.lists(MESSAGES, min_size=2, max_size=5))
def test_any_message_acts_as_it_says_whatever_came_before(messages: list[RotorImpulses]) -> None:
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    for message in messages * 2:
        assert_as_of_the_message(decoder, message, serialize_message(message))


def test_messages_of_the_same_joints_are_not_deserialized_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = []
    deserialize = impulse_decoder.deserialize_message
    monkeypatch.setattr(
        impulse_decoder,
        'deserialize_message',
        lambda *given: made.append(1) or deserialize(*given),
    )
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    for value in np.linspace(-LARGEST, LARGEST, 9):
        message = RotorImpulses(name=['three', 'one'], impulse=[value, 0.5])
        assert_as_of_the_message(decoder, message, serialize_message(message))
    assert len(made) == 1


def test_impulses_of_two_messages_are_two_arrays() -> None:
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    first, second, third = (
        decoder.decode(serialize_message(RotorImpulses(name=['two'], impulse=[value])))
        for value in (0.25, 0.5, 1.0)
    )
    assert (first[1], second[1], third[1]) == (0.25, 0.5, 1.0)


@pytest.mark.parametrize('known', [False, True])
def test_bytes_that_are_no_impulses_are_refused(known: bool) -> None:
    message = RotorImpulses(name=['two', 'one'], impulse=[1.0, -1.0])
    whole = CdrWriter(message).serialized
    decoder = ImpulseDecoder(ROTORS, LARGEST)
    if known:
        decoder.decode(whole)
    for size in range(len(whole)):
        with pytest.raises(ValueError, match=f'rotor_impulses of {size} bytes are no'):
            decoder.decode(whole[:size])
    assert_as_of_the_message(decoder, message, whole)
