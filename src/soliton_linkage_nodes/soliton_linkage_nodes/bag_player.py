# SPDX-License-Identifier: Apache-2.0
"""The bag player: what a bag holds, on the same topics and at the same pace."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from soliton_linkage.progress import ProgressLine
from soliton_linkage.quantities import quantity
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.bags import (
    find_topic,
    latched,
    message_class,
    open_bag,
    read_messages,
)
from soliton_linkage_nodes.conversions import time_to_msg
from soliton_linkage_nodes.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.matching import wait_for_subscriber
from soliton_linkage_nodes.parameters import declare, refuse_unknown
from soliton_linkage_nodes.process import run

_POLL_INTERVAL = 0.02
_LONGEST_DELIVERY = 10.0


@dataclass(frozen=True)
class BagPlayerParameters:
    """Parameters of the player."""

    bag: str = quantity('', 'path of the bag to play')
    rate: float = quantity(1.0, 'how much faster than recorded', '', 1e-3, 1e3)
    topics: tuple[str, ...] = quantity((), 'topics to play; empty for all in the bag')
    subscriber_timeout: float = quantity(
        5.0, 'how long to wait for a subscriber of joint_states before the start', 's', 0.0, 3600.0
    )
    publish_clock: bool = quantity(False, 'whether to publish the recorded time on /clock')


class BagPlayer(Node):
    """Publishes the messages of a bag as they are, paced by the times they were received at.

    Latched topics come first, and nothing is published before joint_states has a subscriber,
    or `subscriber_timeout` is over. Publishes the topics of the bag, `/diagnostics` and, if
    asked to, `/clock`. Parameters: those of `BagPlayerParameters`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Look into the bag and begin to play."""
        super().__init__('bag_player', **kwargs)
        self.settings = declare(self, BagPlayerParameters)
        refuse_unknown(self)
        if not self.settings.bag:
            raise ValueError("parameter bag of bag_player = '' must be the path of a bag")
        self._path = Path(self.settings.bag)
        self.finished = False
        self.failure: Exception | None = None
        self._played = 0
        with open_bag(self._path) as reader:
            connections = _chosen(reader, self.settings.topics)
            self._total = sum(connection.msgcount for connection in connections)
            self._outlets = {c.topic: self._create_publisher(c) for c in connections}
        self._clock_publisher = None
        if self.settings.publish_clock:
            topic = interfaces.CLOCK
            self._clock_publisher = self.create_publisher(topic.type, topic.name, topic.qos)
        self._diagnostics = Diagnostics(self, 'playing', self._report)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def destroy_node(self) -> None:
        """Stop playing."""
        self._stopping.set()
        self._thread.join()
        super().destroy_node()

    def _create_publisher(self, connection: Connection) -> Publisher:
        qos = interfaces.latched_qos() if latched(connection) else interfaces.stream_qos()
        return self.create_publisher(message_class(connection.msgtype), connection.topic, qos)

    def _run(self) -> None:
        try:
            with open_bag(self._path) as reader:
                self._play(reader)
            self._wait_for_delivery()
        except Exception as error:
            self.failure = error
        self.finished = True

    def _play(self, reader: Reader) -> None:
        connections = _chosen(reader, self.settings.topics)
        first_latched = {}
        for connection in filter(latched, connections):
            for _, stamp, serialized in read_messages(reader, [connection]):
                first_latched[connection.topic] = stamp
                self._publish(connection, serialized)
                break
        self._wait_for_subscriber(find_topic(reader, 'joint_states').topic)
        progress = ProgressLine(f'playing {self._path}', self._total)
        start, first = None, 0
        for connection, stamp, serialized in read_messages(reader, connections):
            if first_latched.pop(connection.topic, None) is not None:
                continue
            if start is None:
                start, first = time.monotonic(), stamp
            due = start + (stamp - first) * 1e-9 / self.settings.rate
            if self._stopping.wait(max(0.0, due - time.monotonic())):
                break
            if self._clock_publisher is not None:
                self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
            self._publish(connection, serialized)
            progress.show(self._played)
        progress.end(f'played {self._played} of {self._total} messages of {self._path}')

    def _publish(self, connection: Connection, serialized: bytes) -> None:
        self._outlets[connection.topic].publish(serialized)
        self._played += 1

    def _wait_for_subscriber(self, topic: str) -> None:
        if topic not in self._outlets:
            return
        limit = self.settings.subscriber_timeout
        heard = wait_for_subscriber(self._outlets[topic], limit, self._stopping)
        if not heard and not self._stopping.is_set():
            self.get_logger().warning(
                f'nothing subscribes to {topic} after {limit:g} s; playing to nobody'
            )

    def _wait_for_delivery(self) -> None:
        """Stay until every subscriber has what was published."""
        deadline = time.monotonic() + _LONGEST_DELIVERY
        for publisher in self._outlets.values():
            while time.monotonic() < deadline and not self._stopping.is_set():
                if publisher.wait_for_all_acked(Duration(seconds=_POLL_INTERVAL)):
                    break

    def _report(self) -> Report:
        return Report(
            f'{self._played} of {self._total} messages played',
            {
                'bag': self._path,
                'rate': self.settings.rate,
                'messages played': self._played,
                'messages': self._total,
            },
        )


def _chosen(reader: Reader, names: tuple[str, ...]) -> list[Connection]:
    """Return the topics to play; raises ValueError where the bag lacks one, or joint_states."""
    find_topic(reader, 'joint_states')
    if not names:
        return list(reader.connections)
    return list({c.topic: c for c in (find_topic(reader, name) for name in names)}.values())


def _finished(player: BagPlayer) -> bool:
    if player.failure is not None:
        raise player.failure
    return player.finished


def main() -> None:
    """Run the player until the bag is played or it is told to stop."""
    run(BagPlayer, _finished)
