# SPDX-License-Identifier: Apache-2.0
"""A layout fits the messages of its frame and names, whatever stands between their values."""

from __future__ import annotations

import numpy as np
from cdr import CdrWriter
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage_nodes.messages.conversions import time_to_msg
from soliton_linkage_nodes.messages.named_arrays import Layout

# Strings of ROS messages end at a zero.
TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=5)
FRAMES = st.sampled_from(['', 'linkage', 'two'])
NAMES = st.lists(TEXT, max_size=3)
NUMBERS = st.lists(st.floats(), max_size=3)


@st.composite
def scribbled_messages(draw: st.DrawFn) -> tuple[JointState, bytes]:
    """A message and its bytes, with anything between its values."""
    message = JointState(
        header=Header(stamp=time_to_msg(draw(st.integers(0, 2**60))), frame_id=draw(FRAMES)),
        name=draw(NAMES | st.just(['a', 'b'])),
        position=draw(NUMBERS),
        velocity=draw(NUMBERS),
    )
    writer = CdrWriter(message)
    filling = draw(st.integers(0, 255))
    body = bytearray(writer.serialized)
    for place, meant in enumerate(writer.meant):
        body[4 + place] |= 0 if meant else filling
    return message, bytes(body)


@given(FRAMES, NAMES | st.just(['a', 'b']), st.lists(scribbled_messages(), max_size=6))
def test_what_fits_has_the_frame_the_names_and_the_arrays_of_the_message(
    frame_id: str, names: list[str], messages: list[tuple[JointState, bytes]]
) -> None:
    layout = Layout(frame_id, tuple(names))
    for message, serialized in messages:
        same = message.header.frame_id == frame_id and list(message.name) == names
        assert layout.fits(serialized) == same
        if same:
            stamp = message.header.stamp
            assert layout.stamp(serialized) == (stamp.sec, stamp.nanosec)
            for array, expected in zip(
                layout.arrays(serialized, 2), (message.position, message.velocity), strict=True
            ):
                np.testing.assert_array_equal(array, expected)
