# SPDX-License-Identifier: Apache-2.0
"""Topics as a recorder hears them: raw messages with their sequence numbers, from deep queues."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile

from soliton_linkage_nodes.bags.read.reading import message_class, type_name
from soliton_linkage_nodes.bags.record.writing_thread import Source, Taken
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.interfaces import SUITE_TOPICS, Topic
from soliton_linkage_nodes.runtime.sequences import SequenceGaps
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, qos_for_all

_DEPTH = 5000
"""Messages that a queue holds while nobody takes them: five seconds of a topic at 1000 Hz."""


class Inlet:
    """Subscription to a topic that is recorded."""

    def __init__(self, node: GuardedNode, source: Source, message_type: Any) -> None:
        """Subscribe, in the quality of service that the source offers."""
        self.source = source
        self.gaps = SequenceGaps()
        self._began = time.time_ns()
        topic = Topic(source.name, message_type, qos_for_all(source.profiles, _DEPTH))
        self._subscription = AdaptiveSubscription(node, topic, raw=True)
        self.publishers = 0
        """Number of publishers when the graph was last asked."""
        self.connected = 0
        """Number of publishers that it received from at the last look."""

    def drain(self) -> list[Taken]:
        """Take all messages that are waiting, and of those from before its time the last alone."""
        taken: list[Taken] = []
        history = False
        for serialized, info in self._subscription.waiting():
            if not taken:
                self.connected = self._subscription.connected
            number = info['publication_sequence_number']
            if number is not None:
                self.gaps.take(number, self.connected)
            if history:
                taken.pop()
            taken.append(Taken(self.source, info['received_timestamp'], serialized))
            history = self.source.latched and info['source_timestamp'] < self._began
        return taken

    def adapt(self, ask: bool) -> list[Taken]:
        """Subscribe again if publishers offer less; return the messages that waited till then.

        The graph is asked who publishes if publishers came or went, one cannot be received from
        or offers less, and whenever the caller has it ask.
        """
        unsettled = not self._subscription.as_requested or self.connected != self.publishers
        if not (self._subscription.changed or unsettled or ask):
            return []
        taken: list[Taken] = []
        if self._subscription.adapt(before=lambda: taken.extend(self.drain())):
            self._began = time.time_ns()
        self.publishers = len(self._subscription.publishers)
        self.connected = self._subscription.connected
        return taken


class InletFinder:
    """Opens an inlet for every topic that is to be recorded, as soon as its type is known."""

    def __init__(self, node: GuardedNode, names: Sequence[str], regex: str, exclude: str) -> None:
        """Choose topics by name, or, with none, all of the suite, and others by a pattern."""
        self._node = node
        self._regex = _compiled('regex', regex)
        self._exclude = _compiled('exclude_regex', exclude)
        known = {topic.name.lstrip('/'): topic for topic in SUITE_TOPICS}
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
