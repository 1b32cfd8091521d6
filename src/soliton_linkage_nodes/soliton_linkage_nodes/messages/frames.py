# SPDX-License-Identifier: Apache-2.0
"""Extraction, checks and assembly of frames from joint states."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from soliton_linkage.identification.mounting import in_degrees
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.quantities import LARGEST_ANGLE
from soliton_linkage_nodes.messages import conversions
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import Frame, JointStates
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.serialization import serialize
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_nodes.runtime.subscriptions import subscribe_newest


class FrameReader:
    """Reader of the angles and rates of all rotors from joint states."""

    def __init__(self, joint_names: Sequence[str], encoder_offsets: Sequence[float] = ()) -> None:
        if not joint_names:
            raise ValueError('joint_states.name is empty; name the joints')
        self._offsets = np.array(encoder_offsets, dtype=np.float64)
        self.joint_names = tuple(joint_names)
        self._rotors = {name: rotor for rotor, name in enumerate(joint_names)}
        self._names: tuple[str, ...] | None = None
        self._joints = self._positions = np.zeros(0, dtype=np.intp)
        self._in_order = False

    def read(self, joints: JointStates) -> Frame:
        """Return the angles [rad] and angular velocities [rad/s] of all rotors.

        Missing values, and values with an absolute value above 1e9, are NaN. Raises ValueError if
        the message is invalid.
        """
        _, _, _, name, position, velocity = joints
        conversions.check_length('joint_states.position', name, position)
        if name is not self._names and name != self._names:
            self._set_names(name)
        angles = conversions.without_offsets(self._ordered(position), self._offsets)
        if not len(velocity):
            return Frame(angles, None)
        conversions.check_length('joint_states.velocity', name, velocity)
        return Frame(angles, self._ordered(velocity))

    def _set_names(self, names: tuple[str, ...]) -> None:
        conversions.check_names('joint_states.name', names)
        known = [(joint, self._rotors[n]) for joint, n in enumerate(names) if n in self._rotors]
        if not known:
            first = next(iter(self._rotors))
            raise ValueError(
                f'joint_states.name has none of the {len(self._rotors)} rotors, such as '
                f'{first!r}; set the parameter joint_names'
            )
        self._joints, self._positions = np.array(known, dtype=np.intp).T
        self._in_order = names == self.joint_names
        self._names = names

    def _ordered(self, values: Array) -> Array:
        values = values.copy()
        if not np.maximum.reduce(np.abs(values), initial=0.0) <= LARGEST_ANGLE:
            values[~(np.abs(values) <= LARGEST_ANGLE)] = np.nan
        if self._in_order:
            return values
        ordered = np.full(len(self._rotors), np.nan)
        ordered[self._positions] = values[self._joints]
        return ordered


_LONGEST_LATENESS = SECOND
"""Largest decrease of the stamp for which the monitor warns that frames are out of order [ns]. If
the stamp decreases by more, the clock was reset."""
_UNIT_CHECK_INTERVAL = 100
"""Number of frames between checks of the angle unit [1], because one check takes 80 us."""


class EncoderMonitor:
    """Monitor that warns once about each of three faults of joint states.

    The faults are: the stamp is 0; the stamp equals the previous stamp or is up to 1 s earlier;
    the angles are in degrees.
    """

    def __init__(self, warn: Callable[[str], object]) -> None:
        self._warn = warn
        self._warned: set[str] = set()
        self._last: int | None = None
        self._frames = 0

    def check(self, stamp: int, angles: Array | None = None) -> None:
        """Check the stamp of a frame [ns] and the unit of its angles. Some angles may be NaN."""
        if stamp == 0:
            self._warn_once(
                'joint_states have no stamps; stamp each frame with the time of its measurement, '
                'or set parameter stamps of soliton_analyser to arrival'
            )
        elif self._last is not None and 0 <= self._last - stamp <= _LONGEST_LATENESS:
            before = self._last - stamp
            how = f'{before / SECOND:g} s before' if before else 'equal to'
            self._warn_once(
                f'joint_states are not in order: a stamp is {how} the previous one; '
                'publish each frame once, in the order of their stamps',
                'late',
            )
        self._last = stamp
        if angles is not None and self._frames % _UNIT_CHECK_INTERVAL == 0 and in_degrees(angles):
            self._warn_once('the angles in joint_states look like degrees; publish radians')
        self._frames += 1

    def _warn_once(self, fault: str, kind: str = '') -> None:
        if (kind or fault) not in self._warned:
            self._warned.add(kind or fault)
            self._warn(fault)


_SHORT_FRAMES = 10
"""After this number of consecutive incomplete frames [1], the assembler no longer waits for the
missing joints. Sensitivity: at 0.5x, an encoder board that pauses for 5 to 9 frames causes one
more incomplete frame when it returns, because the assembler no longer waits for it; at 2x, twice
as many frames are delayed after an encoder board has stopped."""


class FrameAssembler:
    """Assembler that merges messages with equal stamps and different joints into frames.

    Several encoder boards may each publish some of the joints. The assembler returns a frame when
    the frame has all joints of the chain, or all joints that earlier merged frames had. Otherwise
    it returns the incomplete frame when a message with another stamp arrives.

    There is one exception. If the message after the first incomplete message has another stamp,
    the assembler assumes that each message is one frame. It then returns each later message at
    once, until two messages have equal stamps and different joints. These two messages are
    returned separately. The assembler merges messages from the next stamp on.
    """

    def __init__(self, joint_names: Sequence[str] = ()) -> None:
        self._rotors = frozenset(joint_names)
        self._parts: list[JointStates] = []
        self._joints: frozenset[str] = frozenset()
        self._expected: frozenset[str] | None = None
        self._short = 0
        self._last: tuple[int, frozenset[str]] | None = None
        self.whole: tuple[str, ...] | None = None
        """Joint names of the last message that contained all joints of the chain, or None."""

    @property
    def waiting_since(self) -> int | None:
        """Stamp of the incomplete frame [ns], or None if no frame is incomplete."""
        return self._parts[0].stamp if self._parts else None

    def add(self, joints: JointStates) -> list[JointStates]:
        """Add a message and return the frames that are complete or have ended with this message.

        Raises ValueError if the message is invalid.
        """
        if not self._parts and joints.name is self.whole:
            self._last = joints.stamp, self._rotors
            return [joints]
        conversions.check_names('joint_states.name', joints.name)
        names = frozenset(joints.name)
        names = names & self._rotors if self._rotors else names
        if not names:
            return [joints]
        if not (self._rotors and names == self._rotors):
            conversions.check_length('joint_states.position', joints.name, joints.position)
            if len(joints.velocity):
                conversions.check_length('joint_states.velocity', joints.name, joints.velocity)
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
        """Yield all frames in a sequence of messages. The last frame may be incomplete."""
        for joints in messages:
            yield from self.add(joints)
        yield from self.flush()

    def flush(self) -> list[JointStates]:
        """Return a list with the incomplete frame, or an empty list if no frame is incomplete."""
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
    """Assembler of serialized frames. It does not decode messages that are complete frames."""

    def __init__(self) -> None:
        self._decoder = JointStateDecoder()
        self._assembler: FrameAssembler | None = None
        self._all_alike = False

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Set the joints that later frames contain."""
        self._assembler, self._all_alike = FrameAssembler(joint_names), False

    def parts(self, serialized: bytes) -> tuple[str, ...]:
        """Return the joint names in a serialized message; () if the message is damaged."""
        with suppress(ValueError):
            return self._decoder.decode(serialized).name
        return ()

    def add(self, serialized: bytes) -> list[bytes]:
        """Add a message and return the serialized frames that are complete or have ended.

        An invalid message is returned unchanged.
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


_DEPTH = 200
"""Queue depth if a frame consists of several messages [messages]. At 1000 messages per second the
queue holds the messages of 0.2 s."""
_LONGEST_ASSEMBLY = 0.3
"""Time without messages after which an incomplete frame is returned [s]."""


class NewestFrame:
    """Subscription of a display to the newest frame.

    The node must not be added to an executor. The queue holds one message until a message lacks
    some joints of the chain. From then on, the queue holds 200 messages, and the messages are
    assembled to frames.
    """

    def __init__(self, node: Node, name: str) -> None:
        self.number: int | None = None
        """Number of the newest frame, or None if it is unknown. If each message is one frame, it
        is the sequence number from the publisher. Otherwise the frames are counted here."""
        self._node, self._name = node, name
        self._decoder = JointStateDecoder()
        self._assembler = FrameAssembler()
        self._joints: frozenset[str] = frozenset()
        self._divided = False
        self._taken_at = 0.0
        self._subscription = subscribe_newest(node, interfaces.JOINT_STATES, name, raw=True)

    @property
    def publishers(self) -> int:
        """Number of publishers that existed at the last call of `adapt`."""
        return len(self._subscription.publishers)

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Set the joints that later frames contain."""
        self._joints = frozenset(joint_names)
        self._assembler = FrameAssembler(joint_names)

    def take(self) -> JointStates | None:
        """Return the newest frame, or None if no frame has arrived since the last call.

        Raises ValueError if a message is damaged.
        """
        return self._assembled() if self._divided else self._last()

    def adapt(self) -> None:
        """Change the quality of service if new publishers require it."""
        self._subscription.adapt()

    def close(self) -> None:
        """Unsubscribe."""
        self._subscription.close()

    def _last(self) -> JointStates | None:
        serialized = self._subscription.newest()
        if serialized is None:
            return None
        joints = self._decoder.decode(serialized)
        self.number = self._subscription.sequence
        absent = self._joints.difference(joints.name)
        self._divided = 0 < len(absent) < len(self._joints)
        if self._divided:
            self.close()
            topic = interfaces.JOINT_STATES
            self._subscription = subscribe_newest(
                self._node, topic, self._name, raw=True, depth=_DEPTH
            )
        return joints

    def _assembled(self) -> JointStates | None:
        frames: list[JointStates] = []
        now = time.monotonic()
        for serialized, _ in self._subscription.waiting():
            self._taken_at = now
            frames += self._assembler.add(self._decoder.decode(serialized))
        if not frames and now - self._taken_at > _LONGEST_ASSEMBLY:
            frames = self._assembler.flush()
        self.number = (self.number or 0) + len(frames)
        return frames[-1] if frames else None
