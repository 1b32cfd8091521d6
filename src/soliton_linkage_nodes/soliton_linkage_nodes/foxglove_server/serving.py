# SPDX-License-Identifier: Apache-2.0
"""Websocket server of the Foxglove SDK, and execution of the requests of its clients.

The SDK calls the methods `on_...` on its own threads. These methods only queue functions, which
the executor of the node calls.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.websocket import Capability, ChannelView, Client, ClientChannel, ServerListener
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.guards import load_json
from soliton_linkage_nodes.bags.reading import message_class
from soliton_linkage_nodes.bags.stored_topic import type_definition
from soliton_linkage_nodes.foxglove_server.services import OfferedServices, Queue, Reject
from soliton_linkage_nodes.messages.fields import built
from soliton_linkage_nodes.runtime.interfaces import Topic, command_qos
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription

_DEPTH = 1000
"""Queue depth of a subscription [messages], sufficient for 1 s at 1000 Hz."""


class OutgoingTopic:
    """Channel on which clients receive the messages and the type definition of a topic."""

    def __init__(self, node: Node, name: str, type_: str, context: Context) -> None:
        """Offer a topic to clients. Raises ValueError if the type is not installed."""
        self.name, self.type = name, type_
        self.sent = 0
        self._topic = Topic(name, message_class(type_), QoSProfile(depth=_DEPTH))
        definition, _ = type_definition(type_)
        schema = Schema(name=type_, encoding='ros2msg', data=definition.encode())
        self._channel = Channel(name, schema=schema, message_encoding='cdr', context=context)
        self._node = node
        self._subscription: AdaptiveSubscription | None = None

    @property
    def subscribed(self) -> bool:
        """Whether at least one client has subscribed to the topic."""
        return self._subscription is not None

    def poll(self, new_client: bool, adapt: bool) -> None:
        """Subscribe to the topic if a client has subscribed to the channel, else unsubscribe.

        If `new_client` is set, latched messages are requested again for the new client. If `adapt`
        is set, the quality of service is adapted to the publishers.
        """
        if not self._channel.has_sinks():
            self._unsubscribe()
            return
        if self._subscription is None:
            topic, send = self._topic, self._send
            self._subscription = AdaptiveSubscription(self._node, topic, send, raw=True)
        elif new_client or adapt:
            latched = self._subscription.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            if not self._subscription.adapt() and new_client and latched:
                self._subscription.resubscribe()

    def close(self) -> None:
        """Unsubscribe, and withdraw the topic."""
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
    """Channels for all topics of the ROS graph."""

    def __init__(self, node: Node, context: Context, reject: Callable[[str, str], None]) -> None:
        """Offer topics in `context`. Call `reject` for each topic of an unknown type."""
        self.topics: dict[str, OutgoingTopic] = {}
        self._sent_by_withdrawn = 0
        self._node, self._context, self._reject = node, context, reject
        self._rejected: dict[str, Sequence[str]] = {}

    @property
    def sent(self) -> int:
        """Total number of messages on all topics that were sent to clients."""
        return self._sent_by_withdrawn + sum(topic.sent for topic in self.topics.values())

    def search(self) -> None:
        """Offer new topics, and withdraw topics that have no publisher and no subscriber."""
        found: dict[str, list[str]] = dict(self._node.get_topic_names_and_types())
        for name, topic in list(self.topics.items()):
            if topic.type not in found.get(name, ()) or self._is_deserted(name):
                self._sent_by_withdrawn += topic.sent
                topic.close()
                del self.topics[name]
        for name, types in found.items():
            # Do not offer the hidden topics of actions.
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
        """Return whether a topic has neither a publisher nor a subscriber in another node."""
        own = name in self.topics and self.topics[name].subscribed
        others: Any = self._node.count_subscribers(name) - own
        return not (others or self._node.count_publishers(name))


_ENCODINGS = ('cdr', 'json')
"""Encodings in which clients may publish messages."""
Key = tuple[int, int]
"""Number of a client, and number of one of its channels."""


class IncomingTopic:
    """Topic on which the messages of a client are published."""

    def __init__(self, node: Node, topic: str, type_name: str, encoding: str) -> None:
        """Create the publisher. Raises ValueError if encoding, type or topic name is invalid."""
        if encoding not in _ENCODINGS:
            raise ValueError(f'encoding {encoding!r} must be one of {", ".join(_ENCODINGS)}')
        self.name = topic
        self._node, self._encoding = node, encoding
        package, _, name = type_name.replace('/msg/', '/').partition('/')
        self._type = message_class(f'{package}/msg/{name}')
        try:
            self._publisher: Publisher = node.create_publisher(self._type, topic, command_qos())
        except (InvalidTopicNameException, rclpy_implementation.RCLError) as error:
            reason = str(error).partition('\n')[0]
            raise ValueError(f'{type_name} cannot be published: {reason}') from error

    def publish(self, data: bytes) -> None:
        """Publish a message of a client. Raises ValueError if `data` is not a valid message."""
        if self._encoding == 'json':
            message: Any = built(self._type, load_json(data.decode(errors='replace')))
        else:
            try:
                message = deserialize_message(data, self._type)
            except Exception as error:  # the type of this error in rclpy has no public name
                raise ValueError(f'{len(data)} bytes are not a message of its type') from error
        self._publisher.publish(message)

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)


class Serving(ServerListener):
    """Server that connects its clients to the topics and services of the ROS graph."""

    def __init__(
        self, node: Node, address: tuple[str, int], read_only: bool, queue: Queue, reject: Reject
    ) -> None:
        """Start the server at an address (host and port). Raises OSError if it cannot start."""
        self.published = 0
        self._node, self._queue, self._reject = node, queue, reject
        self._incoming: dict[Key, IncomingTopic] = {}
        self._new_clients: set[str] = set()
        context = foxglove.Context()
        self.outgoing = OutgoingTopics(node, context, reject)
        host, port = address
        try:
            self._server = foxglove.start_server(
                name='soliton_linkage',
                host=host,
                port=port,
                capabilities=[] if read_only else [Capability.ClientPublish, Capability.Services],
                supported_encodings=list(_ENCODINGS),
                server_listener=self,
                context=context,
            )
        except Exception as error:  # the type of this error in the SDK has no public name
            reason = f'cannot serve at {host}:{port}: {error}; set another host or port'
            raise OSError(reason) from error
        self.port = self._server.port
        self.services = None if read_only else OfferedServices(node, self._server, queue, reject)

    def poll(self, searching: bool) -> None:
        """Execute client requests. If `searching` is set, also search for topics and services."""
        if searching:
            self.outgoing.search()
        if self.services is not None:
            if searching:
                self.services.search()
            self.services.poll()
        new_clients, self._new_clients = self._new_clients, set()
        for name, topic in self.outgoing.topics.items():
            topic.poll(name in new_clients, searching)

    def close(self) -> None:
        """Close all connections and stop the server."""
        if self.services is not None:
            self.services.close()
        self._server.stop()
        self.outgoing.close()

    def advertise(self, key: Key, topic: str, type_name: str, encoding: str) -> None:
        """Create the publisher for the channel of a client, or reject an invalid topic."""
        try:
            self._incoming[key] = IncomingTopic(self._node, topic, type_name, encoding)
        except ValueError as error:
            self._reject(topic, str(error))

    def unadvertise(self, key: Key) -> None:
        """Destroy the publisher for the channel of a client."""
        if key in self._incoming:
            self._incoming.pop(key).close()

    def publish(self, key: Key, data: bytes) -> None:
        """Publish a message of a client, or reject an invalid message."""
        topic = self._incoming.get(key)
        if topic is None:
            return
        try:
            topic.publish(data)
            self.published += 1
        except ValueError as error:
            self._reject(topic.name, str(error))

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Record that a new client has subscribed to a topic."""
        topic = channel.topic
        self._queue(lambda: self._new_clients.add(topic))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        """Call `advertise` on the thread of the executor."""
        key, topic = (client.id, channel.id), channel.topic
        type_name, encoding = channel.schema_name, channel.encoding
        self._queue(lambda: self.advertise(key, topic, type_name, encoding))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        """Call `unadvertise` on the thread of the executor."""
        self._queue(lambda: self.unadvertise((client.id, client_channel_id)))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        """Call `publish` on the thread of the executor."""
        self._queue(lambda: self.publish((client.id, client_channel_id), data))
