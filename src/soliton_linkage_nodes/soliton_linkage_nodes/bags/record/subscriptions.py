# SPDX-License-Identifier: Apache-2.0
"""Subscriptions of the recorder, and the buffer for pauses and snapshots."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile

from soliton_linkage_nodes.bags.reading import message_class, type_name
from soliton_linkage_nodes.bags.record.writing_thread import ReceivedMessage, RecordedTopic
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.interfaces import SUITE_TOPICS, Topic
from soliton_linkage_nodes.runtime.sequences import MissedStarts, SequenceGaps
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_nodes.runtime.subscriptions import AdaptiveSubscription, Info, qos_for_all

_DEPTH = 5000
"""Queue depth of a subscription [messages], sufficient for 5 s at 1000 Hz."""
_STREAM_PERIOD = SECOND
"""`ReceivingThread.settle` waits for the next message of a topic only if both of the last two
messages were sent within this time before the call [ns]."""


class RecordedSubscription:
    """Subscription of the recorder to a topic."""

    def __init__(
        self, node: GuardedNode, source: RecordedTopic, message_type: Any, wanted_since: int
    ) -> None:
        """Subscribe to `source`.

        `wanted_since` is the start of the recorder [ns]. Messages that were sent after this time
        and before the subscription was connected count as missed, except on latched topics.
        """
        self.source = source
        self.gaps = SequenceGaps()
        self.starts = MissedStarts()
        self._wanted_since = wanted_since
        self._began = time.time_ns()
        topic = Topic(source.name, message_type, qos_for_all(source.profiles, _DEPTH))
        self._subscription = AdaptiveSubscription(node, topic, raw=True)
        self.publishers = 0
        self.connected = 0
        self._sent = self._sent_before = 0

    def drain(self) -> list[ReceivedMessage]:
        """Return the waiting messages.

        Of the latched messages from before the subscription, only the last one is returned.
        """
        taken: list[ReceivedMessage] = []
        is_history = False
        for serialized, info in self._subscription.waiting():
            if not taken:
                self.connected = self._subscription.connected
            self._sent_before, self._sent = self._sent, info['source_timestamp']
            number = info['publication_sequence_number']
            if number is not None:
                self._count(number, info)
            if is_history:
                taken.pop()
            taken.append(ReceivedMessage(self.source, info['received_timestamp'], serialized))
            is_history = self.source.latched and info['source_timestamp'] < self._began
        return taken

    def _count(self, number: int, info: Info) -> None:
        sent = info['source_timestamp']
        if not self.gaps.take(number, self.connected):
            self.starts.take(number, sent)
        elif not self.source.latched:
            self.starts.add(number, sent, info['received_timestamp'] - self._wanted_since)

    def may_lack(self, until: int) -> bool:
        """Return whether the last two messages were both sent within 1 s before `until` [ns].

        In this case, another message from before `until` may still be in transport.
        """
        return self._sent < until < self._sent_before + _STREAM_PERIOD

    @property
    def changed(self) -> bool:
        """Whether publishers have appeared or disappeared since the last call."""
        return self._subscription.changed

    def adapt(self, query: bool) -> list[ReceivedMessage]:
        """Subscribe again if the publishers require another QoS.

        Return the messages in the queue of the old subscription. Unless `query` is set, the ROS
        graph is queried only if the publishers may have changed.
        """
        unsettled = not self._subscription.as_requested or self.connected != self.publishers
        if not (self._subscription.changed or unsettled or query):
            return []
        taken: list[ReceivedMessage] = []
        if self._subscription.adapt(before=lambda: taken.extend(self.drain())):
            self._began = time.time_ns()
        self.publishers = len(self._subscription.publishers)
        self.connected = self._subscription.connected
        return taken


class TopicFinder:
    """Finder of the topics to record. It subscribes to a topic as soon as the type is known."""

    def __init__(self, node: GuardedNode, names: Sequence[str], regex: str, exclude: str) -> None:
        self._node = node
        self._regex = _compiled('regex', regex)
        self._exclude = _compiled('exclude_regex', exclude)
        known = {topic.name.lstrip('/'): topic for topic in SUITE_TOPICS}
        stripped = [name.lstrip('/') for name in names]
        self._suite = [topic for name, topic in known.items() if not names or name in stripped]
        others = [name for name in names if name.lstrip('/') not in known]
        self.awaited = {_resolved(node, name) for name in others}
        self.rejected: dict[str, str] = {}
        self._began = time.time_ns()
        self._open: set[str] = set()
        self._searched: set[str] = set()

    def of_suite(self) -> list[RecordedSubscription]:
        """Subscribe to the selected topics of this software, even if they have no publisher."""
        named = {self._node.resolve_topic_name(topic.name): topic for topic in self._suite}
        chosen = {name: topic for name, topic in named.items() if self._wanted(name)}
        self._open.update(chosen)
        sources = [
            (RecordedTopic(name, type_name(each.type), (each.qos,), each.latched), each.type)
            for name, each in chosen.items()
        ]
        return [
            RecordedSubscription(self._node, source, kind, self._began) for source, kind in sources
        ]

    @property
    def appeared(self) -> bool:
        """Whether `find` may find new topics."""
        new = self._regex is not None and self._searched != {
            name for name, _ in self._node.get_topic_names_and_types()
        }
        return new or any(map(self._node.count_publishers, self.awaited))

    def find(self) -> list[RecordedSubscription]:
        """Subscribe to the selected topics that have appeared since the last call."""
        found: list[RecordedSubscription] = []
        if not (self.awaited or self._regex):
            return found
        topics = self._node.get_topic_names_and_types()
        self._searched = {name for name, _ in topics}
        for name, types in topics:
            chosen = name in self.awaited or (self._regex and self._regex.search(name))
            if not chosen or not self._wanted(name) or name.endswith('/_action/feedback'):
                continue
            publishers = self._node.get_publishers_info_by_topic(name)
            if publishers:
                found += self._subscribe(name, types[0], [p.qos_profile for p in publishers])
        return found

    def _wanted(self, name: str) -> bool:
        excluded = self._exclude is not None and self._exclude.search(name)
        return name not in self._open and name not in self.rejected and not excluded

    def _subscribe(
        self, name: str, type_: str, profiles: Sequence[QoSProfile]
    ) -> list[RecordedSubscription]:
        try:
            message_type = message_class(type_)
        except ValueError as error:
            self.rejected[name] = str(error)
            return []
        self._open.add(name)
        self.awaited.discard(name)
        latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
        source = RecordedTopic(name, type_, tuple(profiles), latched)
        return [RecordedSubscription(self._node, source, message_type, self._began)]


def _resolved(node: GuardedNode, name: str) -> str:
    try:
        full_name: str = node.resolve_topic_name(name)
    except rclpy_implementation.RCLError as error:
        raise ValueError(
            f'parameter topics of bag_recorder: {name!r} is not a valid topic name: '
            f'{str(error).partition(", at ")[0]}; correct it'
        ) from error
    return full_name


def _compiled(parameter: str, pattern: str) -> re.Pattern[str] | None:
    try:
        return re.compile(pattern) if pattern else None
    except re.error as error:
        raise ValueError(
            f'parameter {parameter} of bag_recorder = {pattern!r} is not a regular expression: '
            f'{error}; correct it'
        ) from error


_MOST_KEPT = 512 * 2**20
"""Largest total size of the messages of a snapshot [B]."""


class RecordingBuffer:
    """Buffer for the messages of a snapshot and for the last message of each latched topic."""

    def __init__(
        self, snapshot: float = 0.0, paused: bool = False, most_kept: int = _MOST_KEPT
    ) -> None:
        """Store messages of the last `snapshot` [s]. At 0, `take` returns each message at once."""
        self.paused = paused
        self._most_kept = most_kept
        self._window = round(snapshot * SECOND)
        self._latched: dict[str, ReceivedMessage] = {}
        self._kept: deque[ReceivedMessage] = deque()
        self._newest = 0
        self._bytes = 0

    @property
    def held(self) -> int:
        """Number of messages in the buffer."""
        return len(self._kept) + len(self._latched)

    def take(self, messages: Iterable[ReceivedMessage]) -> list[ReceivedMessage]:
        """Add messages, and return the messages that must be recorded now."""
        if self.paused:
            self._keep_latched(messages)
            return []
        if not self._window:
            return list(messages)
        for message in messages:
            self._kept.append(message)
            self._newest = max(self._newest, message.stamp)
            self._bytes += len(message.serialized)
        while self._kept and (self._is_old(self._kept[0]) or self._bytes > self._most_kept):
            old = self._kept.popleft()
            self._bytes -= len(old.serialized)
            self._keep_latched([old])
        return []

    def resume(self) -> list[ReceivedMessage]:
        """End a pause, and return the last message of the pause on each latched topic."""
        self.paused = False
        return [] if self._window else self._take_latched()

    def snapshot(self) -> list[ReceivedMessage]:
        """Empty the buffer, and return the messages of the last `snapshot` seconds.

        The result also includes the last earlier message on each latched topic, unless a previous
        call has returned it.
        """
        # On a busy machine, messages of different topics may not arrive in order of time.
        recent = [message for message in self._kept if not self._is_old(message)]
        self._keep_latched(filter(self._is_old, self._kept))
        self._kept.clear()
        self._bytes = 0
        return [*self._take_latched(), *recent]

    def _keep_latched(self, messages: Iterable[ReceivedMessage]) -> None:
        self._latched.update((m.source.name, m) for m in messages if m.source.latched)

    def _take_latched(self) -> list[ReceivedMessage]:
        latched = sorted(self._latched.values(), key=lambda message: message.stamp)
        self._latched.clear()
        return latched

    def _is_old(self, message: ReceivedMessage) -> bool:
        return self._newest - message.stamp > self._window
