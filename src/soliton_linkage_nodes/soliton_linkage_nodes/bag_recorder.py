# SPDX-License-Identifier: Apache-2.0
"""The bag recorder: every message of the suite, as it came, into a bag."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosbags.interfaces import Connection

from soliton_linkage.quantities import quantity
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.bags import STORAGES, BagWriter, type_name
from soliton_linkage_nodes.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.parameters import declare, refuse_unknown
from soliton_linkage_nodes.process import run
from soliton_linkage_nodes.sequence_gaps import SequenceGaps

Result = TypeVar('Result')

_POLL_INTERVAL = 0.005


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of the recorder."""

    output: str = quantity(
        '', 'path of the bag, to which _0, _1, ... is added; empty for the date and time'
    )
    storage: str = quantity('mcap', 'storage of the bag', choices=tuple(STORAGES))
    topics: tuple[str, ...] = quantity((), 'topics of the suite to record; empty for all of them')


@dataclass(frozen=True)
class Inlet:
    """A topic that is being recorded."""

    name: str
    subscription: Subscription
    connection: Connection
    gaps: SequenceGaps

    def drain(self) -> list[tuple[int, Connection, bytes]]:
        """Take all messages that are waiting: when they were received [ns], and what."""
        taken = []
        publishers = self.subscription.get_publisher_count()
        handle = self.subscription.handle
        with handle:
            while (message := handle.take_message(self.subscription.msg_type, True)) is not None:
                serialized, info = message
                number = info['publication_sequence_number']
                if number is not None:
                    self.gaps.take(number, publishers)
                taken.append((info['received_timestamp'], self.connection, serialized))
        return taken


class BagRecorder(Node):
    """Records the topics of the suite, raw, with the time at which each message was received.

    Subscribes to the topics recorded. Publishes `/diagnostics`.
    Parameters: those of `BagRecorderParameters`.

    One thread takes the messages, another does all that touches the bag. The subscriptions
    belong to a hidden node that no executor spins: executors give a callback either the raw
    message or its sequence number, and cost ten times as much as taking a few messages at a time.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Create the bag and begin."""
        super().__init__('bag_recorder', **kwargs)
        settings = declare(self, BagRecorderParameters)
        refuse_unknown(self)
        topics = _chosen_topics(settings.topics)
        now = time.strftime('%Y_%m_%d-%H_%M_%S')
        name = Path(settings.output or f'recording_{now}')
        self._bag_thread = ThreadPoolExecutor(1)
        self._writer = self._at_the_bag(BagWriter, name, settings.storage)
        self._inbox = rclpy.create_node(
            '_bag_recorder_inbox',
            namespace=self.get_namespace(),
            context=self.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._inlets = [self._open_inlet(topic) for topic in topics]
        self.failure: Exception | None = None
        self._stopping = threading.Event()
        self._taking = threading.Thread(target=self._take)
        self._taking.start()
        self._diagnostics = Diagnostics(self, 'recording', self._report)
        self.get_logger().info(f'recording to {self._writer.path}')

    @property
    def lost(self) -> int:
        """Messages that were published and did not arrive."""
        return sum(inlet.gaps.lost for inlet in self._inlets)

    def destroy_node(self) -> None:
        """Take what has come, write it and finish the bag; raises OSError where it cannot."""
        self._stopping.set()
        self._taking.join()
        lost = {inlet.name: inlet.gaps.lost for inlet in self._inlets}
        try:
            if isinstance(self.failure, OSError):
                self._at_the_bag(self._writer.abort)
                return
            self._at_the_bag(self._writer.close, {'lost_messages': json.dumps(lost)})
            self.get_logger().info(
                f'closed {self._writer.path}: {self._writer.messages} messages, {self.lost} lost'
            )
        finally:
            self._bag_thread.shutdown()
            self._inbox.destroy_node()
            super().destroy_node()

    def _at_the_bag(self, act: Callable[..., Result], *arguments: Any) -> Result:
        return self._bag_thread.submit(act, *arguments).result()

    def _open_inlet(self, topic: interfaces.Topic) -> Inlet:
        subscription = self._inbox.create_subscription(
            topic.type, topic.name, lambda message: None, topic.qos, raw=True
        )
        name = subscription.topic_name
        connection = self._at_the_bag(
            self._writer.add_topic, name, type_name(topic.type), topic.qos
        )
        return Inlet(name, subscription, connection, SequenceGaps())

    def _take(self) -> None:
        """Take messages from the middleware until told to stop, and then what is left."""
        last_round = False
        try:
            while not last_round:
                last_round = self._stopping.wait(_POLL_INTERVAL)
                batch = [message for inlet in self._inlets for message in inlet.drain()]
                if batch:
                    batch.sort(key=lambda message: message[0])
                    self._bag_thread.submit(self._write, batch)
        except Exception as error:
            self.failure = error

    def _write(self, batch: list[tuple[int, Connection, bytes]]) -> None:
        if self.failure is not None:
            return
        try:
            for stamp, connection, serialized in batch:
                self._writer.write(connection, stamp, serialized)
        except Exception as error:
            self.failure = error

    def _report(self) -> Report:
        heard = [inlet.name for inlet in self._inlets if inlet.subscription.get_publisher_count()]
        return Report(
            f'recording, {self.lost} messages lost' if self.lost else 'recording',
            {
                'bag': self._writer.path,
                'messages': self._writer.messages,
                'lost messages': self.lost,
                'topics heard': ' '.join(heard),
            },
            warning=bool(self.lost),
        )


def _chosen_topics(names: tuple[str, ...]) -> list[interfaces.Topic]:
    known = {topic.name.lstrip('/'): topic for topic in interfaces.SUITE}
    for name in names:
        if name.lstrip('/') not in known:
            raise ValueError(
                f'parameter topics of bag_recorder names {name!r}, which is none of '
                f'{", ".join(known)}'
            )
    chosen = {name.lstrip('/') for name in names} or set(known)
    return [topic for name, topic in known.items() if name in chosen]


def _finished(recorder: BagRecorder) -> bool:
    if recorder.failure is not None:
        raise recorder.failure
    return False


def main() -> None:
    """Run the recorder until it is told to stop."""
    run(BagRecorder, _finished)
