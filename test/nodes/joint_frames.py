# SPDX-License-Identifier: Apache-2.0
"""Frames of a chain, whole or divided among several messages, as several boards send them."""

from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain, frame_to_msg
from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg


def frame_of(
    named: NamedChain, angles: Array, stamp: int = 0, rates: Array | None = None
) -> JointState:
    """A frame at a stamp [ns] whose joints have no efforts."""
    return frame_to_msg(named, Frame(angles, rates), np.zeros_like(angles), time_to_msg(stamp))


def part(frame: JointState, joints: Sequence[int], later: int = 0) -> JointState:
    """Some joints of a frame, as a board sends them a time later [ns]."""
    return JointState(
        header=Header(stamp=time_to_msg(time_from_msg(frame.header.stamp) + later)),
        name=[frame.name[joint] for joint in joints],
        position=[frame.position[joint] for joint in joints],
        velocity=[frame.velocity[joint] for joint in joints],
    )


def halves(frame: JointState, later: int = 0) -> list[JointState]:
    middle = len(frame.name) // 2
    return [part(frame, range(middle)), part(frame, range(middle, len(frame.name)), later)]
