# SPDX-License-Identifier: Apache-2.0
"""The bag recorder: every message of the suite, as it came, into a bag."""

from __future__ import annotations

import json
import shlex
import sys
import threading
import time
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import Chain
from soliton_linkage_nodes.bags.read.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import (
    COMPRESSIONS,
    STORAGES,
    BagWriter,
    suite_version,
)
from soliton_linkage_nodes.bags.record.inlets import Inlet, InletFinder
from soliton_linkage_nodes.bags.record.message_gate import MessageGate
from soliton_linkage_nodes.bags.record.writing_thread import Taken, WritingThread
from soliton_linkage_nodes.bags.services import serve, tell
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.parameters import declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run

_POLL_INTERVAL = 0.02
_SEARCH_INTERVAL = 0.25
_LONGEST_TEXT = 1000


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of the recorder."""

    output: str = quantity(
        '', 'path of the bag, to which _0, _1, ... is added; empty for the date and time'
    )
    storage: str = quantity('mcap', 'storage of the bag', choices=STORAGES)
    compression: str = quantity('none', 'compression of an mcap file', choices=COMPRESSIONS)
    topics: tuple[str, ...] = quantity((), 'names of topics to record; empty for all of the suite')
    regex: str = quantity('', 'also record the topics whose full names contain this pattern')
    exclude_regex: str = quantity('', 'do not record topics whose full names contain this pattern')
    max_bag_size: int = quantity(0, 'size from which on a new file is begun, 0 for never', 'B', 0)
    max_bag_duration: float = quantity(
        0.0, 'time after which a new file is begun, 0 for never', 's', 0.0
    )
    snapshot_duration: float = quantity(
        0.0,
        'keep only the last seconds, and write them when ~/snapshot is called; 0 to record',
        's',
        0.0,
        3600.0,
    )
    start_paused: bool = quantity(False, 'record nothing until ~/resume is called')


class BagRecorder(Node):
    """Records topics, raw, with the time at which each message was received.

    Subscribes to the topics recorded. Publishes `/diagnostics`. Serves, with the types of
    rosbag2_interfaces or std_srvs/Trigger, `~/pause`, `~/resume`, `~/is_paused`,
    `~/split_bagfile` and `~/snapshot`. Parameters: those of `BagRecorderParameters`.

    One thread takes the messages, another does all that touches the bag. The subscriptions
    belong to a hidden node that no executor spins: executors give a callback either the raw
    message or its sequence number, and cost ten times as much as taking a few messages at a time.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Create the bag and begin."""
        super().__init__('bag_recorder', **kwargs)
        settings = declare(self, BagRecorderParameters)
        refuse_unknown(self)
        self._inbox = rclpy.create_node(
            '_bag_recorder_inbox',
            namespace=self.get_namespace(),
            context=self.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._finder = InletFinder(
            self._inbox, settings.topics, settings.regex, settings.exclude_regex
        )
        self._gate = MessageGate(settings.snapshot_duration, settings.start_paused)
        self._gate_lock = threading.Lock()
        self._bag = WritingThread(lambda: _create_writer(settings))
        self._chains: dict[str, dict[str, Any]] = {}
        self._taking_failure: Exception | None = None
        self._inlets: list[Inlet] = []
        self._add(self._finder.of_suite())
        self._stopping = threading.Event()
        self._taking = threading.Thread(target=self._take, name='taking')
        self._taking.start()
        self._diagnostics = Diagnostics(self, 'recording', self._report)
        self._offer_services(snapshots=settings.snapshot_duration > 0)
        self.get_logger().info(f'recording to {self._bag.writer.path}')
        for name in sorted(self._finder.awaited):
            self.get_logger().info(f'waiting for a publisher of {name}')

    @property
    def lost(self) -> int:
        """Messages that were published and are not in the bag, pauses aside."""
        return sum(self._losses().values())

    @property
    def messages(self) -> int:
        """Messages in the bag."""
        return self._bag.writer.messages

    @property
    def failure(self) -> Exception | None:
        """Why it cannot go on."""
        return self._taking_failure or self._bag.failure

    def destroy_node(self) -> None:
        """Take what has come, write it and finish the bag; raises OSError where it cannot."""
        self._stopping.set()
        self._taking.join()
        self._bag.close(self._account())
        self._inbox.destroy_node()
        path = self._bag.writer.path
        said = f'closed {path}: {self.messages} messages, {self.lost} lost'
        if self._bag.failure is None:
            self.get_logger().info(said)
        super().destroy_node()
        if self.failure is not None:
            raise self.failure

    def _offer_services(self, snapshots: bool) -> None:
        serve(self, 'pause', 'Pause', lambda _: self._pause())
        serve(self, 'resume', 'Resume', lambda _: self._resume())
        serve(self, 'split_bagfile', 'SplitBagfile', lambda _: self._bag.split())
        serve(self, 'snapshot', 'Snapshot', lambda _: self._snapshot(snapshots))
        tell(self, 'is_paused', 'IsPaused', 'paused', lambda: self._gate.paused)

    def _pause(self) -> None:
        with self._gate_lock:
            self._gate.paused = True

    def _resume(self) -> None:
        with self._gate_lock:
            self._bag.put(self._gate.resume())

    def _snapshot(self, possible: bool) -> str | None:
        if not possible:
            return 'snapshot_duration of bag_recorder = 0 keeps nothing; give it some seconds'
        with self._gate_lock:
            self._bag.put(self._gate.snapshot())
        return None

    def _add(self, inlets: list[Inlet]) -> None:
        for inlet in inlets:
            self._bag.begin(inlet.source)
        self._inlets = [*self._inlets, *inlets]

    def _take(self) -> None:
        """Take messages from the middleware until told to stop, and then what is left."""
        search_at = time.monotonic()
        last_round = False
        try:
            while not last_round:
                last_round = self._stopping.wait(_POLL_INTERVAL)
                batch = [message for inlet in self._inlets for message in inlet.drain()]
                if time.monotonic() >= search_at and not last_round:
                    search_at = time.monotonic() + _SEARCH_INTERVAL
                    batch += [message for inlet in self._inlets for message in inlet.adapt()]
                    self._add(self._finder.find())
                    self._bag.note(self._account())
                self._keep(batch)
        except Exception as error:
            self._taking_failure = error

    def _keep(self, batch: list[Taken]) -> None:
        for source, _, serialized in batch:
            if source.type_name == _CHAIN_TYPE:
                self._chains[source.name] = _parameters_of(serialized)
        batch.sort(key=attrgetter('stamp'))
        with self._gate_lock:
            passed = self._gate.take(batch)
            if passed:
                self._bag.put(passed)

    def _losses(self) -> dict[str, int]:
        dropped = self._bag.dropped
        return {i.source.name: i.gaps.lost + dropped[i.source.name] for i in self._inlets}

    def _account(self) -> dict[str, str]:
        """What the bag says of the recording itself."""
        return {
            'lost_messages': json.dumps(self._losses()),
            'chain': json.dumps(self._chains),
            'suite_version': suite_version(),
            'command_line': shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        }

    def _report(self) -> Report:
        lost, refused = self.lost, {**self._finder.refused, **self._bag.refused}
        heard = [inlet.source.name for inlet in self._inlets if inlet.publishers]
        state = 'paused' if self._gate.paused else 'recording'
        if lost:
            state = f'{state}, {lost} messages lost'
        elif refused:
            state = f'{state}, but not {", ".join(refused)}: {next(iter(refused.values()))}'
        elif self._finder.awaited:
            state = f'{state}, waiting for {", ".join(sorted(self._finder.awaited))}'
        figures = {
            'bag': self._bag.writer.path,
            'messages': self.messages,
            'lost messages': lost,
            'files': self._bag.writer.files,
            'bytes waiting for the disk': self._bag.waiting,
            'topics heard': ' '.join(heard),
        }
        return Report(
            state,
            {**figures, **{f'lost of {name}': n for name, n in self._losses().items() if n}},
            warning=bool(lost or refused or self._finder.awaited),
        )


_CHAIN_TYPE = type_name(interfaces.CHAIN.type)


def _create_writer(settings: BagRecorderParameters) -> BagWriter:
    now = time.strftime('%Y_%m_%d-%H_%M_%S')
    return BagWriter(
        Path(settings.output or f'recording_{now}'),
        settings.storage,
        settings.compression,
        settings.max_bag_size,
        settings.max_bag_duration,
    )


def _parameters_of(serialized: bytes) -> dict[str, Any]:
    """Parameters of a chain, without the lists that are too long to be told twice."""
    message = deserialize_message(serialized, Chain)
    told: dict[str, Any] = {'number_of_rotors': len(message.joint_names)}
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, '__len__') and not isinstance(value, str):
            value = list(value)
        if name not in ('header', 'joint_names') and len(str(value)) < _LONGEST_TEXT:
            told[name] = value
    return told


def _finished(recorder: BagRecorder) -> bool:
    if recorder.failure is not None:
        raise recorder.failure
    return False


def main() -> None:
    """Run the recorder until it is told to stop."""
    run(BagRecorder, _finished)
