# SPDX-License-Identifier: Apache-2.0
"""Whether publishers of a topic came or went, as the middleware tells a subscription."""

from __future__ import annotations

from rclpy.event_handler import QoSSubscriptionEventType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime.intake.guarded import GuardedNode

_KINDS = (
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
)


class PublisherChanges:
    """Counts of publishers that a subscription can hear and cannot, taken as they change.

    To ask the graph for the publishers of a topic takes a hundred times as long, and the longer
    the more nodes there are.
    """

    def __init__(self, node: GuardedNode, subscription: Subscription) -> None:
        """Begin with those that are there; it ends with the subscription, of a node."""
        handle = subscription.handle
        with handle:
            self._events = [rclpy_implementation.EventHandle(handle, kind) for kind in _KINDS]
        # They would keep the subscription alive.
        node.end_before(subscription, self._end)

    def take(self) -> bool:
        """Whether one came or went since this was asked last.

        Of those that cannot be heard only the coming is told.
        """
        changed = False
        for event in self._events:
            with event:
                status = event.take_event()
            changed |= bool(
                status.total_count_change or getattr(status, 'current_count_change', 0)
            )
        return changed

    def _end(self) -> None:
        events, self._events = self._events, []
        for event in events:
            event.destroy_when_not_in_use()
