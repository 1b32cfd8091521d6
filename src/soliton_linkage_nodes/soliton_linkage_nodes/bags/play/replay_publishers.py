# SPDX-License-Identifier: Apache-2.0
"""Publishers for the messages of a bag. They can wait for an analyser and omit recorded states."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Container, Iterable, Mapping
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher

from soliton_linkage_nodes.bags.reading import class_of, decoder, is_older
from soliton_linkage_nodes.bags.stored_topic import CDR, StoredTopic
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import node_of, wait_for_subscriber
from soliton_linkage_nodes.runtime.serialization import serialize
from soliton_linkage_nodes.runtime.stamps import stamp_of, time_to_msg

_ANSWER_POLL_INTERVAL = 0.05
"""Interval at which the player checks for a stop while it waits for the analyser [s]."""


class Lockstep:
    """Flow control of a replay. A frame waits until the analyser has answered earlier frames.

    A frame consists of all joint states with one stamp. A `soliton_state` counts as the answer to
    all frames up to its stamp, because the analyser does not answer frames that it rejects.
    """

    def __init__(self, node: Node, frames: str, window: int, limit: float) -> None:
        """Allow at most `window` unanswered frames. `frames` is the name of their topic.

        If no answer arrives for `limit` [s], the player no longer waits for the unanswered frames.
        `given_up` is the number of these frames.
        """
        self.given_up = 0
        self.frames = frames
        namespace = frames.rpartition('/')[0]
        self.states = f'{namespace}/{interfaces.SOLITON_STATE.name}'
        self.events = f'{namespace}/{interfaces.SOLITON_EVENTS.name}'
        self._window = window
        self._limit = limit
        self._changed = threading.Condition()
        self._unanswered: deque[int] = deque()
        self._sent: int | None = None
        self._subscription = node.create_subscription(
            interfaces.SOLITON_STATE.type,
            self.states,
            self._on_answer,
            interfaces.stream_qos(),
            raw=True,
        )

    def wait_for_the_analyser(self, limit: float, stopping: threading.Event) -> None:
        """Wait until `soliton_state` has a publisher, or until `stopping` is set.

        Raises ValueError if neither happens within `limit` [s].
        """
        deadline = time.monotonic() + limit
        while not self._subscription.get_publisher_count():
            if stopping.wait(_ANSWER_POLL_INTERVAL):
                return
            if time.monotonic() > deadline:
                raise ValueError(
                    f'nothing publishes {interfaces.SOLITON_STATE.name} after {limit:g} s; '
                    'start soliton_analyser, or set lockstep to false'
                )

    def wait_for_turn(self, topic: str, message: bytes, stopped: Callable[[], bool]) -> None:
        """Wait until a message may be published, or until `stopped()` returns true.

        A frame waits until fewer than `window` earlier frames are unanswered. Any other message
        waits until all frames are answered.
        """
        if topic != self.frames:
            self.settle(stopped)
            return
        stamp = stamp_of(message)
        if stamp == self._sent:
            return
        self.settle(stopped, self._window - 1)
        with self._changed:
            self._sent = stamp
            self._unanswered.append(stamp)

    def forget(self) -> None:
        """Forget all unanswered frames, before another playback starts."""
        with self._changed:
            self._unanswered.clear()
            self._sent = None

    def settle(self, stopped: Callable[[], bool], most: int = 0) -> None:
        """Wait until at most `most` frames are unanswered, or until `stopped()` returns true."""
        with self._changed:
            left, since = len(self._unanswered), time.monotonic()
            while len(self._unanswered) > most and not stopped():
                self._changed.wait(_ANSWER_POLL_INTERVAL)
                if len(self._unanswered) != left:
                    left, since = len(self._unanswered), time.monotonic()
                elif time.monotonic() - since > self._limit:
                    self.given_up += left
                    self._unanswered.clear()

    def _on_answer(self, state: bytes) -> None:
        stamp = stamp_of(state)
        with self._changed:
            if stamp in self._unanswered:
                while self._unanswered.popleft() != stamp:
                    pass
                self._changed.notify_all()


_POLL_INTERVAL = Duration(seconds=0.02)
"""Interval at which the player checks for a stop while it waits for acknowledgements."""
_MOST_REASONS = 3
"""Largest number of topics for which an error states why they cannot be played [1]."""
_MOST_TOPICS = 1000
"""Largest number of topics that are played [1]. A publisher takes 100 kB and 1 ms to create."""
_LONGEST_DELIVERY = 10.0
"""Longest wait for the acknowledgement of the messages by the subscribers [s]."""
_REJECTED = (ValueError, NameValidationException, rclpy_implementation.RCLError)


class ReplayPublishers:
    """Publishers for the messages of a bag. All waits end when `stopping` is set.

    A message that was recorded with another definition of its type is converted to the installed
    definition. If a topic has several types, only messages of one type are published: the first
    installed type in the order of the argument `counts`.
    """

    def __init__(
        self,
        node: Node,
        counts: Mapping[StoredTopic, int],
        stopping: threading.Event,
        with_clock: bool,
    ) -> None:
        """Create a publisher for each topic and, if `with_clock` is set, for /clock.

        `counts` maps the topics to their numbers of messages. Topics that cannot be played are
        logged. Raises ValueError if no topic can be played.
        """
        if len(counts) > _MOST_TOPICS:
            raise ValueError(
                f'the bag has {len(counts)} topics, and at most {_MOST_TOPICS} are played; '
                'name some in parameter topics'
            )
        self.published = 0
        self.left_out = 0
        self._node = node
        self._stopping = stopping
        self.lockstep: Lockstep | None = None
        """Flow control by an analyser, or None if the playback clock paces the messages."""
        self._states: dict[str, RecordedStates] = {}
        self._decoders: dict[str, Callable[[bytes], Any]] = {}
        self._publishers: dict[str, Publisher] = {}
        self._types: dict[str, str] = {}
        self._unconfirmed: Counter[str] = Counter()
        self._silent: set[str] = set()
        self._counts = counts
        rejections = []
        for each in counts:
            try:
                self._open(each)
            except _REJECTED as error:
                reason = ' '.join(str(error).partition(', at /')[0].split())
                rejections.append(f'{each.name} of type {each.type_name} is not played: {reason}')
        if rejections and not self._publishers:
            raise ValueError(f'no topic can be played; {"; ".join(rejections[:_MOST_REASONS])}')
        for rejection in rejections:
            node.get_logger().warning(rejection)
        self._clock = interfaces.CLOCK.publisher(node) if with_clock else None

    @property
    def total(self) -> int:
        """Number of messages in the bag that will be published."""
        return sum(self._counts[each] for each in self.of(self._counts))

    def set_lockstep(self, lockstep: Lockstep) -> None:
        """Publish frames in lockstep with the analyser; omit recorded states and events."""
        for name in (lockstep.states, lockstep.events):
            self._publishers.pop(name, None)
        self.lockstep = lockstep

    def suppress_beside_analyser(self, chosen: Container[str]) -> None:
        """Omit recorded states and events while an analyser publishes them.

        Topics whose names are in `chosen` are not omitted.
        """
        for topic in self._publishers:
            name = topic.rpartition('/')[2]
            if name in (interfaces.SOLITON_STATE.name, interfaces.SOLITON_EVENTS.name):
                self._states[topic] = RecordedStates(self._node, topic, name in chosen)

    def report_gap(self, stamp: int, gap: float) -> None:
        """Log that the player skips `gap` seconds without messages before `stamp` [ns]."""
        self._node.get_logger().info(
            f'skipped {gap:.0f} s without a message before {stamp} ns: the recorder was paused, '
            'or the gap exceeds parameter longest_gap'
        )

    def reset(self) -> None:
        """Reset the numbers of published and omitted messages. Forget the unanswered frames."""
        self.published = 0
        self.left_out = 0
        if self.lockstep is not None:
            self.lockstep.forget()

    def of(self, topics: Iterable[StoredTopic]) -> list[StoredTopic]:
        """Return the topics in `topics` that are published."""
        played = {(topic, self._types[topic], CDR) for topic in self._publishers}
        return [each for each in topics if each.key in played]

    def leaves_out(self, topic: StoredTopic) -> bool:
        """Return whether the next message of a topic must be omitted, and count it if so."""
        states = self._states.get(topic.name)
        left_out = states is not None and states.suppressed()
        self.left_out += left_out
        return left_out

    def publish(self, stored: StoredTopic, serialized: bytes) -> None:
        """Publish a message. In lockstep, wait first until the message may be published."""
        topic = stored.name
        if topic in self._decoders:
            serialized = serialize(self._decoders[topic](serialized))
        if self.lockstep is not None:
            self.lockstep.wait_for_turn(topic, serialized, self._stopping.is_set)
        if self._unconfirmed[topic] >= self._publishers[topic].qos_profile.depth:
            self._wait_for_acknowledgements(topic)
        self._publishers[topic].publish(serialized)
        self._unconfirmed[topic] += 1
        if self.lockstep is not None and topic != self.lockstep.frames:
            self._wait_for_acknowledgements(topic)
        self.published += 1

    def publish_clock(self, stamp: int) -> None:
        """Publish the time `stamp` [ns] on /clock, unless the player publishes no clock."""
        if self._clock is not None:
            self._clock.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))

    def wait_for_subscribers(self, topics: Iterable[str], limit: float) -> None:
        """Wait until each topic has a subscriber in another node, at most `limit` [s] for each."""
        for topic in topics:
            if topic not in self._publishers or self._stopping.is_set():
                continue
            publisher = self._publishers[topic]
            own = sum(publisher.topic_name == s.topic_name for s in self._node.subscriptions)
            found = wait_for_subscriber(publisher, limit, self._stopping, own + 1)
            if not found and not self._stopping.is_set():
                self._node.get_logger().warning(
                    f'nothing subscribes to {topic} after {limit:g} s; playing without subscribers'
                )

    def deliver(self) -> None:
        """Wait for all acknowledgements and, in lockstep, for the answers to all frames."""
        self._wait_for_acknowledgements(*self._publishers)
        if self.lockstep is not None:
            self.lockstep.settle(self._stopping.is_set)

    def _open(self, topic: StoredTopic) -> None:
        message_type = class_of(topic)
        published = self._types.setdefault(topic.name, topic.type_name)
        if published != topic.type_name:
            raise ValueError(f'the topic is played with type {published}; a topic has one type')
        if topic.name in self._publishers:
            return
        if is_older(topic):
            self._decoders[topic.name] = decoder(topic)
        qos = interfaces.stream_qos()
        if kept := topic.latched_depth:
            qos = interfaces.latched_qos(min(kept, qos.depth))
        publisher = self._node.create_publisher(message_type, topic.name, qos)
        self._publishers[topic.name] = publisher

    def _wait_for_acknowledgements(self, *topics: str) -> None:
        """Wait until the subscribers have acknowledged all messages on these topics.

        If the queue of a publisher is full of unacknowledged messages, the next message would
        displace the oldest of them, and a subscriber would lose it.
        """
        deadline = time.monotonic() + _LONGEST_DELIVERY
        for topic in topics:
            patience = Duration() if topic in self._silent else _POLL_INTERVAL
            while not self._publishers[topic].wait_for_all_acked(patience):
                if self._stopping.is_set():
                    return
                if topic in self._silent or time.monotonic() > deadline:
                    self._report_silence(topic)
                    break
            else:
                self._silent.discard(topic)
            self._unconfirmed[topic] = 0

    def _report_silence(self, topic: str) -> None:
        if topic not in self._silent:
            self._silent.add(topic)
            self._node.get_logger().warning(
                f'a subscriber of {topic} has acknowledged nothing for {_LONGEST_DELIVERY:g} s; '
                'it may miss messages. Restart it'
            )


_QUERY_INTERVAL = 0.25
"""Time between two searches for an analyser in the ROS graph [s]. A search takes 1 ms."""


class RecordedStates:
    """Suppression of recorded soliton states or events while an analyser publishes them."""

    def __init__(self, node: Node, topic: str, chosen: bool) -> None:
        self._topic = topic
        self._node = node
        self._states = node.resolve_topic_name(topic)
        frames = f'{topic.rpartition("/")[0]}/{interfaces.JOINT_STATES.name}'
        self._frames = node.resolve_topic_name(frames)
        self._chosen = chosen
        self._analyser = ''
        self._queried_at = -_QUERY_INTERVAL

    def suppressed(self) -> bool:
        """Return whether the next message must be omitted. Log each change of this result."""
        now = time.monotonic()
        if now - self._queried_at >= _QUERY_INTERVAL:
            self._queried_at = now
            analyser = self._find_analyser()
            if analyser != self._analyser:
                self._analyser = analyser
                self._log()
        return bool(self._analyser) and not self._chosen

    def _find_analyser(self) -> str:
        node = self._node
        subscribers = {
            node_of(each) for each in node.get_subscriptions_info_by_topic(self._frames)
        }
        publishers = {node_of(each) for each in node.get_publishers_info_by_topic(self._states)}
        return min(subscribers & publishers - {node.get_fully_qualified_name()}, default='')

    def _log(self) -> None:
        log, name = self._node.get_logger(), self._topic.rpartition('/')[2]
        if not self._analyser:
            log.info(f'no analyser runs: the recorded {self._states} is played again')
        elif self._chosen:
            log.warning(
                f'{self._analyser} also publishes {self._states}; both are mixed. '
                f'Stop it, or remove {name} from parameter topics'
            )
        else:
            log.info(
                f'{self._analyser} publishes {self._states}: the recorded topic is omitted; '
                f'add {name} to the parameter topics to play both'
            )
