# SPDX-License-Identifier: Apache-2.0
"""The soliton analyser: where the solitons are in each frame of joint states."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.soliton import find_solitons
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.chain_source import ChainSource
from soliton_linkage_nodes.conversions import NamedChain, frame_from_msg, solitons_to_msg
from soliton_linkage_nodes.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.parameters import refuse_unknown
from soliton_linkage_nodes.process import run


class SolitonAnalyser(Node):
    """Publishes the solitons of every frame of joint states, none as an empty list.

    Subscribes to `joint_states` and, unless told the chain by parameters, to `chain`.
    Publishes `soliton_state` and `/diagnostics`.
    Parameters: `chain_from`, and `chain.*` of `Chain` [SI].
    """

    def __init__(self, **kwargs: Any) -> None:
        """Listen to the chain and its joints."""
        super().__init__('soliton_analyser', **kwargs)
        self._waiting: deque[bytes] = deque()
        self._frames = 0
        self._solitons = 0
        self._reported = (time.monotonic(), 0)
        self._diagnostics = Diagnostics(self, 'analysis', self._report)
        topic = interfaces.SOLITON_STATE
        self._publisher = self.create_publisher(topic.type, topic.name, topic.qos)
        self._source = ChainSource(self, self._diagnostics, self._on_chain)
        refuse_unknown(self)
        topic = interfaces.JOINT_STATES
        self.create_subscription(
            topic.type, topic.name, self._on_joint_states, topic.qos, raw=True
        )

    def _on_chain(self, named: NamedChain) -> None:
        """Analyse the frames that came before the chain was known."""
        while self._waiting:
            self._analyse(named, self._waiting.popleft())

    def _on_joint_states(self, serialized: bytes) -> None:
        if self._source.named is None:
            self._waiting.append(serialized)
            if len(self._waiting) > interfaces.stream_qos(len(serialized)).depth:
                self._waiting.popleft()
        else:
            self._analyse(self._source.named, serialized)

    def _analyse(self, named: NamedChain, serialized: bytes) -> None:
        message = deserialize_message(serialized, JointState)
        try:
            frame = frame_from_msg(named, message)
        except ValueError as error:
            self._diagnostics.refuse('joint_states', error)
            return
        solitons = find_solitons(named.chain, frame.angles, frame.rates)
        self._publisher.publish(solitons_to_msg(named.chain, solitons, message.header))
        self._frames += 1
        self._solitons = len(solitons)

    def _report(self) -> Report:
        now = time.monotonic()
        before, frames_before = self._reported
        self._reported = (now, self._frames)
        rate = (self._frames - frames_before) / (now - before)
        known = self._source.named is not None
        message = (
            f'{self._solitons} solitons'
            if rate
            else 'waiting for joint_states'
            if known
            else 'waiting for the topic chain; where there is none, set chain_from to parameters'
        )
        values = {
            'rate [Hz]': rate,
            'frames': self._frames,
            'solitons': self._solitons,
            'subscribers': self._publisher.get_subscription_count(),
        }
        return Report(message, values, warning=not rate)


def main() -> None:
    """Run the analyser until it is told to stop."""
    run(SolitonAnalyser)
