# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph as channels, each subscribed to only for clients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from foxglove import Channel, Context, Schema
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from soliton_linkage_nodes.bags.read.reading import message_class
from soliton_linkage_nodes.bags.stored_topic import type_definition
from soliton_linkage_nodes.runtime.interfaces import Topic
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription

_DEPTH = 1000
"""Depth of the queue: a second of a topic at 1000 Hz."""


class OutgoingTopic:
    """A topic for clients: its serialized messages with the definition of their type."""

    def __init__(self, node: Node, name: str, type_: str, context: Context) -> None:
        """Offer it to clients; raise ValueError if its type is not installed."""
        self.name, self.type = name, type_
        self.sent = 0
        """Number of messages sent."""
        self._topic = Topic(name, message_class(type_), QoSProfile(depth=_DEPTH))
        definition, _ = type_definition(type_)
        schema = Schema(name=type_, encoding='ros2msg', data=definition.encode())
        self._channel = Channel(name, schema=schema, message_encoding='cdr', context=context)
        self._node = node
        self._subscription: AdaptiveSubscription | None = None

    @property
    def subscribed(self) -> bool:
        """Whether a client subscribes to it."""
        return self._subscription is not None

    def poll(self, renewed: bool, adapting: bool) -> None:
        """Subscribe or unsubscribe as clients do.

        `renewed` gets latched messages again for another client. `adapting` follows the quality
        of service of publishers.
        """
        if not self._channel.has_sinks():
            self._unsubscribe()
            return
        if self._subscription is None:
            self._subscription = AdaptiveSubscription(
                self._node, self._topic, self._send, raw=True
            )
        elif renewed or adapting:
            latched = self._subscription.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            if not self._subscription.adapt() and renewed and latched:
                self._subscription.resubscribe()

    def close(self) -> None:
        """Withdraw it."""
        self._unsubscribe()
        self._channel.close()

    def _send(self, serialized: bytes) -> None:
        self._channel.log(serialized)
        self.sent += 1

    def _unsubscribe(self) -> None:
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None


class OutgoingTopics:
    """All topics of the graph."""

    def __init__(self, node: Node, context: Context, complain: Callable[[str, str], None]) -> None:
        """Offer them in a context; report a rejected topic and the reason to `complain`."""
        self.topics: dict[str, OutgoingTopic] = {}
        self.sent_before = 0
        self._node, self._context, self._complain = node, context, complain
        self._refused: dict[str, Sequence[str]] = {}

    @property
    def sent(self) -> int:
        """Number of messages sent."""
        return self.sent_before + sum(topic.sent for topic in self.topics.values())

    def search(self) -> None:
        """Offer new topics and withdraw those that are gone."""
        found: dict[str, list[str]] = dict(self._node.get_topic_names_and_types())
        for name, topic in list(self.topics.items()):
            if topic.type not in found.get(name, ()) or self._is_deserted(name):
                self.sent_before += topic.sent
                topic.close()
                del self.topics[name]
        for name, types in found.items():
            # Hidden topics of actions are not offered.
            if '/_' in name or name in self.topics or self._refused.get(name) == types:
                continue
            if self._is_deserted(name):
                continue
            try:
                self.topics[name] = OutgoingTopic(self._node, name, types[0], self._context)
            except ValueError as error:
                self._refused[name] = types
                self._complain(name, str(error))

    def close(self) -> None:
        """Withdraw all topics."""
        for topic in self.topics.values():
            topic.close()
        self.topics.clear()

    def _is_deserted(self, name: str) -> bool:
        """Return whether no other node publishes or subscribes to a topic."""
        own = name in self.topics and self.topics[name].subscribed
        others: Any = self._node.count_subscribers(name) - own
        return not (others or self._node.count_publishers(name))
