# SPDX-License-Identifier: Apache-2.0
"""Show the chain in one line of the terminal, with the position of the soliton.

The chain comes from the topics chain and joint_states, the solitons from soliton_state. The line
ends with the position [rotor spacings] and the velocity [rotor spacings/s] of the soliton nearest
to rotor 0. If no node publishes chain, add --ros-args -p chain_from:=parameters, and specify the
parameters chain.* or a parameter file.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.chain import Array
from soliton_linkage.progress import ProgressLine, line_width
from soliton_linkage_msgs import msg
from soliton_linkage_nodes.messages.cdr import JointStateDecoder
from soliton_linkage_nodes.messages.chain_source import (
    ChainSourceParameters,
    declare_chain,
    with_joints,
)
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_from_msg
from soliton_linkage_nodes.messages.frames import FrameReader, SerializedFrames
from soliton_linkage_nodes.programs.command_line import parse_own_arguments
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.parameters import declare, reject_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.start import INTERRUPTED

LEGEND = '/ leans right, \\ leans left, | is upright, ? is missing, O is a soliton'
_UPRIGHT = 1 / 3
"""A rotor is drawn upright if |sin(angle) / sin(rest angle)| is below this [1]. If a mark shows
several rotors, the absolute value of their mean ratio counts."""
_DEPTH = 10
"""Queue depth of joint_states [messages]. It exceeds 1 because a frame may consist of several
messages."""
_FEWEST = 10
"""Smallest number of rotor marks in the line, even if the text after the marks is long [1]."""


class ChainLine:
    """Drawing of a chain in one line of a terminal, with rotor 0 on the left.

    The chain and its angles come from the topics `chain` and `joint_states`.
    """

    def __init__(self, node: Node, joint_names: tuple[str, ...] = ()) -> None:
        """Subscribe to the topics. If `joint_names` is empty, the names in `chain` are used."""
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
        """Draw the chain and its solitons at given sites [rotor spacings], followed by `remark`.

        The method does nothing if the last drawing was made less than 0.1 s ago, or less than 2 s
        ago if stderr is not a terminal.
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
        """Set the chain to draw; ValueError if `joint_names` of the constructor do not fit it."""
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


_PERIOD = 0.1
"""Time between two drawings [s]."""
_LONGEST_SILENCE = 1.0
"""A topic without messages for this time is reported as stopped [s]."""
_STARTED_BY = {
    interfaces.CHAIN.name: 'simulator',
    interfaces.JOINT_STATES.name: 'simulator',
    interfaces.SOLITON_STATE.name: 'soliton_analyser',
}


class WatchSoliton(Node):
    """Node that draws the chain and its solitons in one line of the terminal."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('watch_soliton', **kwargs)
        source, given = declare(self, ChainSourceParameters), declare_chain(self)
        self._line = ChainLine(self, source.joint_names)
        self._received: tuple[bytes, float] | None = None
        if source.chain_from == 'parameters':
            self._line.use(given)
        interfaces.SOLITON_STATE.subscribe(self, self._on_state, raw=True)
        reject_unknown(self)
        self.create_timer(_PERIOD, self._draw, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """End the line and destroy the node."""
        self._line.end()
        super().destroy_node()

    def _on_state(self, serialized: Any) -> None:
        self._received = (serialized, time.monotonic())

    def _draw(self) -> None:
        unseen = [] if self._received else [interfaces.SOLITON_STATE.name]
        missing = [*self._line.missing, *unseen]
        if missing or self._received is None:
            nodes = ', '.join(dict.fromkeys(_STARTED_BY[name] for name in missing))
            self._line.show((), f'no {", ".join(missing)} yet; start {nodes}')
            return
        serialized, received_at = self._received
        now = time.monotonic()
        for name, silence in (
            (interfaces.JOINT_STATES.name, now - self._line.received_at),
            (interfaces.SOLITON_STATE.name, now - received_at),
        ):
            if silence > _LONGEST_SILENCE:
                self._line.show((), f'no {name} for {silence:.0f} s')
                return
        state: msg.SolitonState = deserialize_message(serialized, msg.SolitonState)
        rotors = [soliton.rotor for soliton in state.solitons]
        remark = f'no soliton, {state.motion_name}'
        if state.solitons:
            speed = state.solitons[0].velocity / self._line.spacing
            remark = f'rotor {rotors[0]:6.2f}  {speed:+7.2f} rotors/s'
        self._line.show(rotors, remark)


def main() -> None:
    """Show the soliton until Ctrl-C."""
    parser = PlainParser(
        prog='watch_soliton', description=__doc__, epilog=f'Marks: {LEGEND}. Stop with Ctrl-C.'
    )
    parse_own_arguments(parser)
    try:
        run(WatchSoliton)
    except SystemExit as end:
        # Only a signal ends the program without an error.
        sys.exit(end.code or INTERRUPTED)
