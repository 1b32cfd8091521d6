# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph as channels. The node subscribes to a topic only while a client does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from foxglove import Channel, Context, Schema
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from soliton_linkage_nodes.bags.reading import message_class
from soliton_linkage_nodes.bags.stored_topic import type_definition
from soliton_linkage_nodes.runtime.interfaces import Topic
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription

_DEPTH = 1000
"""Depth of the queue: one second at 1000 Hz."""


class OutgoingTopic:
    """Channel with the serialized messages of a topic and the definition of their type."""

    def __init__(self, node: Node, name: str, type_: str, context: Context) -> None:
        """Offer the topic; raise ValueError if its type is not installed."""
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
        """Whether a client subscribes to the topic."""
        return self._subscription is not None

    def poll(self, new_client: bool, adapt: bool) -> None:
        """Subscribe to the topic if a client does, otherwise end the subscription.

        `new_client` requests latched messages again. `adapt` adapts the quality of service to the
        offers of the publishers.
        """
        if not self._channel.has_sinks():
            self._unsubscribe()
            return
        if self._subscription is None:
            self._subscription = AdaptiveSubscription(
                self._node, self._topic, self._send, raw=True
            )
        elif new_client or adapt:
            latched = self._subscription.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            if not self._subscription.adapt() and new_client and latched:
                self._subscription.resubscribe()

    def close(self) -> None:
        """Withdraw the topic."""
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
    """Channels of all topics of the graph."""

    def __init__(self, node: Node, context: Context, reject: Callable[[str, str], None]) -> None:
        """Offer topics in a context; call `reject` with name and reason of each rejected topic."""
        self.topics: dict[str, OutgoingTopic] = {}
        self._sent_by_withdrawn = 0
        self._node, self._context, self._reject = node, context, reject
        self._rejected: dict[str, Sequence[str]] = {}

    @property
    def sent(self) -> int:
        """Number of messages sent."""
        return self._sent_by_withdrawn + sum(topic.sent for topic in self.topics.values())

    def search(self) -> None:
        """Offer new topics and withdraw topics without publishers and subscribers."""
        found: dict[str, list[str]] = dict(self._node.get_topic_names_and_types())
        for name, topic in list(self.topics.items()):
            if topic.type not in found.get(name, ()) or self._is_deserted(name):
                self._sent_by_withdrawn += topic.sent
                topic.close()
                del self.topics[name]
        for name, types in found.items():
            # Hidden topics of actions are not offered.
            hidden = '/_' in name or name in self.topics or self._rejected.get(name) == types
            if hidden or self._is_deserted(name):
                continue
            try:
                self.topics[name] = OutgoingTopic(self._node, name, types[0], self._context)
            except ValueError as error:
                self._rejected[name] = types
                self._reject(name, str(error))

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
