# SPDX-License-Identifier: Apache-2.0
"""Drawing of a chain in one line of the terminal: the lean of the rotors, and the solitons."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from soliton_linkage.linkage.chain import Array
from soliton_linkage.progress import ProgressLine, line_width
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.chain_source import with_joints
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_from_msg
from soliton_linkage_nodes.messages.frame_assembler import SerializedFrames
from soliton_linkage_nodes.messages.frame_reader import FrameReader
from soliton_linkage_nodes.runtime import interfaces

LEGEND = '/ leans right, \\ leans left, | is upright, ? is missing, O is a soliton'
_UPRIGHT = 1 / 3
"""A rotor is upright if its lean is below this fraction of the lean in the uniform state [1]."""
_DEPTH = 10
"""Queue depth of joint_states [messages], because a frame may consist of several messages."""
_FEWEST = 10
"""The line has room for at least this number of rotor marks, even beside a long remark [1]."""


class ChainLine:
    """Drawing of a chain from the topics `chain` and `joint_states`, with rotor 0 on the left."""

    def __init__(self, node: Node, joint_names: tuple[str, ...] = ()) -> None:
        """Subscribe to the topics; without `joint_names`, the names in `chain` are used."""
        self._joint_names = joint_names
        self._node = node
        self._line = ProgressLine('', 0)
        self._chain: tuple[NamedChain, FrameReader] | None = None
        self._decoder = JointStateDecoder()
        self._frames = SerializedFrames()
        self._serialized: bytes | None = None
        self.received_at = -math.inf
        self._explained = False
        latest = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        chain, joints = interfaces.CHAIN, interfaces.JOINT_STATES
        self._subscriptions = [
            node.create_subscription(chain.type, chain.name, self._on_chain, chain.qos),
            node.create_subscription(
                joints.type, joints.name, self._on_joint_states, latest, raw=True
            ),
        ]

    @property
    def missing(self) -> list[str]:
        """Names of the topics on which no message has arrived yet."""
        received = {
            interfaces.CHAIN.name: self._chain,
            interfaces.JOINT_STATES.name: self._serialized,
        }
        return [name for name, message in received.items() if message is None]

    @property
    def spacing(self) -> float:
        """Spacing of the rotors [m], or NaN if the chain is unknown."""
        return math.nan if self._chain is None else self._chain[0].chain.spacing

    def show(self, solitons: Sequence[float], remark: str) -> None:
        """Draw the chain, its solitons and a remark, unless the last drawing is too recent.

        `solitons` contains the site coordinates of the solitons [rotor spacings].
        """
        if not self._line.due:
            return
        if self._chain is None or self._serialized is None:
            self._line.show_text(remark)
            return
        (named, reader), count = self._chain, self._chain[0].rotors
        try:
            angles = reader.read(self._decoder.decode(self._serialized)).angles
        except ValueError as error:
            self._line.show_text(str(error))
            return
        room = max(line_width() - len(remark) - len('[]  '), _FEWEST)
        marks = drawn(np.sin(angles) / math.sin(named.chain.rest_angle), solitons, room)
        if not self._explained:
            self._explained = True
            each = f'; {count / len(marks):.3g} rotors per mark' if len(marks) < count else ''
            self._line.note(f'{count} rotors, rotor 0 first: {LEGEND}{each}')
        self._line.show_text(f'[{marks}]  {remark}')

    def end(self, remark: str = '') -> None:
        """Replace the drawing with a final text, and remove the subscriptions."""
        self._line.end(remark)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _on_chain(self, message: msg.Chain) -> None:
        try:
            self.use(chain_from_msg(message))
        except ValueError as error:
            self._line.note(f'rejected chain: {error}')

    def use(self, named: NamedChain) -> None:
        """Set the chain that is drawn; ValueError if given joint names do not fit the chain."""
        named = with_joints(named, self._joint_names)
        self._chain = (named, FrameReader(named.joint_names, named.encoder_offsets))
        self._frames.set_joints(named.joint_names)
        self._explained = False

    def _on_joint_states(self, serialized: Any) -> None:
        for frame in self._frames.add(serialized):
            self._serialized, self.received_at = frame, time.monotonic()


def drawn(leans: Array, solitons: Sequence[float], room: int) -> str:
    """Return a line of at most `room` marks, each for one rotor or several neighbouring rotors.

    `leans` are sin(angle) / sin(rest angle) of the rotors. `solitons` contains the site
    coordinates of the solitons [rotor spacings].
    """
    shares = np.array_split(leans, min(room, len(leans)))
    marks = [_mark(share) for share in shares]
    ends = np.cumsum([len(share) for share in shares])
    for rotor in solitons:
        marks[int(np.searchsorted(ends, np.clip(round(rotor), 0, len(leans) - 1), 'right'))] = 'O'
    return ''.join(marks)


def _mark(leans: Array) -> str:
    seen = leans[np.isfinite(leans)]
    if not len(seen):
        return '?'
    mean = float(np.mean(seen))
    return '|' if abs(mean) < _UPRIGHT else '/' if mean > 0 else '\\'
