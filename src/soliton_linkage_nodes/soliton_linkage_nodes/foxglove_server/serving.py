# SPDX-License-Identifier: Apache-2.0
"""Websocket server of the Foxglove SDK, and the requests of its clients.

The SDK calls back on its own threads, which only queue work for the node's executor.
"""

from __future__ import annotations

from typing import Any

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ClientChannel, ServerListener
from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.guards import load_json
from soliton_linkage_nodes.bags.reading import message_class
from soliton_linkage_nodes.foxglove_server.outgoing import OutgoingTopics
from soliton_linkage_nodes.foxglove_server.services import OfferedServices, Queue, Reject
from soliton_linkage_nodes.messages.fields import built
from soliton_linkage_nodes.runtime.interfaces import command_qos

_ENCODINGS = ('cdr', 'json')
"""Encodings of messages that clients publish."""
Key = tuple[int, int]
"""Numbers of a client and of its channel."""


class IncomingTopic:
    """A topic on which a client publishes."""

    def __init__(self, node: Node, topic: str, type_name: str, encoding: str) -> None:
        """Create the publisher; raise ValueError if that is not possible."""
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
        """Publish the data of a client; raise ValueError if it is not a message of the type."""
        if self._encoding == 'json':
            message: Any = built(self._type, load_json(data.decode(errors='replace')))
        else:
            try:
                message = deserialize_message(data, self._type)
            except Exception as error:  # the type of rclpy has no public name
                raise ValueError(f'{len(data)} bytes are not a message of its type') from error
        self._publisher.publish(message)

    def close(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)


class Serving:
    """Server that connects its clients to the topics and services of the graph."""

    def __init__(
        self,
        node: Node,
        address: tuple[str, int],
        read_only: bool,
        queue: Queue,
        reject: Reject,
    ) -> None:
        """Serve at a host and port; raise OSError if that is not possible."""
        self.published = 0
        """Number of messages published by clients."""
        self._node, self._reject = node, reject
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
                server_listener=_Listener(self, queue),
                context=context,
            )
        except Exception as error:  # the type of the SDK has no public name
            raise OSError(
                f'cannot serve at {host}:{port}: {error}; set another host or port'
            ) from error
        self.port = self._server.port
        self.services = None if read_only else OfferedServices(node, self._server, queue, reject)

    def poll(self, searching: bool) -> None:
        """Process subscriptions and calls of clients; with `searching` also read the graph."""
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
        """End all connections."""
        if self.services is not None:
            self.services.close()
        self._server.stop()
        self.outgoing.close()

    def note_subscription(self, topic: str) -> None:
        """Record that another client subscribed to a topic."""
        self._new_clients.add(topic)

    def advertise(self, key: Key, topic: str, type_name: str, encoding: str) -> None:
        """Create the publisher of a client's topic, or reject the topic."""
        try:
            self._incoming[key] = IncomingTopic(self._node, topic, type_name, encoding)
        except ValueError as error:
            self._reject(topic, str(error))

    def unadvertise(self, key: Key) -> None:
        """End a client's topic."""
        if key in self._incoming:
            self._incoming.pop(key).close()

    def publish(self, key: Key, data: bytes) -> None:
        """Publish or reject a client's message."""
        topic = self._incoming.get(key)
        if topic is None:
            return
        try:
            topic.publish(data)
            self.published += 1
        except ValueError as error:
            self._reject(topic.name, str(error))


class _Listener(ServerListener):
    """Callbacks of the SDK, queued for the executor."""

    def __init__(self, serving: Serving, queue: Queue) -> None:
        self._serving, self._queue = serving, queue

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        topic = channel.topic
        self._queue(lambda: self._serving.note_subscription(topic))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        key, topic = (client.id, channel.id), channel.topic
        type_name, encoding = channel.schema_name, channel.encoding
        self._queue(lambda: self._serving.advertise(key, topic, type_name, encoding))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        self._queue(lambda: self._serving.unadvertise((client.id, client_channel_id)))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        self._queue(lambda: self._serving.publish((client.id, client_channel_id), data))
