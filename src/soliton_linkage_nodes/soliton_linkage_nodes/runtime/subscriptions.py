# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that adapt their quality of service to the publishers and count lost messages."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial, wraps
from typing import Any

import rclpy
from rclpy.event_handler import QoSSubscriptionEventType, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Increments
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.interfaces import Topic, node_of
from soliton_linkage_nodes.runtime.sequences import Counts, Lag, SequenceGaps, StreamArbitration

LONGEST_LAG = 0.5
"""Default of the limit `longest_lag` of a `StreamSubscription` [s]."""
_POLL_PERIOD = 0.5
"""Time between two checks for new publishers [s]."""
_NAMELESS = '_NODE_NAME_UNKNOWN_'
"""Name of a node in the ROS graph until its process has announced the real name."""
_PUBLISHERS_CHANGE = (
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
)

Info = Mapping[str, Any]
"""Information about a message from the middleware, such as its source time."""


def _ignore(_message: Any) -> None:
    pass


def _with_info(take: Callable[[Any, Info], None]) -> Callable[..., None]:
    @wraps(take)
    def take_both(*given: Any) -> None:
        take(*(given[0] if len(given) == 1 else given))

    return take_both


class AdaptiveSubscription:
    """Subscription whose quality of service is compatible with every publisher of a topic.

    When a publisher with an incompatible quality of service appears, `adapt` replaces the
    subscription. Messages that wait in the old subscription are then lost, unless the argument
    `before` of `adapt` takes them first.
    """

    def __init__(
        self, node: Node, topic: Topic, take: Callable[..., None] = _ignore, raw: bool = False
    ) -> None:
        """Subscribe to a topic.

        With `take`, `waiting` still takes the messages that the executor has not taken yet.
        Without `take`, messages wait until `waiting` or `newest` takes them. The node must then
        not be added to an executor, because an executor would drop these messages.
        """
        self.topic = topic
        self.sequence: int | None = None
        """Sequence number of the last message that `newest` returned."""
        self._node, self._take, self._raw = node, take, raw
        self._type_name = '/'.join([*topic.type.__module__.split('.')[:2], topic.type.__name__])
        self.publishers = self._query_publishers()
        """Publishers of this topic with the right type, from the last query of the graph."""
        self.qos = self._qos_for_all()
        self.subscription: Subscription = self._subscribe()

    @property
    def connected(self) -> int:
        """Number of publishers that the middleware has connected with this subscription."""
        return int(self.subscription.get_publisher_count())

    @property
    def as_requested(self) -> bool:
        """Whether the subscription has the reliability and the durability of `topic`.

        They differ if the publishers require another quality of service.
        """
        return _same_offer(self.qos, self.topic.qos)

    @property
    def changed(self) -> bool:
        """Whether publishers have appeared or disappeared since this property was last read.

        Only subscriptions of a GuardedNode detect this. For other nodes, the value is False.
        """
        changed = False
        for event in self._events:
            with event:
                status = event.take_event()
            changed |= bool(status.total_count_change)
            changed |= bool(getattr(status, 'current_count_change', 0))
        return changed

    def waiting(self) -> Iterator[tuple[Any, Info]]:
        """Yield each waiting message with the information about it, the oldest first."""
        handle = self.subscription.handle
        with handle:
            while (taken := handle.take_message(self.topic.type, self._raw)) is not None:
                yield taken

    def newest(self) -> Any:
        """Take one waiting message and return it, or return None if no message waits.

        It is the oldest one in the queue. At queue depth 1, the queue contains only the newest
        message.
        """
        message, info = next(self.waiting(), (None, None))
        if info is not None:
            self.sequence = info['publication_sequence_number']
        return message

    def adapt(self, before: Callable[[], object] = lambda: None) -> bool:
        """Subscribe again if the publishers require it, and return whether this was necessary.

        `before` is called before the old subscription ends.
        """
        self.publishers = self._query_publishers()
        qos = self._qos_for_all() if self.publishers else self.qos
        if _same_offer(qos, self.qos):
            return False
        before()
        self.qos = qos
        self.resubscribe()
        return True

    def resubscribe(self) -> None:
        """Subscribe again, so that the latched messages arrive once more."""
        self.close()
        self.subscription = self._subscribe()

    def close(self) -> None:
        """End the subscription."""
        self._node.destroy_subscription(self.subscription)

    def _query_publishers(self) -> list[Any]:
        publishers = self._node.get_publishers_info_by_topic(self.topic.name)
        return [each for each in publishers if each.topic_type == self._type_name]

    def _qos_for_all(self) -> QoSProfile:
        if not self.publishers:
            return self.topic.qos
        offered = [publisher.qos_profile for publisher in self.publishers]
        return qos_for_all(offered, self.topic.qos.depth)

    def _subscribe(self) -> Subscription:
        subscription: Subscription = self._node.create_subscription(
            self.topic.type,
            self.topic.name,
            self._take,
            self.qos,
            raw=self._raw,
            # The default callbacks of rclpy would warn of an incompatible quality of service.
            # `adapt` handles this case.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._events: list[Any] = []
        if isinstance(self._node, GuardedNode):
            handle = subscription.handle
            with handle:
                self._events = [
                    rclpy_implementation.EventHandle(handle, kind) for kind in _PUBLISHERS_CHANGE
                ]
            # Destroy the event handles first, because they would keep the subscription alive.
            self._node.before_destroying(subscription, self._end_events)
        return subscription

    def _end_events(self) -> None:
        events, self._events = self._events, []
        for event in events:
            event.destroy_when_not_in_use()


def qos_for_all(profiles: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return a quality of service that can receive from all publishers with these profiles."""
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _same_offer(one: QoSProfile, other: QoSProfile) -> bool:
    return (one.reliability, one.durability) == (other.reliability, other.durability)


def create_inbox(owner: Node) -> Node:
    """Create a node without an executor, for subscriptions whose messages `owner` takes itself."""
    return rclpy.create_node(
        f'_{owner.get_name()}_inbox',
        namespace=owner.get_namespace(),
        context=owner.context,
        enable_rosout=False,
        start_parameter_services=False,
    )


def subscribe_newest(
    node: Node, topic: Topic, name: str, raw: bool = False, depth: int = 1
) -> AdaptiveSubscription:
    """Subscribe a display to the newest `depth` messages of a topic with the full name `name`."""
    offer = topic.qos
    qos = QoSProfile(depth=depth, reliability=offer.reliability, durability=offer.durability)
    return AdaptiveSubscription(node, replace(topic, name=name, qos=qos), raw=raw)


class StreamSubscription:
    """Subscription of a node to a stream that may have several publishers.

    Publishers that send different parts of the stream, such as different joints, are all used. If
    several publishers send the same parts, the first one is used until it becomes silent.
    Diagnostics state the number of publishers and of lost messages. `longest_lag` [s] is both a
    limit and a duration. With 0.5 s, the node skips all waiting messages except the newest if the
    lag behind a publisher has stayed at or above 0.5 s for more than 0.5 s.
    """

    def __init__(
        self,
        node: GuardedNode,
        topic: Topic,
        take: Callable[[Any], None],
        diagnostics: Diagnostics,
        raw: bool = False,
        longest_lag: float = LONGEST_LAG,
        on_takeover: Callable[[], None] = lambda: None,
        *,
        latest: bool = False,
        parts: Callable[[Any], Collection[str]] | None = None,
        assemble: Callable[[Any], list[Any]] = lambda message: [message],
    ) -> None:
        """Subscribe to a topic; `take` gets each message, or its CDR bytes if `raw`.

        With `latest`, only the newest waiting message is passed to `take`. `on_takeover` is called
        when another publisher replaces a silent one. `parts` returns the names of the parts in a
        message, such as joint names. `assemble` collects messages that contain only some parts,
        and returns the complete messages, each of which is passed to `take`.
        """
        self.skipped = 0
        """Number of received messages that were skipped because of a lag or `latest`."""
        self.dispatched = True
        self.received_at = 0
        self._node = node
        self._topic = topic
        self._parts = parts
        self._assemble = assemble
        self._full_name = node.resolve_topic_name(topic.name)
        self._take = take
        self._on_takeover = on_takeover
        self._latest = latest
        self._lag = Lag(longest_lag)
        self._counts = Counts()
        self._arbitration = StreamArbitration(self._counts)
        self._adaptive = AdaptiveSubscription(node, topic, _with_info(self._take_with_info), raw)
        self._publishers: list[str] = []
        self._unsettled = True
        self._increments = Increments()
        node.create_timer(_POLL_PERIOD, self._poll)
        diagnostics.monitors.append(self._watch)

    def resubscribe(self) -> None:
        """Subscribe again, so that the latched messages arrive once more."""
        self._arbitration = StreamArbitration(self._counts)
        self._adaptive.resubscribe()
        self._restore_dispatch()

    def dispatch(self, dispatched: bool) -> None:
        """Set whether the executor takes messages; if not, the node must call `take_waiting`."""
        if dispatched is not self.dispatched:
            self.dispatched = dispatched
            self._node.dispatch(self._adaptive.subscription, dispatched)

    def take_waiting(self) -> list[Any]:
        """Take all waiting messages; return those of the used publishers, the oldest first.

        Partial messages are assembled. The messages are not passed to the callback `take`, and
        none is skipped because of `longest_lag` or `latest`.
        """
        kept = [each for each, info in self._adaptive.waiting() if self._keeps(each, info)]
        return [whole for each in kept for whole in self._assemble(each)]

    def _take_with_info(self, message: Any, info: Info) -> None:
        if not self._keeps(message, info):
            return
        messages = self._assemble(message)
        late = not self._topic.latched and self._lag.too_long(info['source_timestamp'])
        if late or self._latest:
            messages = [*messages, *self.take_waiting()]
            self.skipped += max(len(messages) - 1, 0)
            messages = messages[-1:]
        for each in messages:
            self._take(each)

    def _keeps(self, message: Any, info: Info) -> bool:
        number = info['publication_sequence_number']
        if number is not None:
            successions = self._counts.successions
            count = self._adaptive.subscription.get_publisher_count
            parts = None if self._parts is None else partial(self._parts, message)
            if not self._arbitration.take(number, info['source_timestamp'], count, parts):
                return False
            if self._counts.successions != successions:
                self._on_takeover()
        self.received_at = info['received_timestamp']
        return True

    def _poll(self) -> None:
        if not (self._adaptive.changed or self._unsettled):
            return
        if self._adaptive.adapt():
            self._restore_dispatch()
            qos = self._adaptive.qos
            self._node.get_logger().info(
                f'subscribed to {self._full_name} as {qos.reliability.name.lower()} and '
                f'{qos.durability.name.lower()}, because a publisher offers no more'
            )
        names = sorted(map(node_of, self._adaptive.publishers))
        before, self._publishers = self._publishers, names
        received = len(names) == self._adaptive.connected
        self._unsettled = not (received and self._adaptive.as_requested) or any(
            _NAMELESS in name for name in names
        )
        if self._several and len(before) < 2:
            self._node.get_logger().warning(self._warning())
        elif len(names) < len(before) and self._topic.latched and self._counts.foreign:
            self.resubscribe()

    @property
    def _several(self) -> bool:
        shared = self._parts is not None and not self._counts.foreign
        return len(self._publishers) > 1 and not shared

    def _restore_dispatch(self) -> None:
        if not self.dispatched:
            self._node.dispatch(self._adaptive.subscription, False)

    def _watch(self) -> tuple[str, Mapping[str, Any]]:
        name = self._topic.name
        _, lost, skipped = self._increments.take(self._counts.lost, self.skipped)
        figures = {
            f'publishers of {name}': len(self._publishers),
            f'{name} of others': self._counts.foreign,
            f'lost {name}': self._counts.lost,
            f'skipped {name}': self.skipped,
        }
        concerns = [self._warning()] if self._several else []
        # If the queue depth is 1 or `latest` is set, older messages are dropped on purpose.
        lost = lost if self._topic.qos.depth > 1 else 0
        skipped = 0 if self._latest else skipped
        if lost or skipped:
            loss = (
                f'{lost} messages of {self._full_name} were lost and {skipped} skipped, because '
                'this node was stopped or too slow'
            )
            self._node.get_logger().warning(loss)
            concerns.append(loss)
        return '; '.join(concerns), figures

    def _warning(self) -> str:
        return (
            f'{len(self._publishers)} nodes publish {self._full_name}: '
            f'{", ".join(self._publishers)}; only messages of the first one received are used; '
            'stop the others'
        )


class CountedSubscription:
    """Subscription to commands from any publisher. Diagnostics state how many were lost."""

    def __init__(
        self,
        node: Node,
        topic: Topic,
        take: Callable[[Any], None],
        diagnostics: Diagnostics,
        raw: bool = False,
    ) -> None:
        self._gaps = SequenceGaps()
        self._take = take
        self._topic, self._raw = topic, raw
        self._increments = Increments()
        self._subscription = node.create_subscription(
            topic.type, topic.name, _with_info(self._take_with_info), topic.qos, raw=raw
        )
        diagnostics.monitors.append(self._watch)

    def take_waiting(self) -> None:
        """Take all waiting messages from the queue and pass them to `take`."""
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(self._topic.type, self._raw)) is not None:
                self._take_with_info(*taken)

    def _take_with_info(self, message: Any, info: Info) -> None:
        number = info['publication_sequence_number']
        if number is not None:
            self._gaps.take(number, self._subscription.get_publisher_count())
        self._take(message)

    def _watch(self) -> tuple[str, Mapping[str, Any]]:
        _, lost = self._increments.take(self._gaps.lost)
        concern = (
            f'{lost} messages of {self._subscription.topic_name} were lost, because this node '
            'was stopped or too slow'
        )
        return concern if lost else '', {f'lost {self._topic.name}': self._gaps.lost}
