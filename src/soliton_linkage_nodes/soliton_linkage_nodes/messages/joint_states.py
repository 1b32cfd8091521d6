# SPDX-License-Identifier: Apache-2.0
"""Joint states as they are analysed, from their CDR bytes without a message of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.named_arrays import Layout

_NANOSECONDS = 10**9


class JointStates(NamedTuple):
    """A JointState without its efforts; positions and velocities are empty where it has none."""

    seconds: int
    nanoseconds: int
    frame_id: str
    name: tuple[str, ...]
    position: Array
    velocity: Array

    @property
    def stamp(self) -> int:
        """Time since the epoch [ns]."""
        return self.seconds * _NANOSECONDS + self.nanoseconds


def joint_states_from_msg(message: JointState) -> JointStates:
    """Joint states of a message."""
    header = message.header
    return JointStates(
        header.stamp.sec,
        header.stamp.nanosec,
        header.frame_id,
        tuple(message.name),
        np.array(message.position, dtype=np.float64),
        np.array(message.velocity, dtype=np.float64),
    )


class JointStateDecoder:
    """Decodes joint states, fast where frame and names are those of the message before.

    Names are most of the cost of a JointState. Where their bytes tell that they are the same, the
    arrays are taken from behind them.
    """

    def __init__(self) -> None:
        """Begin without knowing any names."""
        self._layout: Layout | None = None

    def decode(self, serialized: bytes) -> JointStates:
        """Joint states whose arrays may be unaligned views; ValueError where they are damaged."""
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                seconds, nanoseconds = layout.stamp(serialized)
                position, velocity = layout.arrays(serialized, 2)
                names = layout.frame_id, layout.name
                return JointStates(seconds, nanoseconds, *names, position, velocity)
            message = deserialize_message(serialized, JointState)
        except Exception as error:  # rclpy's own has no public name
            raise ValueError(
                f'joint_states of {len(serialized)} bytes are no sensor_msgs/JointState: {error}; '
                'mend what publishes them'
            ) from error
        joints = joint_states_from_msg(message)
        self._layout = Layout(joints.frame_id, joints.name)
        return joints

    def stamp(self, serialized: bytes) -> int:
        """Stamp alone of joint states [ns]; ValueError where they are damaged."""
        layout = self._layout
        if layout is not None and layout.fits(serialized):
            seconds, nanoseconds = layout.stamp(serialized)
            return seconds * _NANOSECONDS + nanoseconds
        return self.decode(serialized).stamp
