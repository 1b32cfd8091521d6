# SPDX-License-Identifier: Apache-2.0
"""The newest message of a topic, for who shows it and does not need each."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import Topic


class Newest:
    """The newest message of a topic, which is taken when somebody wants to see it.

    Its node is spun by no executor: calling back for each of a thousand messages a second, of
    which sixty are shown, would cost ten times as much.
    """

    def __init__(self, node: Node, topic: Topic, name: str, raw: bool = False) -> None:
        """Subscribe to a full name; what is offered as best effort is taken as that."""
        self.sequence: int | None = None
        """Number of the message that was taken last, among those of its publisher."""
        self._node, self._topic, self._name, self._raw = node, topic, name, raw
        self._depth = topic.qos.depth if topic is interfaces.DIAGNOSTICS else 1
        self._reliability = self._offered()
        self._subscription = self._subscribe()

    def take(self) -> Any:
        """The message that came since the last time, None where none did."""
        handle = self._subscription.handle
        with handle:
            taken = handle.take_message(self._topic.type, self._raw)
        if taken is None:
            return None
        message, info = taken
        self.sequence = info['publication_sequence_number']
        return message

    def adapt(self) -> int:
        """Hear all publishers, whatever they offer, and return how many there are."""
        offered = self._offered()
        if offered != self._reliability:
            self._reliability = offered
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe()
        return self._publishers

    def close(self) -> None:
        """Subscribe no longer."""
        self._node.destroy_subscription(self._subscription)

    def _offered(self) -> ReliabilityPolicy:
        offers = [i.qos_profile for i in self._node.get_publishers_info_by_topic(self._name)]
        self._publishers = len(offers)
        best_effort = any(o.reliability == ReliabilityPolicy.BEST_EFFORT for o in offers)
        return ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE

    def _subscribe(self) -> Subscription:
        qos = QoSProfile(
            depth=self._depth,
            reliability=self._reliability,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if self._topic.latched
            else DurabilityPolicy.VOLATILE,
        )
        return self._node.create_subscription(
            self._topic.type, self._name, _ignore, qos, raw=self._raw
        )


def _ignore(_message: Any) -> None:
    pass
