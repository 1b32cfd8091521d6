# SPDX-License-Identifier: Apache-2.0
"""Joint states as they are analysed, from their CDR bytes without a message of each."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.chain import Array

_NANOSECONDS = 10**9
_LITTLE_ENDIAN = b'\x00\x01'
_STAMP = struct.Struct('<4xiI')
_COUNT = struct.Struct('<I')
_NOTHING = np.zeros(0)


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
        self._layout: _Layout | None = None

    def decode(self, serialized: bytes) -> JointStates:
        """Joint states whose arrays may be unaligned views; ValueError where they are damaged."""
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                return layout.read(serialized)
            message = deserialize_message(serialized, JointState)
        except Exception as error:  # rclpy's own has no public name
            raise ValueError(
                f'joint_states of {len(serialized)} bytes are no sensor_msgs/JointState: {error}; '
                'mend what publishes them'
            ) from error
        joints = joint_states_from_msg(message)
        self._layout = _Layout(joints.frame_id, joints.name)
        return joints


class _Layout:
    """Where in its bytes a JointState with a certain frame and names has its arrays.

    CDR writes a string as the length of its bytes with the final zero, and them; a sequence as
    its count and the elements. Counts begin at multiples of 4 bytes, doubles at multiples of 8,
    from the end of the 4 bytes of the encapsulation header. What lies between can be anything.
    """

    def __init__(self, frame_id: str, name: tuple[str, ...]) -> None:
        """Lay out what stands between the stamp and the positions."""
        self._frame_id, self._name = frame_id, name
        texts = [text.encode() + b'\x00' for text in (frame_id, *name)]
        head = [_COUNT.pack(len(text)) + text + bytes(-len(text) % 4) for text in texts]
        meant = [b'\xff' * (4 + len(text)) + bytes(-len(text) % 4) for text in texts]
        head.insert(1, _COUNT.pack(len(name)))
        meant.insert(1, b'\xff' * 4)
        self._head = np.frombuffer(b''.join(head), '<u4')
        self._meant = np.frombuffer(b''.join(meant), '<u4')
        self._end = _STAMP.size + self._head.nbytes
        self._latest = self._head.tobytes()

    def fits(self, serialized: bytes) -> bool:
        """Whether a message has the frame and the names."""
        if len(serialized) < self._end or not serialized.startswith(_LITTLE_ENDIAN):
            return False
        if serialized.startswith(self._latest, _STAMP.size):
            return True
        head = np.frombuffer(serialized, '<u4', len(self._head), _STAMP.size)
        if ((head ^ self._head) & self._meant).any():
            return False
        self._latest = head.tobytes()
        return True

    def read(self, serialized: bytes) -> JointStates:
        """Joint states of a message that fits."""
        position, end = _doubles(serialized, self._end)
        velocity, _ = _doubles(serialized, end)
        seconds, rest = _STAMP.unpack_from(serialized)
        return JointStates(seconds, rest, self._frame_id, self._name, position, velocity)


def _doubles(serialized: bytes, begin: int) -> tuple[Array, int]:
    """A sequence of doubles and where it ends."""
    (count,) = _COUNT.unpack_from(serialized, begin)
    if not count:
        return _NOTHING, begin + 4
    first = begin + 4 + -begin % 8
    return np.frombuffer(serialized, '<f8', count, first), first + 8 * count
