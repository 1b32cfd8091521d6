# SPDX-License-Identifier: Apache-2.0
"""Frames of a chain, whole or divided among several messages, as several boards send them."""

from collections.abc import Sequence

import numpy as np
from recordings import START
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain, frame_to_msg
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg

PERIOD = 20 * 10**6
"""Time between the frames of a chain that was kicked [ns]."""


def frame_of(
    named: NamedChain, angles: Array, stamp: int = 0, rates: Array | None = None
) -> JointState:
    """A frame at a stamp [ns] whose joints have no efforts."""
    return frame_to_msg(named, Frame(angles, rates), np.zeros_like(angles), time_to_msg(stamp))


def kicked_frames(named: NamedChain, speed: float, duration: float = 2.0) -> list[JointState]:
    """Frames of a chain that was kicked at its first edge, for a time [s]."""
    rest = named.chain.uniform_state(-1)
    kick = speed * edge_mode(named.chain, rest, Edge.FIRST)
    moved = simulate(named.chain, rest, kick, duration, PERIOD / SECOND)
    return [
        frame_of(named, angles, START + number * PERIOD, rates)
        for number, (angles, rates) in enumerate(zip(moved.angles, moved.rates, strict=True))
    ]


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
