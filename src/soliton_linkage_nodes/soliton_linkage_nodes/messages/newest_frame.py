# SPDX-License-Identifier: Apache-2.0
"""Newest frame of joint states, for displays."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.node import Node

from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.conversions import JointStates
from soliton_linkage_nodes.messages.frame_assembler import FrameAssembler
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.subscriptions import subscribe_newest

_DEPTH = 200
"""Queue depth if a frame consists of several messages [messages]: 0.2 s at 1000 Hz."""
_LONGEST_ASSEMBLY = 0.3
"""After this time without messages [s], `take` returns an incomplete frame."""


class NewestFrame:
    """Subscription of a display to the newest frame.

    Its node must not be added to an executor. The queue holds one message. If a message lacks some
    joints of the chain, the queue is enlarged to 200 messages, from which frames are assembled.
    """

    def __init__(self, node: Node, name: str) -> None:
        self.number: int | None = None
        """Consecutive number of the newest frame, or None if unknown."""
        self._node, self._name = node, name
        self._decoder = JointStateDecoder()
        self._assembler = FrameAssembler()
        self._joints: frozenset[str] = frozenset()
        self._divided = False
        self._taken_at = 0.0
        self._subscription = subscribe_newest(node, interfaces.JOINT_STATES, name, raw=True)

    @property
    def publishers(self) -> int:
        """Number of publishers at the last call of `adapt`."""
        return len(self._subscription.publishers)

    def set_joints(self, joint_names: Sequence[str]) -> None:
        """Assemble frames of these joints from now on."""
        self._joints = frozenset(joint_names)
        self._assembler = FrameAssembler(joint_names)

    def take(self) -> JointStates | None:
        """Return the newest frame, None if it was returned before; ValueError if it is damaged."""
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
