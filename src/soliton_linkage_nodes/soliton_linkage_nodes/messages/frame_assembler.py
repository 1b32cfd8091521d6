# SPDX-License-Identifier: Apache-2.0
"""Assembly of complete frames from joint states that arrive in several messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import JointStates, check_length, check_names
from soliton_linkage_nodes.runtime.serialization import serialize

_SHORT_FRAMES = 10
"""After this number of consecutive incomplete frames [1], the assembler no longer waits for the
missing joints. Sensitivity: at 0.5x, one more frame is incomplete after a pause of an encoder
board; at 2x, frames are late for longer after joints have disappeared."""


class FrameAssembler:
    """Assembler that merges messages with equal stamps and different joints into frames.

    A frame is complete when it has all joints of the chain, or all joints of those earlier frames
    that were merged from several messages. An incomplete frame ends when a message with another
    stamp arrives. If it then consists of a single message, the assembler returns each later
    message as a frame, until two messages have the same stamp.
    """

    def __init__(self, joint_names: Sequence[str] = ()) -> None:
        self._rotors = frozenset(joint_names)
        self._parts: list[JointStates] = []
        self._joints: frozenset[str] = frozenset()
        self._expected: frozenset[str] | None = None
        self._short = 0
        self._last: tuple[int, frozenset[str]] | None = None
        self.whole: tuple[str, ...] | None = None
        """Names in the last message that contained all joints of the chain, or None."""

    @property
    def waiting_since(self) -> int | None:
        """Stamp of the incomplete frame [ns], or None."""
        return self._parts[0].stamp if self._parts else None

    def add(self, joints: JointStates) -> list[JointStates]:
        """Add a message; return the frames that it completes or ends; ValueError if invalid."""
        if not self._parts and joints.name is self.whole:
            self._last = joints.stamp, self._rotors
            return [joints]
        check_names('joint_states.name', joints.name)
        names = frozenset(joints.name)
        names = names & self._rotors if self._rotors else names
        if not names:
            return [joints]
        if not (self._rotors and names == self._rotors):
            check_length('joint_states.position', joints.name, joints.position)
            if len(joints.velocity):
                check_length('joint_states.velocity', joints.name, joints.velocity)
        same = joints.stamp == self.waiting_since
        if same and names.isdisjoint(self._joints):
            self._parts.append(joints)
            self._joints |= names
            return self._complete()
        earlier = self.flush()
        if self._last is not None and self._last[0] == joints.stamp:
            rest = names.isdisjoint(self._last[1])
            self._expected = names | self._last[1] if rest else self._expected
            return [*earlier, joints]
        self._parts, self._joints = [joints], names
        return [*earlier, *self._complete()]

    def add_all(self, messages: Iterable[JointStates]) -> Iterator[JointStates]:
        """Yield all frames of a record of messages. The last frame may be incomplete."""
        for joints in messages:
            yield from self.add(joints)
        yield from self.flush()

    def flush(self) -> list[JointStates]:
        """End the incomplete frame; return it in a list, which is empty if there is none."""
        if not self._parts:
            return []
        self._short += 1
        divided = len(self._parts) > 1
        frame = self._take()
        if self._short >= _SHORT_FRAMES:
            self._expected, self._short = self._joints if divided else frozenset(), 0
        return [frame]

    def _complete(self) -> list[JointStates]:
        whole = bool(self._rotors) and self._joints == self._rotors
        if not whole and (self._expected is None or not self._joints >= self._expected):
            return []
        self._short = 0
        if whole and len(self._parts) == 1:
            self.whole = self._parts[0].name
        return [self._take()]

    def _take(self) -> JointStates:
        parts, self._parts = self._parts, []
        self._last = parts[0].stamp, self._joints
        expected = self._expected or frozenset()
        if len(parts) > 1:
            self._expected = expected | self._joints
        elif self._joints != self._rotors:
            self._expected = expected
        return parts[0] if len(parts) == 1 else self._merged(parts)

    def _merged(self, parts: Sequence[JointStates]) -> JointStates:
        names: list[str] = []
        positions: list[Array] = []
        rates: list[Array] = []
        for part in parts:
            at = [
                n for n, name in enumerate(part.name) if not self._rotors or name in self._rotors
            ]
            names += [part.name[n] for n in at]
            positions.append(part.position[at])
            rates.append(part.velocity[at] if len(part.velocity) else np.full(len(at), np.nan))
        velocity = parts[0].velocity
        if any(len(part.velocity) for part in parts):
            velocity = np.concatenate(rates)
        return parts[0]._replace(
            name=tuple(names), position=np.concatenate(positions), velocity=velocity
        )


class SerializedFrames:
    """Assembler of serialized frames. It decodes messages only if this is necessary."""

    def __init__(self) -> None:
        self._decoder = JointStateDecoder()
        self._assembler: FrameAssembler | None = None
        self._all_alike = False

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Assemble frames of these joints from now on."""
        self._assembler, self._all_alike = FrameAssembler(joint_names), False

    def parts(self, serialized: bytes) -> tuple[str, ...]:
        """Return the joint names in a serialized message, () if the message is damaged."""
        with suppress(ValueError):
            return self._decoder.decode(serialized).name
        return ()

    def add(self, serialized: bytes) -> list[bytes]:
        """Add a message; return the serialized frames that it completes or ends.

        An invalid message is returned without changes.
        """
        if self._assembler is None:
            return [serialized]
        if self._all_alike and self._decoder.same_joints(serialized):
            return [serialized]
        try:
            joints = self._decoder.decode(serialized)
            frames = self._assembler.add(joints)
        except ValueError:
            return [serialized]
        self._all_alike = self._assembler.whole is joints.name
        return [serialized if frame is joints else _serialized(frame) for frame in frames]


def _serialized(frame: JointStates) -> bytes:
    stamp = Time(sec=frame.seconds, nanosec=frame.nanoseconds)
    message = JointState(
        header=Header(stamp=stamp, frame_id=frame.frame_id),
        name=list(frame.name),
        position=frame.position.tolist(),
        velocity=frame.velocity.tolist(),
    )
    return serialize(message)
