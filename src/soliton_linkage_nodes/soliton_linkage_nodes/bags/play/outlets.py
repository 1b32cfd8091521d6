# SPDX-License-Identifier: Apache-2.0
"""The topics on which the messages of a bag leave."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import Connection

from soliton_linkage_nodes.bags.play.lockstep import Lockstep
from soliton_linkage_nodes.bags.read.reading import decoder, is_older, latched_depth, message_class
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import wait_for_subscriber

_POLL_INTERVAL = Duration(seconds=0.02)
"""How soon it stops waiting when it is told to."""
_MOST_TOPICS = 1000
"""That are played at a time: each is a publisher, which takes a millisecond and 100 kB."""
_LONGEST_DELIVERY = 10.0
"""How long a subscriber may take for the last messages before it is taken to be gone [s]."""


class ReplayOutlets:
    """Publishes messages as they are, or, where their definition has changed, as it is now.

    Waiting for subscribers ends when `stopping` is set.
    """

    def __init__(
        self, node: Node, connections: Sequence[Connection], stopping: threading.Event
    ) -> None:
        """Create a publisher of each topic; say of which types nothing is installed."""
        if len(connections) > _MOST_TOPICS:
            raise ValueError(
                f'the bag has {len(connections)} topics, and at most {_MOST_TOPICS} are played; '
                'name some in parameter topics'
            )
        self.published = 0
        self.left_out = 0
        self._node = node
        self._stopping = stopping
        self._lockstep: Lockstep | None = None
        self._states: dict[str, RecordedStates] = {}
        self._decoders: dict[str, Callable[[bytes], Any]] = {}
        self._publishers: dict[str, Publisher] = {}
        self._counts = {connection.topic: connection.msgcount for connection in connections}
        for connection in connections:
            try:
                self._open(connection)
            except ValueError as error:
                node.get_logger().warning(f'{connection.topic} is not played: {error}')

    @property
    def total(self) -> int:
        """Messages that the bag holds of the topics that are published."""
        return sum(self._counts[topic] for topic in self._publishers)

    def keep_step(self, lockstep: Lockstep) -> None:
        """Publish no frame before the analyser has answered those before, nor its states."""
        self._publishers.pop(lockstep.states, None)
        self._lockstep = lockstep

    def give_way(self, states: RecordedStates) -> None:
        """Leave recorded states out while an analyser publishes its own."""
        self._states[states.topic] = states

    def begin(self) -> None:
        """Count from nothing, and expect no answer to what was played before."""
        self.published = 0
        self.left_out = 0
        if self._lockstep is not None:
            self._lockstep.forget()

    def of(self, connections: Iterable[Connection]) -> list[Connection]:
        """Those of some topics that are published."""
        return [c for c in connections if c.topic in self._publishers]

    def leave_out(self, connection: Connection) -> bool:
        """Whether a message is of recorded states that give way to an analyser."""
        states = self._states.get(connection.topic)
        left_out = states is not None and states.give_way()
        self.left_out += left_out
        return left_out

    def publish(self, connection: Connection, serialized: bytes) -> None:
        """Publish a message, in lockstep as soon as its turn has come."""
        topic = connection.topic
        if topic in self._decoders:
            serialized = serialize_message(self._decoders[topic](serialized))
        if self._lockstep is not None:
            self._lockstep.wait_for_turn(topic, serialized, self._stopping.is_set)
        self._publishers[topic].publish(serialized)
        if self._lockstep is not None and topic != self._lockstep.frames:
            self._wait_until_acknowledged([self._publishers[topic]])
        self.published += 1

    def wait_for_subscribers(self, topics: Iterable[str], limit: float) -> None:
        """Wait for subscribers of topics and for the analyser, each for a time [s].

        Raises ValueError where it is to keep step and there is no analyser.
        """
        for topic in topics:
            if topic not in self._publishers or self._stopping.is_set():
                continue
            heard = wait_for_subscriber(self._publishers[topic], limit, self._stopping)
            if not heard and not self._stopping.is_set():
                self._node.get_logger().warning(
                    f'nothing subscribes to {topic} after {limit:g} s; playing to nobody'
                )
        if self._lockstep is not None:
            self._lockstep.wait_for_the_analyser(limit, self._stopping)

    def deliver(self) -> None:
        """Stay until every subscriber has what was published, and the analyser its last frame."""
        self._wait_until_acknowledged(self._publishers.values())
        if self._lockstep is not None:
            self._lockstep.settle(self._stopping.is_set)

    def _open(self, connection: Connection) -> None:
        message_type = message_class(connection.msgtype)
        if is_older(connection):
            self._decoders[connection.topic] = decoder(connection)
        qos = interfaces.stream_qos()
        if kept := latched_depth(connection):
            qos = interfaces.latched_qos(min(kept, qos.depth))
        publisher = self._node.create_publisher(message_type, connection.topic, qos)
        self._publishers[connection.topic] = publisher

    def _wait_until_acknowledged(self, publishers: Collection[Publisher]) -> None:
        deadline = time.monotonic() + _LONGEST_DELIVERY
        for publisher in publishers:
            while time.monotonic() < deadline and not self._stopping.is_set():
                if publisher.wait_for_all_acked(_POLL_INTERVAL):
                    break


_LOOK_INTERVAL = 0.25
"""How often the graph is asked for an analyser, which takes a millisecond [s]."""


class RecordedStates:
    """Whether recorded soliton states, or events, are played: two sources on one topic would mix.

    An analyser is another node that hears `joint_states` and publishes their topic beside it.
    """

    def __init__(self, node: Node, topic: str, chosen: bool) -> None:
        """Watch the topic; where it was chosen by name its messages are played all the same."""
        self.topic = topic
        self._node = node
        self._states = node.resolve_topic_name(topic)
        frames = f'{topic.rpartition("/")[0]}/{interfaces.JOINT_STATES.name}'
        self._frames = node.resolve_topic_name(frames)
        self._chosen = chosen
        self._analyser = ''
        self._looked_at = -_LOOK_INTERVAL

    def give_way(self) -> bool:
        """Whether the message that is due is to be left out; says so when that changes."""
        now = time.monotonic()
        if now - self._looked_at >= _LOOK_INTERVAL:
            self._looked_at = now
            analyser = self._find_analyser()
            if analyser != self._analyser:
                self._analyser = analyser
                self._say()
        return bool(self._analyser) and not self._chosen

    def _find_analyser(self) -> str:
        node = self._node
        heard = {_name(each) for each in node.get_subscriptions_info_by_topic(self._frames)}
        said = {_name(each) for each in node.get_publishers_info_by_topic(self._states)}
        return min(heard & said - {node.get_fully_qualified_name()}, default='')

    def _say(self) -> None:
        log, name = self._node.get_logger(), self.topic.rpartition('/')[2]
        if not self._analyser:
            log.info(f'no analyser is left: the recorded {self._states} is played again')
        elif self._chosen:
            log.warning(
                f'{self._analyser} publishes {self._states}, too, and the two mix; '
                f'stop it, or leave {name} out of topics'
            )
        else:
            log.info(
                f'{self._analyser} publishes {self._states}: what was recorded is left out; '
                f'name {name} in topics to have both'
            )


def _name(endpoint: TopicEndpointInfo) -> str:
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
