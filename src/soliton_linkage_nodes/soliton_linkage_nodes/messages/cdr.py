# SPDX-License-Identifier: Apache-2.0
"""Messages of a stamp, names and arrays of one double a name, as their CDR bytes.

Names are most of the cost of such a message and never change. Decoders tell by their bytes that
they are those of the message before and take the arrays from behind them; buffers overwrite the
stamp and the arrays in place.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    JointStates,
    NamedChain,
    frame_to_msg,
    impulses_from_msg,
    impulses_to_msg,
    joint_states_from_msg,
)
from soliton_linkage_nodes.runtime.stamps import SECOND

_LITTLE_ENDIAN = b'\x00\x01'
_STAMP = struct.Struct('<4xiI')
_COUNT = struct.Struct('<I')
_ENCAPSULATION_BYTES = 4
"""Before the message itself: how it is encoded."""
_NOTHING = np.zeros(0)
"""An empty sequence."""


class Layout:
    """Where in its bytes a message with a certain frame and names has its arrays of doubles.

    CDR writes a string as the length of its bytes with the final zero, and them; a sequence as
    its count and the elements. Counts begin at multiples of 4 bytes, doubles at multiples of 8,
    from the end of the 4 bytes of the encapsulation header. What lies between can be anything.
    """

    def __init__(self, frame_id: str, name: tuple[str, ...]) -> None:
        """Lay out what stands between the stamp and the arrays."""
        self.frame_id, self.name = frame_id, name
        texts = [text.encode() + b'\x00' for text in (frame_id, *name)]
        head = [_COUNT.pack(len(text)) + text + bytes(-len(text) % 4) for text in texts]
        meant = [b'\xff' * (4 + len(text)) + bytes(-len(text) % 4) for text in texts]
        head.insert(1, _COUNT.pack(len(name)))
        meant.insert(1, b'\xff' * 4)
        self._head = np.frombuffer(b''.join(head), '<u4')
        self._meant = np.frombuffer(b''.join(meant), '<u4')
        self._end = _STAMP.size + self._head.nbytes
        self._fitted = self._head.tobytes()

    def fits(self, serialized: bytes) -> bool:
        """Whether a message has the frame and the names."""
        if len(serialized) < self._end or not serialized.startswith(_LITTLE_ENDIAN):
            return False
        if serialized.startswith(self._fitted, _STAMP.size):
            return True
        head = np.frombuffer(serialized, '<u4', len(self._head), _STAMP.size)
        if ((head ^ self._head) & self._meant).any():
            return False
        self._fitted = head.tobytes()
        return True

    def stamp(self, serialized: bytes) -> tuple[int, int]:
        """Seconds and nanoseconds since the epoch of a message that fits."""
        seconds, nanoseconds = _STAMP.unpack_from(serialized)
        return seconds, nanoseconds

    def arrays(self, serialized: bytes, number: int) -> list[Array]:
        """The first arrays of a message that fits, maybe unaligned views of it."""
        arrays, end = [], self._end
        for _ in range(number):
            array, end = _doubles(serialized, end)
            arrays.append(array)
        return arrays


class JointStateDecoder:
    """Decodes joint states, fast where frame and names are those of the message before."""

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
            return seconds * SECOND + nanoseconds
        return self.decode(serialized).stamp


class ImpulseDecoder:
    """Decodes rotor_impulses, fast where frame and names are those of the message before."""

    def __init__(self, rotors: Mapping[str, int], largest: float) -> None:
        """Number of each rotor by its name, and the largest impulse accepted [N m s]."""
        self._rotors = rotors
        self._largest = largest
        self._layout: Layout | None = None
        self._order = np.zeros(0, dtype=np.intp)

    def decode(self, serialized: bytes) -> Array:
        """Impulse of each rotor [N m s], shape (N,); ValueError unless all are acceptable."""
        layout = self._layout
        try:
            if layout is not None and layout.fits(serialized):
                (given,) = layout.arrays(serialized, 1)
                if len(given) == len(self._order) and (np.abs(given) <= self._largest).all():
                    impulses = np.zeros(len(self._rotors))
                    impulses[self._order] = given
                    return impulses
            message = deserialize_message(serialized, RotorImpulses)
        except Exception as error:  # rclpy's own has no public name
            raise ValueError(
                f'rotor_impulses of {len(serialized)} bytes are no RotorImpulses: {error}; mend '
                'what publishes them'
            ) from error
        impulses = impulses_from_msg(self._rotors, message, self._largest)
        self._layout = Layout(message.header.frame_id, tuple(message.name))
        self._order = np.array([self._rotors[name] for name in message.name], dtype=np.intp)
        return impulses


class _StampedArrays:
    """A serialized message that begins with a stamp and ends in arrays of doubles.

    CDR puts the arrays at the end, each a count, padded to 8 bytes from the end of the
    encapsulation header, and one double a joint.
    """

    def __init__(self, template: bytes, joints: int, arrays: int) -> None:
        """Overwrite so many arrays of a message, each of one value a joint."""
        self._bytes = bytearray(template)
        body = np.frombuffer(self._bytes, dtype=np.uint8)[_ENCAPSULATION_BYTES:]
        array_bytes = 8 * joints
        count_bytes = 8
        # Serializers may pad a message at its end; the counts tell where the arrays are.
        all_arrays = arrays * array_bytes + (arrays - 1) * count_bytes
        end = len(body) - (len(body) - all_arrays) % 8
        starts = [
            end - array_bytes - n * (array_bytes + count_bytes) for n in reversed(range(arrays))
        ]
        self._arrays = [body[start : start + array_bytes].view('<f8') for start in starts]
        self._stamp = memoryview(self._bytes)[_ENCAPSULATION_BYTES:][:8].cast('I')

    def __len__(self) -> int:
        """Size of the message in bytes."""
        return len(self._bytes)


class JointStateBuffer(_StampedArrays):
    """Joint states of named joints: angles [rad], rates [rad/s] and torques [N m]."""

    def __init__(self, named: NamedChain) -> None:
        """Lay out the message once."""
        joints = len(named.joint_names)
        zeros = np.zeros(joints)
        template = frame_to_msg(named, Frame(zeros, zeros), zeros, Time())
        super().__init__(serialize_message(template), joints, arrays=3)
        self._position, self._velocity, self._effort = self._arrays

    def fill(self, stamp: int, angles: Array, rates: Array, torques: Array) -> bytearray:
        """Return the message for a frame of a stamp [ns].

        It is the same object each time: the next frame overwrites this one.
        """
        self._stamp[0], self._stamp[1] = divmod(stamp, SECOND)
        self._position[...] = angles
        self._velocity[...] = rates
        self._effort[...] = torques
        return self._bytes

    def write(self, stamp: int, angles: Array, rates: Array, torques: Array) -> bytes:
        """Return the same as `fill`, as a message of its own."""
        return bytes(self.fill(stamp, angles, rates, torques))


class ImpulseBuffer(_StampedArrays):
    """Angular impulses of all rotors [N m s]."""

    def __init__(self, named: NamedChain) -> None:
        """Lay out the message once."""
        template = impulses_to_msg(named, np.zeros(named.rotors), Time())
        super().__init__(serialize_message(template), named.rotors, arrays=1)
        (self._impulse,) = self._arrays

    def fill(self, stamp: int, impulses: Array) -> bytearray:
        """Return the message of a stamp [ns]; the next one overwrites it."""
        self._stamp[0], self._stamp[1] = divmod(stamp, SECOND)
        self._impulse[...] = impulses
        return self._bytes


def stamp_of(serialized: bytes) -> int:
    """Stamp of a message that begins with a header [ns], 0 where it is not little-endian."""
    if not serialized.startswith(_LITTLE_ENDIAN):
        return 0
    seconds, nanoseconds = _STAMP.unpack_from(serialized)
    return int(seconds) * SECOND + int(nanoseconds)


def publish_buffer(publisher: Publisher, serialized: bytearray) -> None:
    """Publish a serialized message; `Publisher.publish` takes bytes only, which are a copy."""
    handle = publisher.handle
    with handle:
        handle.publish_raw(serialized)


def _doubles(serialized: bytes, begin: int) -> tuple[Array, int]:
    """A sequence of doubles and where it ends."""
    (count,) = _COUNT.unpack_from(serialized, begin)
    if not count:
        return _NOTHING, begin + 4
    first = begin + 4 + -begin % 8
    return np.frombuffer(serialized, '<f8', count, first), first + 8 * count
