# SPDX-License-Identifier: Apache-2.0
"""Serialized messages whose stamp and arrays are overwritten in place."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message

from soliton_linkage_nodes.messages.conversions import (
    Array,
    Frame,
    NamedChain,
    frame_to_msg,
    impulses_to_msg,
)

_ENCAPSULATION_BYTES = 4
_NANOSECONDS = 10**9


class _StampedArrays:
    """A serialized message that begins with a stamp and ends in arrays of doubles.

    Names are most of the cost of serializing such a message and never change. CDR puts the
    arrays at the end, each a count, padded to 8 bytes from the end of the encapsulation header,
    and one double a joint.
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
    """Joint states of named joints as CDR bytes, of which only what changes is written anew."""

    def __init__(self, named: NamedChain) -> None:
        """Lay out the message once."""
        joints = len(named.joint_names)
        zeros = np.zeros(joints)
        template = frame_to_msg(named, Frame(zeros, zeros), zeros, Time())
        super().__init__(serialize_message(template), joints, arrays=3)
        self._position, self._velocity, self._effort = self._arrays

    def fill(self, stamp: int, angles: Array, rates: Array, torques: Array) -> bytearray:
        """Return the message for a frame: stamp [ns], angles [rad], rates [rad/s], [N m].

        It is the same object each time: the next frame overwrites this one.
        """
        self._stamp[0], self._stamp[1] = divmod(stamp, _NANOSECONDS)
        self._position[...] = angles
        self._velocity[...] = rates
        self._effort[...] = torques
        return self._bytes

    def write(self, stamp: int, angles: Array, rates: Array, torques: Array) -> bytes:
        """Return the same as `fill`, as a message of its own."""
        return bytes(self.fill(stamp, angles, rates, torques))


class ImpulseBuffer(_StampedArrays):
    """Angular impulses of all rotors as CDR bytes, of which only what changes is written anew."""

    def __init__(self, named: NamedChain) -> None:
        """Lay out the message once."""
        zeros = np.zeros(named.rotors)
        template = impulses_to_msg(named, zeros, Time())
        super().__init__(serialize_message(template), named.rotors, arrays=1)
        (self._impulse,) = self._arrays

    def fill(self, stamp: int, impulses: Array) -> bytearray:
        """Return the message: stamp [ns], impulses [N m s]; the next one overwrites it."""
        self._stamp[0], self._stamp[1] = divmod(stamp, _NANOSECONDS)
        self._impulse[...] = impulses
        return self._bytes


def publish_buffer(publisher: Publisher, serialized: bytearray) -> None:
    """Publish a serialized message; `Publisher.publish` takes bytes only, which are a copy."""
    handle = publisher.handle
    with handle:
        handle.publish_raw(serialized)
