# SPDX-License-Identifier: Apache-2.0
"""Thread that receives messages from the middleware and passes them to the writing thread."""

from __future__ import annotations

import json
import shlex
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.metadata import suite_version
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.subscriptions import (
    RecordedSubscription,
    RecordingBuffer,
    TopicFinder,
)
from soliton_linkage_nodes.bags.record.writing_thread import ReceivedMessage, WritingThread
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import IdlePriority

_LONGEST_TEXT = 1000
"""Chain parameters whose text has at least this length are not stored in the bag [characters]."""
_CHAIN_TYPE = type_name(interfaces.CHAIN.type)


def _parameters_of(serialized: bytes) -> dict[str, Any]:
    message = deserialize_message(serialized, interfaces.CHAIN.type)
    parameters: dict[str, Any] = {'number_of_rotors': len(message.joint_names)}
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, '__len__') and not isinstance(value, str):
            value = list(value)
        if name not in ('header', 'joint_names') and len(str(value)) < _LONGEST_TEXT:
            parameters[name] = value
    return parameters


_ANNOUNCEMENT = 3.2
"""Shortest duration of the discovery [s]. Each process announces itself every 3 s."""
_QUIET = 1.0
"""The discovery ends when the numbers of known and connected publishers have been constant for
this time [s]."""
_LONGEST_DISCOVERY = 10.0
"""Longest wait for unconnected publishers [s]. They may have been killed."""


