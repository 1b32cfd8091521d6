# SPDX-License-Identifier: Apache-2.0
"""Subscriptions to commands, which anybody may publish, with a count of what never came."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.node import Node

from soliton_linkage_nodes.runtime.diagnostics import Diagnostics
from soliton_linkage_nodes.runtime.intake.informed import Info, Informed
from soliton_linkage_nodes.runtime.intake.sequence_gaps import SequenceGaps
from soliton_linkage_nodes.runtime.interfaces import Topic


class CountedSubscription:
    """Takes each message of a topic, of any publisher, and tells in reports what was lost."""

    def __init__(
        self,
        node: Node,
        topic: Topic,
        take: Callable[[Any], None],
        diagnostics: Diagnostics,
        raw: bool = False,
    ) -> None:
        """Have a node take each message, or its CDR bytes where it is `raw`."""
        self._gaps = SequenceGaps()
        self._take = take
        self._type, self._raw = topic.type, raw
        self._lost_before = 0
        self._name = topic.name
        self._subscription = node.create_subscription(
            topic.type, topic.name, Informed(self._take_informed), topic.qos, raw=raw
        )
        diagnostics.watches.append(self._watch)

    def take_what_waits(self) -> None:
        """Take now what came and was not yet taken."""
        handle = self._subscription.handle
        with handle:
            while (taken := handle.take_message(self._type, self._raw)) is not None:
                self._take_informed(*taken)

    def _take_informed(self, message: Any, info: Info) -> None:
        number = info['publication_sequence_number']
        if number is not None:
            self._gaps.take(number, self._subscription.get_publisher_count())
        self._take(message)

    def _watch(self) -> tuple[str, Mapping[str, Any]]:
        lost, self._lost_before = self._gaps.lost - self._lost_before, self._gaps.lost
        concern = (
            f'{lost} messages of {self._subscription.topic_name} were lost, as this node was '
            'stopped or too slow'
        )
        return concern if lost else '', {f'lost {self._name}': self._gaps.lost}
