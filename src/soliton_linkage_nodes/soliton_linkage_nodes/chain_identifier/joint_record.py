# SPDX-License-Identifier: Apache-2.0
"""What comes of a chain, kept as the readings that it is identified by."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage.identification.readings import Readings, RecordedPush, RecordedTilt
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_MOST_PUSHES = 10_000
"""That are kept, and tilts [1]: what came before them is no time of free motion any more."""
_WAITING = 100
"""Standard deviations that are kept until their angles come [1]: they are sent together."""


class JointRecord:
    """Frames of joint states, evenly thinned out to a number that fits into memory and time."""

    def __init__(self, joint_names: Sequence[str], most: int) -> None:
        """Begin without any; the names are those of the joints, rotor 0 first.

        Without names they are those of the first message, of angles or of their deviations.
        """
        self.joint_names = tuple(joint_names)
        self.frames = 0
        """How many came."""
        self.thinned = 1
        """One frame of so many is kept."""
        self._reader = FrameReader(joint_names) if joint_names else None
        self._most = most
        self._angles: dict[int, Array] = {}
        self._deviations: dict[int, Array] = {}
        self._latest: int | None = None
        self._pushes: deque[tuple[int, Array | None]] = deque(maxlen=_MOST_PUSHES)
        self._tilts: deque[tuple[int, float]] = deque(maxlen=_MOST_PUSHES)

    def __len__(self) -> int:
        return len(self._angles)

    def add(self, joints: JointStates) -> None:
        """Keep a frame, unless it is not later than the one before.

        Raises ValueError for joint states that are refused.
        """
        angles = self._read(joints)
        if self._latest is not None and joints.stamp <= self._latest:
            return
        self._latest = joints.stamp
        if self.frames % self.thinned == 0:
            self._angles[joints.stamp] = angles
            if len(self._angles) > self._most:
                self._angles = dict(list(self._angles.items())[::2])
                self._forget_deviations()
                self.thinned *= 2
        self.frames += 1

    def add_deviations(self, joints: JointStates) -> None:
        """Keep the standard deviations of the angles of the same stamp.

        Raises ValueError for joint states that are refused.
        """
        self._deviations[joints.stamp] = self._read(joints)
        if len(self._deviations) > len(self._angles) + _WAITING:
            self._forget_deviations()

    def add_push(self, message: RotorImpulses | JointState, received: int) -> None:
        """Keep when impulses or torques, other than 0, acted; without a stamp when they came.

        Before the joints are known there is nothing that they could have moved.
        """
        if not self.joint_names:
            return
        impulses = None
        if isinstance(message, RotorImpulses):
            named = dict(zip(message.name, message.impulse, strict=True))
            impulses = np.array([named.get(name, 0.0) for name in self.joint_names])
        if any(message.effort if impulses is None else impulses):
            self._pushes.append((time_from_msg(message.header.stamp) or received, impulses))

    def add_tilt(self, tilt: float, received: int) -> None:
        """Keep a tilt of the chain [rad] from an instant on [ns]."""
        self._tilts.append((received, tilt))

    def readings(self, gravity: Gravity = NO_GRAVITY) -> Readings:
        """All of it, with times from the first frame on, and gravity as it was at first."""
        begin = next(iter(self._angles), 0)
        times = np.array([(stamp - begin) / SECOND for stamp in self._angles], dtype=np.float64)
        unknown = np.full(len(self.joint_names), np.nan)
        deviations = [self._deviations.get(stamp, unknown) for stamp in self._angles]
        pushes = [
            RecordedPush((stamp - begin) / SECOND, impulses) for stamp, impulses in self._pushes
        ]
        return Readings(
            times,
            np.array(list(self._angles.values())),
            np.array(deviations) if self._deviations else None,
            self.joint_names,
            pushes,
            gravity,
            [RecordedTilt((stamp - begin) / SECOND, tilt) for stamp, tilt in self._tilts],
        )

    def _read(self, joints: JointStates) -> Array:
        reader = self._reader or FrameReader(joints.name)
        values = reader.read(joints).angles
        self._reader, self.joint_names = reader, reader.joint_names
        return values

    def _forget_deviations(self) -> None:
        """Forget those whose angles are not kept, but for the last ones, whose may yet come."""
        recent = set(list(self._deviations)[-_WAITING:])
        self._deviations = {
            stamp: values
            for stamp, values in self._deviations.items()
            if stamp in self._angles or stamp in recent
        }
