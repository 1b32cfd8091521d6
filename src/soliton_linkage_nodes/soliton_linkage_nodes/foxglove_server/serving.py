# SPDX-License-Identifier: Apache-2.0
"""The websocket server, and what its clients ask for.

Its calls come on threads of its own: all they do is to queue what the node's executor then does.
"""

from __future__ import annotations

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ClientChannel, ServerListener
from rclpy.node import Node

from soliton_linkage_nodes.foxglove_server.incoming import ENCODINGS, Advertisement, IncomingTopic
from soliton_linkage_nodes.foxglove_server.outgoing import OutgoingTopics
from soliton_linkage_nodes.foxglove_server.services import Ask, CalledServices, Complain


class Serving:
    """Clients, and the topics and services between them and the graph."""

    def __init__(
        self,
        node: Node,
        address: tuple[str, int],
        read_only: bool,
        ask: Ask,
        refuse: Complain,
    ) -> None:
        """Listen at a host and port; raises OSError where that is not possible."""
        self.published = 0
        """How many messages clients have published."""
        self._node, self._refuse = node, refuse
        self._incoming: dict[tuple[int, int], IncomingTopic] = {}
        self._renewed: set[str] = set()
        context = foxglove.Context()
        self.outgoing = OutgoingTopics(node, context, refuse)
        host, port = address
        try:
            self._server = foxglove.start_server(
                name='soliton_linkage',
                host=host,
                port=port,
                capabilities=[] if read_only else [Capability.ClientPublish, Capability.Services],
                supported_encodings=list(ENCODINGS),
                server_listener=_Listener(self, ask),
                context=context,
            )
        except Exception as error:  # the SDK's own has no public name
            raise OSError(
                f'cannot serve at {host}:{port}: {error}; give another host or port'
            ) from error
        self.port = self._server.port
        self.services = None if read_only else CalledServices(node, self._server, ask, refuse)

    def look(self, searching: bool) -> None:
        """Follow what clients look at, and what is new on the graph where it is searched."""
        if searching:
            self.outgoing.search()
        if self.services is not None:
            if searching:
                self.services.search()
            self.services.look()
        renewed, self._renewed = self._renewed, set()
        self.outgoing.look(renewed, adapting=searching)

    def close(self) -> None:
        """End all connections."""
        if self.services is not None:
            self.services.close()
        self._server.stop()
        self.outgoing.close()

    def renew(self, topic: str) -> None:
        """Another client looks at a topic."""
        self._renewed.add(topic)

    def advertise(self, key: tuple[int, int], advertised: Advertisement) -> None:
        """A client is about to publish."""
        try:
            self._incoming[key] = IncomingTopic(self._node, advertised)
        except ValueError as error:
            self._refuse(advertised.topic, str(error))

    def unadvertise(self, key: tuple[int, int]) -> None:
        """A client publishes no longer."""
        if key in self._incoming:
            self._incoming.pop(key).close()

    def publish(self, key: tuple[int, int], data: bytes) -> None:
        """A client publishes."""
        topic = self._incoming.get(key)
        if topic is None:
            return
        try:
            topic.publish(data)
            self.published += 1
        except ValueError as error:
            self._refuse(topic.name, str(error))


class _Listener(ServerListener):
    """What the SDK calls."""

    def __init__(self, serving: Serving, ask: Ask) -> None:
        self._serving, self._ask = serving, ask

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        topic = channel.topic
        self._ask(lambda: self._serving.renew(topic))

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        key = (client.id, channel.id)
        advertised = Advertisement(channel.topic, channel.schema_name, channel.encoding)
        self._ask(lambda: self._serving.advertise(key, advertised))

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        key = (client.id, client_channel_id)
        self._ask(lambda: self._serving.unadvertise(key))

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        key = (client.id, client_channel_id)
        self._ask(lambda: self._serving.publish(key, data))
