# SPDX-License-Identifier: Apache-2.0
"""What clients publish, on its way to the graph."""

from __future__ import annotations

from typing import Any, NamedTuple

from rclpy.exceptions import InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.guards.texts import load_json
from soliton_linkage_nodes.bags.read.reading import message_class
from soliton_linkage_nodes.messages.fields import built
from soliton_linkage_nodes.runtime.interfaces import command_qos

ENCODINGS = ('cdr', 'json')
"""In which clients may write messages."""


class Advertisement(NamedTuple):
    """What a client is about to publish."""

    topic: str
    type: str
    encoding: str


class IncomingTopic:
    """A topic that a client publishes on."""

    def __init__(self, node: Node, advertised: Advertisement) -> None:
        """Publish on the topic; raises ValueError where it cannot be."""
        if advertised.encoding not in ENCODINGS:
            raise ValueError(
                f'encoding {advertised.encoding!r} must be one of {", ".join(ENCODINGS)}'
            )
        self.name = advertised.topic
        self._node, self._encoding = node, advertised.encoding
        package, _, name = advertised.type.replace('/msg/', '/').partition('/')
        self._type = message_class(f'{package}/msg/{name}')
        try:
            self._publisher: Publisher = node.create_publisher(
                self._type, advertised.topic, command_qos()
            )
        except (InvalidTopicNameException, rclpy_implementation.RCLError) as error:
            reason = str(error).partition('\n')[0]
            raise ValueError(f'{advertised.type} cannot be published: {reason}') from error

    def publish(self, data: bytes) -> None:
        """Publish what a client sends; raises ValueError for what is no message of the type."""
        if self._encoding == 'json':
            message: Any = built(self._type, load_json(data.decode(errors='replace')))
        else:
            try:
                message = deserialize_message(data, self._type)
            except Exception as error:  # rclpy's own has no public name
                raise ValueError(f'{len(data)} bytes are no message of its type') from error
        self._publisher.publish(message)

    def close(self) -> None:
        """Publish no longer."""
        self._node.destroy_publisher(self._publisher)
