# SPDX-License-Identifier: Apache-2.0
"""Thread that writes a bag, so that a slow disk does not delay other threads."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rclpy.qos import QoSProfile

from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime.pacing import IdlePriority

_FLUSH_INTERVAL = 0.1
"""Time between two flushes while no messages arrive [s]."""
_LONGEST_FLUSH = 5.0
"""Longest wait of `flush` for the disk [s]."""
_MOST_WAITING = 512 * 2**20
"""Largest total size of the messages in the queue [B], 10 s for 1000 rotors at 1000 Hz."""


@dataclass(frozen=True, eq=False)
class RecordedTopic:
    """Topic to be recorded, with its type and the QoS profiles of its publishers."""

    name: str
    type_name: str
    profiles: tuple[QoSProfile, ...]
    latched: bool = False


class ReceivedMessage(NamedTuple):
    """Serialized message, with its topic and receive time [ns]."""

    source: RecordedTopic
    stamp: int
    serialized: bytes


class WritingThread:
    """Thread that writes messages in the order of the calls of `put`.

    If the disk is slow, the messages wait in a queue of at most `most_waiting` bytes. Further
    messages are dropped, and `dropped` counts them by topic. If a write fails, the thread tries to
    finish the bag and stores the error in `failure`.
    """

    def __init__(
        self,
        create_writer: Callable[[], BagWriter],
        most_waiting: int = _MOST_WAITING,
        real_time: bool = False,
    ) -> None:
        self.dropped: Counter[str] = Counter()
        self.failure: Exception | None = None
        self.rejected: dict[str, str] = {}
        self._most_waiting = most_waiting
        self._actions: deque[Callable[[], object]] = deque()
        self.waiting = 0
        self._changed = threading.Condition()
        self._ending = False
        self._real_time = real_time
        self._final: Mapping[str, str] = {}
        self._topics: dict[RecordedTopic, StoredTopic | None] = {}
        self._ready = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(create_writer,), name='bag', daemon=True
        )
        self._thread.start()
        self._ready.wait()
        if self.failure is not None:
            self._thread.join()
            raise self.failure

    def put(self, messages: Sequence[ReceivedMessage]) -> None:
        """Queue messages for writing."""
        if not messages:
            return
        size = sum(len(message.serialized) for message in messages)
        with self._changed:
            if self.failure is not None or self.waiting + size > self._most_waiting:
                self.dropped.update(message.source.name for message in messages)
                return
            self.waiting += size
            self._actions.append(lambda: self._write(messages, size))
            self._changed.notify()

    def post(self, action: Callable[[], object]) -> None:
        """Queue an action, for example a method of `writer`. It runs after the queued messages."""
        with self._changed:
            self._actions.append(action)
            self._changed.notify()

    def add_topic(self, topic: RecordedTopic) -> None:
        """Add a topic to the bag. The bag lists the topic even if it has no messages."""
        self.post(lambda: self._stored(topic))

    def flush(self) -> None:
        """Wait at most 5 s until all queued messages are passed to the operating system."""
        written = threading.Event()
        if self.failure is None:
            self.post(self.writer.flush)
            self.post(written.set)
            written.wait(_LONGEST_FLUSH)

    def close(self, custom_data: Mapping[str, str]) -> None:
        """Write all queued messages, and finish the bag. An error is stored in `failure`."""
        with self._changed:
            self._final = custom_data
            self._ending = True
            self._changed.notify()
        self._thread.join()

    def abandon(self) -> None:
        """Close the bag, and remove it if it has no messages."""
        self.close({})
        self.writer.remove_if_empty()

    def _run(self, create_writer: Callable[[], BagWriter]) -> None:
        try:
            self.writer = create_writer()
        except Exception as error:
            self.failure = error
            return
        finally:
            self._ready.set()
        priority = IdlePriority(self._real_time, [0])
        try:
            while (action := self._next()) is not None:
                action()
                priority.update()
            self.writer.close(self._final)
        except Exception as error:
            self._fail(error)

    def _next(self) -> Callable[[], object] | None:
        with self._changed:
            if not self._actions and not self._ending:
                self._changed.wait(_FLUSH_INTERVAL)
            if self._actions:
                return self._actions.popleft()
            return None if self._ending else self.writer.flush_if_due

    def _fail(self, error: Exception) -> None:
        try:
            self.writer.finish_after_error()
        except Exception:
            self.failure = error
            raise
        kept = f'the {self.writer.messages} earlier messages are kept'
        if not self.writer.finished:
            kept = f'recover the earlier messages with: recover_bag {self.writer.path}'
        with self._changed:
            self.failure = OSError(f'{error}; {kept}') if isinstance(error, OSError) else error
            self._actions.clear()
            self.waiting = 0

    def _stored(self, topic: RecordedTopic) -> StoredTopic | None:
        if topic not in self._topics:
            try:
                self._topics[topic] = self.writer.add_topic(
                    topic.name, topic.type_name, *topic.profiles
                )
            except ValueError as error:
                self._topics[topic] = None
                self.rejected[topic.name] = str(error)
        return self._topics[topic]

    def _write(self, messages: Sequence[ReceivedMessage], size: int) -> None:
        for source, stamp, serialized in messages:
            if (topic := self._stored(source)) is not None:
                self.writer.write(topic, stamp, serialized)
        with self._changed:
            self.waiting -= size
