# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that hear every publisher, whatever quality of service it offers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime.diagnostics import Diagnostics
from soliton_linkage_nodes.runtime.intake.guarded import GuardedNode
from soliton_linkage_nodes.runtime.intake.informed import Info, Informed
from soliton_linkage_nodes.runtime.intake.kept_stream import KeptStream
from soliton_linkage_nodes.runtime.intake.lag import Lag
from soliton_linkage_nodes.runtime.intake.publisher_changes import PublisherChanges
from soliton_linkage_nodes.runtime.interfaces import Topic

LONGEST_LAG = 0.5
"""How long a node may be behind before it skips what waits [s]: it is current in a second."""
_LOOK_PERIOD = 0.5
"""Between two looks at who publishes [s]: a person waits no longer."""
_NAMELESS = '_NODE_NAME_UNKNOWN_'
"""Of a node whose process has not told the names of its nodes yet."""


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

    What is published meanwhile is lost. Where several publish, the messages of the one that was
    heard first are taken, until it falls silent or is gone; that is said, and told in the reports
    of the node, as is what was lost. A node that has been behind for longer than `longest_lag` [s]
    skips what waits but the newest.
    """

    def __init__(
        self,
        node: GuardedNode,
        topic: Topic,
        take: Callable[[Any], None],
        diagnostics: Diagnostics,
        raw: bool = False,
        longest_lag: float = LONGEST_LAG,
        succeeded: Callable[[], None] = lambda: None,
        latest: bool = False,
    ) -> None:
        """Have a node take each message of a topic, or its CDR bytes where it is `raw`.

        With `latest` it takes the newest of those that wait, and is not told of the others.
        `succeeded` is called where another publisher has taken the place of the first.
        """
        self.skipped = 0
        """Messages that were passed over by a node that was behind."""
        self._node = node
        self._topic = topic
        self._take = take
        self._raw = raw
        self._succeeded = succeeded
        self._latest = latest
        self.attended = True
        """Whether each message is taken when it comes."""
        self._lag = Lag(longest_lag)
        self._qos = topic.qos
        self._kept = KeptStream()
        self._subscription = self._subscribe()
        self._publishers: list[str] = []
        self._unsettled = True
        self._lost_before = self._skipped_before = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK_PERIOD, self._look, clock=steady)
        diagnostics.watches.append(self._watch)

    def renew(self) -> None:
        """Hear again what publishers that are there have latched."""
        self._node.destroy_subscription(self._subscription)
        lost, foreign = self._kept.lost, self._kept.foreign
        self._kept = KeptStream()
        self._kept.lost, self._kept.foreign = lost, foreign
        self._subscription = self._subscribe()

    def attend(self, attended: bool) -> None:
        """Take each message when it comes, or leave them to `take_waiting`; of a GuardedNode."""
        if attended is not self.attended:
            self.attended = attended
            self._node.attend(self._subscription, attended)

    def take_waiting(self) -> list[Any]:
        """Messages that have come and wait, the oldest first."""
        messages = []
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(self._topic.type, self._raw)) is not None:
                if self._keeps(taken[1]):
                    messages.append(taken[0])
        return messages

    def _take_informed(self, message: Any, info: Info) -> None:
        if not self._keeps(info):
            return
        late = not self._topic.latched and self._lag.too_long(info['source_timestamp'])
        if late or self._latest:
            waiting = self.take_waiting()
            self.skipped += len(waiting)
            message = waiting[-1] if waiting else message
        self._take(message)

    def _keeps(self, info: Info) -> bool:
        number, successions = info['publication_sequence_number'], self._kept.successions
        count = self._subscription.get_publisher_count
        if number is None or self._kept.take(number, info['source_timestamp'], count):
            if self._kept.successions != successions:
                self._succeeded()
            return True
        return False

    def _look(self) -> None:
        """See who publishes, where that is not as it was or not settled."""
        if not (self._changes.take() or self._unsettled):
            return
        offered = self._node.get_publishers_info_by_topic(self._topic.name)
        if offered:
            self._adapt([info.qos_profile for info in offered])
        names = sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in offered)
        before, self._publishers = self._publishers, names
        heard = len(names) == self._subscription.get_publisher_count()
        as_asked = same_offer(self._qos, self._topic.qos)
        self._unsettled = not (heard and as_asked) or any(_NAMELESS in name for name in names)
        if len(names) > 1 and len(before) < 2:
            self._node.get_logger().warning(self._warning())
        elif len(names) < len(before) and self._topic.latched and self._kept.foreign:
            self.renew()

    def _adapt(self, offered: Sequence[QoSProfile]) -> None:
        qos = heard_by_all(offered, self._topic.qos.depth)
        if same_offer(qos, self._qos):
            return
        self._node.destroy_subscription(self._subscription)
        self._qos = qos
        self._subscription = self._subscribe()
        self._node.get_logger().info(
            f'{self._subscription.topic_name} is offered {qos.reliability.name.lower()} and '
            f'{qos.durability.name.lower()}, and so subscribed to'
        )

    def _watch(self) -> tuple[str, Mapping[str, Any]]:
        name = self._topic.name
        lost, self._lost_before = self._kept.lost - self._lost_before, self._kept.lost
        skipped, self._skipped_before = self.skipped - self._skipped_before, self.skipped
        figures = {
            f'publishers of {name}': len(self._publishers),
            f'{name} of others': self._kept.foreign,
            f'lost {name}': self._kept.lost,
            f'skipped {name}': self.skipped,
        }
        concerns = []
        if len(self._publishers) > 1:
            concerns.append(self._warning())
        # Of a queue of one message, and for who wants the newest, the others go on purpose.
        lost = lost if self._topic.qos.depth > 1 else 0
        skipped = 0 if self._latest else skipped
        if lost or skipped:
            loss = (
                f'{lost} messages of {self._subscription.topic_name} were lost and {skipped} '
                'skipped, as this node was stopped or too slow'
            )
            self._node.get_logger().warning(loss)
            concerns.append(loss)
        return '; '.join(concerns), figures

    def _warning(self) -> str:
        return (
            f'{len(self._publishers)} publishers of {self._subscription.topic_name}, of which '
            f'the one that was heard first is kept to: {", ".join(self._publishers)}; stop all '
            'but one'
        )

    def _subscribe(self) -> Subscription:
        subscription: Subscription = self._node.create_subscription(
            self._topic.type,
            self._topic.name,
            Informed(self._take_informed),
            self._qos,
            raw=self._raw,
            # Those of rclpy warn of what is offered, which is being seen to.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._changes = PublisherChanges(self._node, subscription)
        if not self.attended:
            self._node.attend(subscription, False)
        return subscription
