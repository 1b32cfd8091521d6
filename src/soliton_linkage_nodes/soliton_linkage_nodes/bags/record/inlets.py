# SPDX-License-Identifier: Apache-2.0
"""Topics as a recorder hears them: raw messages with their sequence numbers, from deep queues."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from soliton_linkage_nodes.bags.read.reading import message_class, type_name
from soliton_linkage_nodes.bags.record.writing_thread import Source, Taken
from soliton_linkage_nodes.runtime.adaptive_subscription import heard_by_all, same_offer
from soliton_linkage_nodes.runtime.intake.guarded import GuardedNode
from soliton_linkage_nodes.runtime.intake.publisher_changes import PublisherChanges
from soliton_linkage_nodes.runtime.intake.sequence_gaps import SequenceGaps
from soliton_linkage_nodes.runtime.interfaces import SUITE, Topic

_DEPTH = 5000
"""Messages that a queue holds while nobody takes them: five seconds of a topic at 1000 Hz."""


class Inlet:
    """A topic that is being recorded."""

    def __init__(self, node: GuardedNode, source: Source, message_type: Any) -> None:
        """Subscribe, in the quality of service that the source offers."""
        self.source = source
        self.gaps = SequenceGaps()
        self._node = node
        self._type = message_type
        self._qos = heard_by_all(source.profiles, _DEPTH)
        self._subscription = self._subscribe()
        self.publishers = 0
        """How many published when it last looked."""
        self.connected = 0
        """How many it heard when it last looked."""

    def drain(self) -> list[Taken]:
        """Take all messages that are waiting, and of those from before its time the last alone."""
        taken: list[Taken] = []
        history = False
        handle = self._subscription.handle
        with handle:
            while (message := handle.take_message(self._type, True)) is not None:
                if not taken:
                    self.connected = self._subscription.get_publisher_count()
                serialized, info = message
                number = info['publication_sequence_number']
                if number is not None:
                    self.gaps.take(number, self.connected)
                if history:
                    taken.pop()
                taken.append(Taken(self.source, info['received_timestamp'], serialized))
                history = self.source.latched and info['source_timestamp'] < self._began
        return taken

    def adapt(self, ask: bool) -> list[Taken]:
        """Subscribe anew where a publisher offers less; return what was waiting till then.

        The graph is asked who publishes where publishers came or went, one cannot be heard or
        offers less, and wherever the caller has it ask.
        """
        unsettled = self._offered_less or self.connected != self.publishers
        if not (self._changes.take() or unsettled or ask):
            return []
        told = self._node.get_publishers_info_by_topic(self.source.name)
        offered = [info for info in told if info.topic_type == self.source.type_name]
        self.publishers = len(offered)
        self.connected = self._subscription.get_publisher_count()
        profiles = [info.qos_profile for info in offered]
        qos = heard_by_all(profiles, _DEPTH) if offered else self._qos
        if same_offer(qos, self._qos):
            return []
        taken = self.drain()
        self._node.destroy_subscription(self._subscription)
        self._qos = qos
        self._subscription = self._subscribe()
        return taken

    def _subscribe(self) -> Subscription:
        self._began = time.time_ns()
        asked = heard_by_all(self.source.profiles, _DEPTH)
        self._offered_less = not same_offer(self._qos, asked)
        subscription: Subscription = self._node.create_subscription(
            self._type, self.source.name, _ignore, self._qos, raw=True
        )
        self._changes = PublisherChanges(self._node, subscription)
        return subscription


class InletFinder:
    """Opens an inlet for every topic that is to be recorded, as soon as its type is known."""

    def __init__(self, node: GuardedNode, names: Sequence[str], regex: str, exclude: str) -> None:
        """Choose topics by name, or, with none, all of the suite, and others by a pattern."""
        self._node = node
        self._regex = _compiled('regex', regex)
        self._exclude = _compiled('exclude_regex', exclude)
        known = {topic.name.lstrip('/'): topic for topic in SUITE}
        asked = [name.lstrip('/') for name in names]
        self._suite = [topic for name, topic in known.items() if not asked or name in asked]
        others = [name for name in names if name.lstrip('/') not in known]
        self.awaited = {_resolved(node, name) for name in others}
        self.refused: dict[str, str] = {}
        self._open: set[str] = set()

    def of_suite(self) -> list[Inlet]:
        """Inlets of the suite's topics, whose types are known before anybody publishes."""
        named = [(self._node.resolve_topic_name(topic.name), topic) for topic in self._suite]
        return [self._inlet_of_suite(name, topic) for name, topic in named if self._wanted(name)]

    def find(self) -> list[Inlet]:
        """Inlets of the topics that have appeared since."""
        found: list[Inlet] = []
        if not (self.awaited or self._regex):
            return found
        for name, types in self._node.get_topic_names_and_types():
            chosen = name in self.awaited or (self._regex and self._regex.search(name))
            if not chosen or not self._wanted(name):
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if publishers and not name.endswith('/_action/feedback'):
                found += self._inlet_of(name, types[0], [p.qos_profile for p in publishers])
        return found

    def _wanted(self, name: str) -> bool:
        excluded = self._exclude is not None and self._exclude.search(name)
        return name not in self._open and name not in self.refused and not excluded

    def _inlet_of_suite(self, name: str, topic: Topic) -> Inlet:
        self._open.add(name)
        source = Source(name, type_name(topic.type), (topic.qos,), topic.latched)
        return Inlet(self._node, source, topic.type)

    def _inlet_of(self, name: str, type_: str, profiles: Sequence[QoSProfile]) -> list[Inlet]:
        try:
            message_type = message_class(type_)
        except ValueError as error:
            self.refused[name] = str(error)
            return []
        self._open.add(name)
        self.awaited.discard(name)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        source = Source(name, type_, tuple(profiles), latched)
        return [Inlet(self._node, source, message_type)]


def _resolved(node: GuardedNode, name: str) -> str:
    try:
        full_name: str = node.resolve_topic_name(name)
    except rclpy_implementation.RCLError as error:
        raise ValueError(
            f'parameter topics of bag_recorder: {name!r} is no name of a topic: '
            f'{str(error).partition(", at ")[0]}; mend it'
        ) from error
    return full_name


def _compiled(parameter: str, pattern: str) -> re.Pattern[str] | None:
    try:
        return re.compile(pattern) if pattern else None
    except re.error as error:
        raise ValueError(
            f'parameter {parameter} of bag_recorder = {pattern!r} is no regular expression: '
            f'{error}; mend it'
        ) from error


def _ignore(_message: Any) -> None:
    pass