class DiscoveryWait:
    """Monitor that checks whether all publishers of recorded topics are found and connected."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.missing: list[str] = []
        """Topics with an unconnected publisher at the last call of `done`."""
        self._clock = clock
        self._begun = self._since = clock()
        self._known: list[tuple[str, int, int]] = []

    def done(self, subscriptions: Sequence[RecordedSubscription]) -> bool:
        """Return whether all publishers are found and connected, or the longest wait has ended."""
        now = self._clock()
        known = [(each.source.name, each.publishers, each.connected) for each in subscriptions]
        if known != self._known:
            self._known, self._since = known, now
        self.missing = [name for name, publishers, connected in known if connected < publishers]
        if now < max(self._since + _QUIET, self._begun + _ANNOUNCEMENT):
            return False
        return not self.missing or now - self._begun > _LONGEST_DISCOVERY


_POLL_INTERVAL = 0.05
"""Time between two rounds [s]. In a round, the thread receives all waiting messages."""
_DISCOVERY_INTERVAL = 0.01
"""Time between two searches for new topics [s]. A search takes at most 0.1 ms."""
_LONGEST_ROUND = 5.0
"""Longest wait of `settle` for two rounds of the thread [s]. Two rounds usually take 0.1 s."""
_LONGEST_TRANSPORT = 2.0
"""Longest wait for messages in transport in `settle` [s]."""
_SEARCH_INTERVAL = 0.25
"""Time between two searches for new publishers of the subscribed topics [s]."""


class ReceivingThread:
    """Thread that receives messages from the middleware and passes them to the writing thread.

    The thread works in rounds. It sorts the messages of a round by receive time. The subscriptions
    are not added to an executor, because a callback cannot receive both the serialized message and
    its sequence number.
    """

    def __init__(
        self,
        finder: TopicFinder,
        buffer: RecordingBuffer,
        bag: WritingThread,
        announce: Callable[[Sequence[str]], None],
        real_time: bool = False,
    ) -> None:
        """Start the thread.

        After the discovery, the thread calls `announce` with the topics of unconnected publishers.
        """
        self.failure: Exception | None = None
        self._finder = finder
        self._buffer = buffer
        self._bag = bag
        self._announce = announce
        self._real_time = real_time
        self._discovery: DiscoveryWait | None = DiscoveryWait()
        self._lock = threading.Lock()
        self._paused_at = time.time_ns()
        self._chains: dict[str, dict[str, Any]] = {}
        self._subscriptions: list[RecordedSubscription] = []
        self._add(finder.of_suite())
        self._rounds = 0
        self._rounds_changed = threading.Condition()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='receiving', daemon=True)
        self._thread.start()

    @property
    def connected_topics(self) -> list[str]:
        """Names of the topics with at least one connected publisher."""
        return [each.source.name for each in self._subscriptions if each.connected]

    @property
    def losses(self) -> dict[str, int]:
        """Numbers of lost messages, by topic.

        A message is lost if a connected publisher sent it and the recorder did not receive it. It
        is also lost if it was dropped because the disk was too slow or a write failed. Messages
        that were received during a pause, and the messages of `missed`, are not counted.
        """
        dropped = self._bag.dropped
        lost = {each.source.name: each.gaps.lost for each in self._subscriptions}
        return {name: count + dropped[name] for name, count in lost.items()}

    @property
    def missed(self) -> dict[str, int]:
        """Numbers of messages sent before the recorder was connected to their publisher, by topic.

        Only messages that were sent after the start of the recorder are counted. Messages on
        latched topics are not counted.
        """
        missed = {each.source.name: each.starts.missed for each in self._subscriptions}
        return {name: number for name, number in missed.items() if number}

    def pause(self) -> None:
        """Stop recording until `resume`."""
        with self._lock:
            if not self._buffer.paused:
                self._paused_at = time.time_ns()
            self._buffer.paused = True

    def settle(self) -> None:
        """Wait until the thread has received all messages that were sent before this call."""
        called = time.time_ns()
        with self._rounds_changed:
            after = self._rounds + 2
            self._rounds_changed.wait_for(lambda: self._rounds >= after, _LONGEST_ROUND)
            self._rounds_changed.wait_for(
                lambda: not any(each.may_lack(called) for each in self._subscriptions),
                _LONGEST_TRANSPORT,
            )

    def resume(self) -> int:
        """End a pause, and record the last message of the pause on each latched topic.

        Return the number of messages that this call has recorded.
        """
        if self._buffer.paused:
            gap = self._paused_at, time.time_ns()
            self._bag.post(lambda: self._bag.writer.add_gap(*gap))
        return self._record(self._buffer.resume)

    def snapshot(self) -> int:
        """Record the messages of the snapshot, and return their number."""
        return self._record(self._buffer.snapshot)

    def stop(self) -> dict[str, str]:
        """Receive the remaining messages and end the thread. Return the custom data of the bag."""
        self._stopping.set()
        self._thread.join()
        return self._custom_data()

    def _run(self) -> None:
        search_at = time.monotonic()
        priority = IdlePriority(self._real_time, [0])
        last_round = False
        try:
            while not last_round:
                last_round = self._wait()
                priority.update()
                searching = time.monotonic() >= search_at and not last_round
                batch = [message for each in self._subscriptions for message in each.drain()]
                if searching:
                    search_at = time.monotonic() + _SEARCH_INTERVAL
                    query = self._discovery is not None
                    for each in self._subscriptions:
                        batch += each.adapt(query)
                    data = self._custom_data()
                    self._bag.post(partial(self._bag.writer.set_custom_data, data))
                else:
                    changed = [each for each in self._subscriptions if each.changed]
                    batch += [message for each in changed for message in each.adapt(True)]
                self._add(self._finder.find())
                for source, _, serialized in batch:
                    if source.type_name == _CHAIN_TYPE:
                        self._chains[source.name] = _parameters_of(serialized)
                batch.sort(key=attrgetter('stamp'))
                with self._lock:
                    self._bag.put(self._buffer.take(batch))
                if searching:
                    self._announce_once_connected()
                self._end_round(1)
        except Exception as error:
            self.failure = error
            self._end_round(sys.maxsize)

    def _wait(self) -> bool:
        round_at = time.monotonic() + _POLL_INTERVAL
        while not self._stopping.wait(_DISCOVERY_INTERVAL):
            if time.monotonic() >= round_at or self._finder.appeared:
                return False
        return True

    def _announce_once_connected(self) -> None:
        discovery = self._discovery
        if discovery is not None and discovery.done(self._subscriptions):
            self._discovery = None
            self._bag.post(self._bag.writer.checkpoint)
            self._bag.post(lambda: self._announce(discovery.missing))

    def _custom_data(self) -> dict[str, str]:
        return {
            'lost_messages': json.dumps(self.losses),
            'missed_messages': json.dumps(self.missed),
            'chain': json.dumps(self._chains),
            'suite_version': suite_version(),
            'command_line': shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        }

    def _end_round(self, number: int) -> None:
        with self._rounds_changed:
            self._rounds += number
            self._rounds_changed.notify_all()

    def _record(self, held: Callable[[], list[ReceivedMessage]]) -> int:
        with self._lock:
            messages = held()
            self._bag.put(messages)
        return len(messages)

    def _add(self, subscriptions: Sequence[RecordedSubscription]) -> None:
        for each in subscriptions:
            self._bag.add_topic(each.source)
        self._subscriptions = [*self._subscriptions, *subscriptions]
