# SPDX-License-Identifier: Apache-2.0
"""Fast CDR decoding and encoding of messages with a stamp, joint names and arrays of doubles.

A general decoder spends most of its time on the joint names. The decoders in this module only
check whether the bytes of the names are the same as in the previous message. The encoders in this
module encode a message once and then overwrite only its stamp and its arrays.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.conversions import Frame, JointStates, NamedChain
from soliton_linkage_nodes.runtime.serialization import serialize
from soliton_linkage_nodes.runtime.stamps import SECOND

_LITTLE_ENDIAN = b'\x00\x01'
_STAMP = struct.Struct('<4xiI')
_COUNT = struct.Struct('<I')
_ENCAPSULATION_BYTES = 4
"""Size of the encapsulation header [B]."""
_DOUBLES = np.dtype('<f8')
_EMPTY = np.zeros(0)
"""Array of an empty sequence."""


class Layout:
    """Byte layout of all messages that have the same frame id and the same joint names.

    CDR encodes a string as its length, its bytes and a zero byte. It encodes a sequence as the
    number of elements, followed by the elements. The lengths and the numbers of elements start at
    multiples of 4 bytes, and doubles at multiples of 8 bytes, counted from the end of the
    encapsulation header.
    """

    def __init__(self, frame_id: str, name: tuple[str, ...]) -> None:
        self.frame_id, self.name = frame_id, name
        texts = [text.encode() + b'\x00' for text in (frame_id, *name)]
        head = [_COUNT.pack(len(text)) + text + bytes(-len(text) % 4) for text in texts]
        mask = [b'\xff' * (4 + len(text)) + bytes(-len(text) % 4) for text in texts]
        head.insert(1, _COUNT.pack(len(name)))
        mask.insert(1, b'\xff' * 4)
        self._head = np.frombuffer(b''.join(head), '<u4')
        self._mask = np.frombuffer(b''.join(mask), '<u4')
        self._end = _STAMP.size + self._head.nbytes
        self._fitted = self._head.tobytes()

    def fits(self, serialized: bytes) -> bool:
        """Return whether a message has the frame id and the joint names of this layout."""
        if len(serialized) < self._end or not serialized.startswith(_LITTLE_ENDIAN):
            return False
        if serialized.startswith(self._fitted, _STAMP.size):
            return True
        head = np.frombuffer(serialized, '<u4', len(self._head), _STAMP.size)
        if ((head ^ self._head) & self._mask).any():
            return False
        self._fitted = head.tobytes()
        return True

    def arrays(self, serialized: bytes | bytearray, number: int) -> list[Array]:
        """Return the first `number` arrays of a message as views, which may be unaligned."""
        arrays, end = [], self._end
        for _ in range(number):
            (count,) = _COUNT.unpack_from(serialized, end)
            begin = end + 4
            if count:
                begin += -end % 8
                arrays.append(np.frombuffer(serialized, _DOUBLES, count, begin))
            else:
                arrays.append(_EMPTY)
            end = begin + 8 * count
        return arrays


class JointStateDecoder:
    """Decoder of joint states. It is fast as long as frame id and joint names do not change."""

    def __init__(self) -> None:
        self._layout: Layout | None = None

    def decode(self, serialized: bytes) -> JointStates:
        """Return the joint states. Their arrays may be views of `serialized`.

        Raises ValueError if the message is damaged.
        """
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                seconds, nanoseconds = _STAMP.unpack_from(serialized)
                position, velocity = layout.arrays(serialized, 2)
                names = layout.frame_id, layout.name
                return JointStates(seconds, nanoseconds, *names, position, velocity)
            message = deserialize_message(serialized, JointState)
        except Exception as error:  # a private error type of rclpy
            raise _damaged('joint_states', serialized, 'sensor_msgs/JointState', error) from error
        joints = conversions.joint_states_from_msg(message)
        self._layout = Layout(joints.frame_id, joints.name)
        return joints

    def same_joints(self, serialized: bytes) -> bool:
        """Return whether a message has the same frame id and names as the last decoded message."""
        return self._layout is not None and self._layout.fits(serialized)


class _RotorDecoder:
    """Decoder of messages with one value per joint. It is fast as long as names do not change."""

    _type: Any
    _topic: str
    _arrays: int
    _from_msg: Callable[[Mapping[str, int], Any, float], Array]

    def __init__(self, rotors: Mapping[str, int], largest: float) -> None:
        self._rotors = rotors
        self._largest = largest
        self._layout: Layout | None = None
        self._order = np.zeros(0, dtype=np.intp)

    def decode(self, serialized: bytes) -> Array:
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                given = layout.arrays(serialized, self._arrays)[-1]
                if len(given) == len(self._order) and (np.abs(given) <= self._largest).all():
                    values = np.zeros(len(self._rotors))
                    values[self._order] = given
                    return values
            message = deserialize_message(serialized, self._type)
        except Exception as error:  # a private error type of rclpy
            raise _damaged(self._topic, serialized, self._type.__name__, error) from error
        values = self._from_msg(self._rotors, message, self._largest)
        self._layout = Layout(message.header.frame_id, tuple(message.name))
        self._order = np.array([self._rotors[name] for name in message.name], dtype=np.intp)
        return values


class ImpulseDecoder(_RotorDecoder):
    """Decoder of rotor_impulses messages, which contain angular impulses [N m s]."""

    _type, _topic, _arrays = RotorImpulses, 'rotor_impulses', 1
    _from_msg = staticmethod(conversions.impulses_from_msg)


class TorqueDecoder(_RotorDecoder):
    """Decoder of rotor_torques messages. They are joint states whose efforts are torques [N m]."""

    _type, _topic, _arrays = JointState, 'rotor_torques', 3
    _from_msg = staticmethod(conversions.torques_from_msg)


def _damaged(topic: str, serialized: bytes, type_name: str, error: Exception) -> ValueError:
    return ValueError(
        f'{topic} of {len(serialized)} bytes is no valid {type_name}: {error}; check its publisher'
    )


class _MessageBuffer:
    """Serialized message. The method `fill` replaces the stamp and the arrays in place."""

    def __init__(self, message: Any, arrays: int) -> None:
        self._bytes = bytearray(serialize(message))
        layout = Layout(message.header.frame_id, tuple(message.name))
        self._arrays = layout.arrays(self._bytes, arrays)
        self._stamp = memoryview(self._bytes)[_ENCAPSULATION_BYTES:][:8].cast('I')

    def __len__(self) -> int:
        return len(self._bytes)

    def fill(self, stamp: int, *values: Array) -> bytearray:
        self._stamp[0], self._stamp[1] = divmod(stamp, SECOND)
        for array, filling in zip(self._arrays[-len(values) :], values, strict=True):
            array[...] = filling
        return self._bytes


class JointStateBuffer(_MessageBuffer):
    """Buffer for joint states: angles [rad], rates [rad/s] and torques [N m]."""

    def __init__(self, named: NamedChain) -> None:
        zeros = np.zeros(len(named.joint_names))
        message = conversions.frame_to_msg(named, Frame(zeros, zeros), zeros, Time())
        super().__init__(message, arrays=3)


class ImpulseBuffer(_MessageBuffer):
    """Buffer for a message with the angular impulses of all rotors [N m s]."""

    def __init__(self, named: NamedChain) -> None:
        message = conversions.impulses_to_msg(named, np.zeros(named.rotors), Time())
        super().__init__(message, arrays=1)


class TorqueBuffer(_MessageBuffer):
    """Buffer for joint states whose efforts are the torques on all rotors [N m]."""

    def __init__(self, named: NamedChain) -> None:
        message = conversions.torques_to_msg(named, np.zeros(named.rotors), Time())
        super().__init__(message, arrays=3)


def stamped(serialized: bytes, stamp: int) -> bytes:
    """Return a copy of a message with a header, in which `stamp` [ns] replaces the old stamp."""
    order = '<' if serialized[1:2] == _LITTLE_ENDIAN[1:] else '>'
    head = serialized[:_ENCAPSULATION_BYTES]
    return head + struct.pack(f'{order}iI', *divmod(stamp, SECOND)) + serialized[_STAMP.size :]


def publish_buffer(publisher: Publisher, serialized: bytearray) -> None:
    """Publish a serialized message without copying it, unlike `Publisher.publish`."""
    handle = publisher.handle
    with handle:
        handle.publish_raw(serialized)
