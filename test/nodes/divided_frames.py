# SPDX-License-Identifier: Apache-2.0
"""Frames whose joints are divided among several messages, as several boards send them."""

from collections.abc import Sequence

from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage_nodes.runtime.stamps import time_from_msg, time_to_msg


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
