# SPDX-License-Identifier: Apache-2.0
"""What comes of a chain, kept as the readings that it is identified by."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage.actuation.kick_record import DeliveryTotals
from soliton_linkage.identification.readings import (
    Readings,
    RecordedImpulse,
    RecordedTilt,
    informative_frames,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.messages.command_conversions import delivery_from_msg
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_MOST_PUSHES = 10_000
"""That are kept, and tilts [1]: what came before them is no time of free motion any more."""
_WAITING = 100
"""Standard deviations that are kept until their angles come [1]: they are sent together."""
_Pushes = deque[tuple[int, Array | None]]
"""Stamps [ns] and angular impulses [N m s], (N,), None where these are not known."""


def _none_yet() -> _Pushes:
    return deque(maxlen=_MOST_PUSHES)


class JointRecord:
    """Frames of joint states, no more than fit into memory and time, and what pushed rotors.

    What says which impulses were delivered, with the stamps of frames, counts in place of
    commands, which have another clock where a simulator does not keep time.
    """

    def __init__(self, joint_names: Sequence[str], most: int) -> None:
        """Begin without any; the names are those of the joints, rotor 0 first.

        Without names they are those of the first message, of angles or of their deviations.
        """
        self.joint_names = tuple(joint_names)
        self.frames = 0
        """How many came."""
        self._reader = FrameReader(joint_names) if joint_names else None
        self._most = most
        self._angles: dict[int, Array] = {}
        self._deviations: dict[int, Array] = {}
        self._latest: int | None = None
        self._commanded_impulses, self._commanded_torques = _none_yet(), _none_yet()
        self._delivered_impulses, self._delivered_torques = _none_yet(), _none_yet()
        self._delivered: DeliveryTotals | None = None
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
        self._angles[joints.stamp] = angles
        if len(self._angles) > self._most:
            self._thin_out()
        self.frames += 1

    def add_deviations(self, joints: JointStates) -> None:
        """Keep the standard deviations of the angles of the same stamp.

        Raises ValueError for joint states that are refused.
        """
        self._deviations[joints.stamp] = self._read(joints)
        if len(self._deviations) > len(self._angles) + _WAITING:
            self._forget_deviations()

    def add_push(self, message: RotorImpulses | JointState, received: int) -> None:
        """Keep when impulses or torques, other than 0, were commanded; without a stamp, came.

        Before the joints are known there is nothing that they could have moved.
        """
        stamp = time_from_msg(message.header.stamp) or received
        if isinstance(message, RotorImpulses):
            self._add_impulses(self._commanded_impulses, stamp, message)
        elif self.joint_names and any(message.effort):
            self._commanded_torques.append((stamp, None))

    def add_delivered(self, message: RotorImpulses) -> None:
        """Keep impulses that rotors were given until a frame."""
        stamp = time_from_msg(message.header.stamp)
        self._add_impulses(self._delivered_impulses, stamp, message)

    def add_delivery(self, message: Delivery) -> None:
        """Keep what torques gave the rotors of a simulator since the message before."""
        before, now = self._delivered, delivery_from_msg(message)
        self._delivered = now
        if before is not None and len(now.impulse_of_torques) == len(self.joint_names):
            given = now.impulse_of_torques - before.impulse_of_torques
            if given.any():
                self._delivered_torques.append((now.stamp, given))

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
            RecordedImpulse((stamp - begin) / SECOND, impulses) for stamp, impulses in self._pushes
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

    def _add_impulses(self, pushes: _Pushes, stamp: int, message: RotorImpulses) -> None:
        named = dict(zip(message.name, message.impulse, strict=True))
        impulses = np.array([named.get(name, 0.0) for name in self.joint_names])
        if impulses.any():
            pushes.append((stamp, impulses))

    @property
    def _pushes(self) -> list[tuple[int, Array | None]]:
        """What pushed rotors, by who knows best."""
        torques = self._commanded_torques
        if self._delivered is not None:
            torques = self._delivered_torques
        elif self._delivered_impulses:
            torques = _none_yet()
        return [*(self._delivered_impulses or self._commanded_impulses), *torques]

    def _thin_out(self) -> None:
        """Forget frames that tell least, half of all."""
        stamps = np.array(list(self._angles))
        pushes = [(stamp - stamps[0]) / SECOND for stamp, _ in self._pushes]
        times, angles = (stamps - stamps[0]) / SECOND, np.array(list(self._angles.values()))
        stay = informative_frames(times, angles, pushes, self._most // 2)
        self._angles = {stamp: self._angles[stamp] for stamp in stamps[stay].tolist()}
        self._forget_deviations()

    def _forget_deviations(self) -> None:
        """Forget those whose angles are not kept, but for the last ones, whose may yet come."""
        recent = set(list(self._deviations)[-_WAITING:])
        self._deviations = {
            stamp: values
            for stamp, values in self._deviations.items()
            if stamp in self._angles or stamp in recent
        }
