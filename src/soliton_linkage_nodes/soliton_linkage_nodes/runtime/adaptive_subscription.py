# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that hear every publisher, whatever quality of service it offers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from soliton_linkage_nodes.runtime.interfaces import Topic

_LOOK_PERIOD = 0.5
"""Between two looks at who publishes [s]: a look costs 30 us, and a person waits no longer."""


def heard_by_all(profiles: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Quality of service of a depth in which every publisher can be heard."""
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def same_offer(one: QoSProfile, other: QoSProfile) -> bool:
    """Whether publishers that one profile hears are heard in the other as well."""
    return (one.reliability, one.durability) == (other.reliability, other.durability)


class AdaptiveSubscription:
    """Subscribes anew where publishers of a topic offer less than was asked for, or more again.

    What is published meanwhile is lost. Says once where several publish, whose messages mix.
    """

    def __init__(
        self, node: Node, topic: Topic, take: Callable[[Any], None], raw: bool = False
    ) -> None:
        """Have a node take each message of a topic, or its CDR bytes where it is `raw`."""
        self._node = node
        self._topic = topic
        self._take = take
        self._raw = raw
        self._qos = topic.qos
        self._subscription = self._subscribe()
        self._several = False
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK_PERIOD, self._look, clock=steady)

    def _look(self) -> None:
        offered = self._node.get_publishers_info_by_topic(self._topic.name)
        if not offered:
            return
        qos = heard_by_all([info.qos_profile for info in offered], self._topic.qos.depth)
        if not same_offer(qos, self._qos):
            self._node.destroy_subscription(self._subscription)
            self._qos = qos
            self._subscription = self._subscribe()
            self._node.get_logger().info(
                f'{self._subscription.topic_name} is offered {qos.reliability.name.lower()} and '
                f'{qos.durability.name.lower()}, and so subscribed to'
            )
        if len(offered) > 1 and not self._several:
            self._several = True
            self._node.get_logger().warning(self._warning(offered))

    def _warning(self, offered: Sequence[TopicEndpointInfo]) -> str:
        names = sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in offered)
        return (
            f'{len(offered)} publishers of {self._subscription.topic_name}, whose messages mix: '
            f'{", ".join(names)}; stop all but one'
        )

    def _subscribe(self) -> Subscription:
        return self._node.create_subscription(
            self._topic.type,
            self._topic.name,
            self._take,
            self._qos,
            raw=self._raw,
            # Those of rclpy warn of what is offered, which is being seen to.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
