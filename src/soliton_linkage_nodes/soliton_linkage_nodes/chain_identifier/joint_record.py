# SPDX-License-Identifier: Apache-2.0
"""Record of joint states, impulses and tilts, from which a chain is identified."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState

from soliton_linkage.actuation.kick_record import DeliveryTotals
from soliton_linkage.identification import readings
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity
from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.messages.command_conversions import delivery_from_msg
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.frames import FrameAssembler, FrameReader
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg

_MOST_IMPULSES = 10_000
"""Largest number of stored entries of each kind [1]. The kinds are commanded impulses, commanded
torques, delivered impulses, impulses of delivered torques, tilts and resets. If there are more,
the earliest entries are dropped."""
_MOST_UNMATCHED = 100
"""Largest number of messages with standard deviations that are stored without their frame [1]."""
_Impulses = deque[tuple[int, Array | None]]
"""Stamps [ns] and angular impulses [N m s], shape (N,). Unknown impulses are None."""


def _no_impulses() -> _Impulses:
    return deque(maxlen=_MOST_IMPULSES)


class JointRecord:
    """Record of frames, impulses and tilts of a chain.

    If messages report delivered impulses, the record does not use the commanded ones. If a
    simulated chain is reset, the record is divided into several recordings.
    """

    def __init__(self, joint_names: Sequence[str], most: int) -> None:
        """Create a record of at most `most` frames.

        If `joint_names` is empty, the record uses the names in the first message.
        """
        self.joint_names = tuple(joint_names)
        self.frames = 0
        self._assembler = FrameAssembler(joint_names)
        self._reader = FrameReader(joint_names) if joint_names else None
        self._most = most
        self._angles: dict[int, Array] = {}
        self._deviations: dict[int, Array] = {}
        self._latest = -math.inf
        self._last: deque[tuple[int, Array]] = deque(maxlen=4)
        self._resets: deque[int] = deque(maxlen=_MOST_IMPULSES)
        self._commanded_impulses, self._commanded_torques = _no_impulses(), _no_impulses()
        self._delivered_impulses, self._delivered_torques = _no_impulses(), _no_impulses()
        self._delivered: DeliveryTotals | None = None
        self._tilts: deque[tuple[int, float]] = deque(maxlen=_MOST_IMPULSES)

    def __len__(self) -> int:
        return len(self._angles)

    def add(self, joints: JointStates) -> None:
        """Add a message, and store the frames that are complete or have ended with this message.

        A frame may consist of several messages with equal stamps and different joints. A frame is
        ignored if its stamp is not later than the stamps of all stored frames. Raises ValueError
        if the message or a frame is invalid.
        """
        for frame in self._assembler.add(joints):
            self._keep(frame)

    def finish(self) -> None:
        """Store the last frame, which may lack joints; ValueError if it is invalid."""
        for frame in self._assembler.flush():
            self._keep(frame)

    def _keep(self, joints: JointStates) -> None:
        angles = self._read(joints)
        if joints.stamp <= self._latest:
            return
        self._latest = joints.stamp
        self._angles[joints.stamp] = angles
        self._note_reset(joints.stamp, angles)
        if len(self._angles) > self._most:
            self._keep_most_informative()
        self.frames += 1

    def _note_reset(self, stamp: int, angles: Array) -> None:
        self._last.append((stamp, angles))
        if len(self._last) == self._last.maxlen:
            stamps, frames = zip(*self._last, strict=True)
            if readings.is_reset([(each - stamps[0]) / SECOND for each in stamps], frames):
                self._resets.append(stamps[2])

    def add_deviations(self, joints: JointStates) -> None:
        """Store the standard deviations of a frame's angles; ValueError if they are invalid."""
        named = self._reader is not None
        self._deviations[joints.stamp] = self._read(joints)
        if not named:
            self._assembler = FrameAssembler(self.joint_names)
        if len(self._deviations) > len(self._angles) + _MOST_UNMATCHED:
            self._drop_unmatched_deviations()

    def add_command(self, message: RotorImpulses | JointState, received: int) -> None:
        """Store commanded impulses, or the time of commanded torques that are not zero.

        The impulse of commanded torques is unknown, because the message does not state for how
        long they act. `received` [ns] replaces the stamp if the message has none.
        """
        stamp = time_from_msg(message.header.stamp) or received
        if isinstance(message, RotorImpulses):
            self._add_impulses(self._commanded_impulses, stamp, message)
        elif self.joint_names and any(message.effort):
            self._commanded_torques.append((stamp, None))

    def add_delivered_impulses(self, message: RotorImpulses) -> None:
        """Store the impulses of a `delivered_impulses` message."""
        stamp = time_from_msg(message.header.stamp)
        self._add_impulses(self._delivered_impulses, stamp, message)

    def add_delivery(self, message: Delivery) -> None:
        """Store the impulses that torques have caused since the previous message of `delivery`."""
        before, now = self._delivered, delivery_from_msg(message)
        self._delivered = now
        if before is not None and len(now.impulse_of_torques) == len(self.joint_names):
            impulses = now.impulse_of_torques - before.impulse_of_torques
            if impulses.any():
                self._delivered_torques.append((now.stamp, impulses))

    def add_tilt(self, tilt: float, received: int) -> None:
        """Store that the chain has a tilt [rad] from the time `received` [ns] on."""
        self._tilts.append((received, tilt))

    def readings(self, gravity: Gravity = NO_GRAVITY) -> readings.Readings:
        """Return the record in the form that an identification needs.

        `gravity` contains the gravitational acceleration, and the tilt before the first stored
        tilt.
        """
        begin = next(iter(self._angles), 0)
        unknown = np.full(len(self.joint_names), np.nan)
        deviations = [self._deviations.get(stamp, unknown) for stamp in self._angles]
        whole = readings.Readings(
            np.array([(stamp - begin) / SECOND for stamp in self._angles], dtype=np.float64),
            np.array(list(self._angles.values())),
            np.array(deviations) if self._deviations else None,
            self.joint_names,
            [
                readings.RecordedImpulse((stamp - begin) / SECOND, each)
                for stamp, each in self._impulses
            ],
            gravity,
            [readings.RecordedTilt((stamp - begin) / SECOND, tilt) for stamp, tilt in self._tilts],
        )
        return readings.divided(whole, [(stamp - begin) / SECOND for stamp in self._resets])

    def _read(self, joints: JointStates) -> Array:
        reader = self._reader or FrameReader(joints.name)
        values = reader.read(joints).angles
        self._reader, self.joint_names = reader, reader.joint_names
        return values

    def _add_impulses(self, kept: _Impulses, stamp: int, message: RotorImpulses) -> None:
        named = dict(zip(message.name, message.impulse, strict=True))
        impulses = np.array([named.get(name, 0.0) for name in self.joint_names])
        if impulses.any():
            kept.append((stamp, impulses))

    @property
    def _impulses(self) -> list[tuple[int, Array | None]]:
        torques = self._commanded_torques
        if self._delivered is not None:
            torques = self._delivered_torques
        elif self._delivered_impulses:
            torques = _no_impulses()
        return [*(self._delivered_impulses or self._commanded_impulses), *torques]

    def _keep_most_informative(self) -> None:
        stamps = np.array(list(self._angles))
        impulses = [(stamp - stamps[0]) / SECOND for stamp, _ in self._impulses]
        times, angles = (stamps - stamps[0]) / SECOND, np.array(list(self._angles.values()))
        kept = readings.informative_frames(times, angles, impulses, self._most // 2)
        self._angles = {stamp: self._angles[stamp] for stamp in stamps[kept].tolist()}
        self._drop_unmatched_deviations()

    def _drop_unmatched_deviations(self) -> None:
        recent = set(list(self._deviations)[-_MOST_UNMATCHED:])
        self._deviations = {
            stamp: values
            for stamp, values in self._deviations.items()
            if stamp in self._angles or stamp in recent
        }
