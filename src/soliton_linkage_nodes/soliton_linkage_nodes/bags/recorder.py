# SPDX-License-Identifier: Apache-2.0
"""Bag recorder. By default it stores the messages on all topics of this software in a bag."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.bags.record.bag_writer import COMPRESSIONS, BagWriter
from soliton_linkage_nodes.bags.record.receiving_thread import ReceivingThread
from soliton_linkage_nodes.bags.record.subscriptions import RecordingBuffer, TopicFinder
from soliton_linkage_nodes.bags.record.writing_thread import WritingThread
from soliton_linkage_nodes.bags.recovery import take_over, unfinished_bag
from soliton_linkage_nodes.bags.services import Reply, serve, serve_value
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current

_LAST_STAMP = 2.0**31
"""Largest time that a ROS stamp can hold [s]."""


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of the bag recorder."""

    output: str = quantity(
        '', 'path of the bag; _0, _1, ... is appended; empty: named by date and time'
    )
    compression: str = quantity('none', 'compression of the chunks', choices=COMPRESSIONS)
    topics: tuple[str, ...] = quantity((), 'names of topics to record; empty: all of the suite')
    regex: str = quantity('', 'also record the topics whose full names contain this pattern')
    exclude_regex: str = quantity('', 'do not record topics whose full names contain this pattern')
    max_bag_size: int = quantity(0, 'size at which a new file is begun, 0: never', 'B', 0)
    max_bag_duration: float = quantity(
        0.0, 'duration after which a new file is begun, 0: never', 's', 0.0, _LAST_STAMP
    )
    snapshot_duration: float = quantity(
        0.0, 'duration in memory for ~/snapshot; 0: record continuously', 's', 0.0, 3600.0
    )
    sync_interval: float = quantity(
        1.0, 'interval of synchronising to disk, lost if power fails; 0: never', 's', 0.0, 3600.0
    )
    append: bool = quantity(
        False, 'continue the last bag of this output in a new file, if its recorder was killed'
    )
    start_paused: bool = quantity(False, 'begin paused, until ~/resume is called')


class BagRecorder(ManagedNode):
    """Node that stores serialized messages with their receive times in a bag.

    The node subscribes to the topics that it records, and publishes `/diagnostics`. It serves
    `~/pause`, `~/resume`, `~/is_paused`, `~/split_bagfile` and `~/snapshot`, as in rosbag2.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {BagRecorderParameters: '', ManagedParameters: ''}

    def configure(self) -> None:
        """Create the bag, subscribe to the topics and start the threads."""
        self._settings = settings = current(self, BagRecorderParameters)
        self._paused = settings.start_paused
        self._connected = False
        with ExitStack() as undo:
            self._inbox = GuardedNode(
                '_bag_recorder_inbox',
                namespace=self.get_namespace(),
                context=self.context,
                enable_rosout=False,
                start_parameter_services=False,
            )
            undo.callback(self._inbox.destroy_node)
            patterns = settings.regex, settings.exclude_regex
            self._finder = TopicFinder(self._inbox, settings.topics, *patterns)
            paused = self._paused or not self.starting
            self._buffer = RecordingBuffer(settings.snapshot_duration, paused)
            self._bag = WritingThread(lambda: _create_writer(settings), real_time=self.real_time)
            undo.callback(self._bag.abandon)
            self._receiving = ReceivingThread(
                self._finder, self._buffer, self._bag, self._announce, self.real_time
            )
            self.diagnostics = Diagnostics(self, 'recording', self.reporting(self._report))
            self._offer_services()
            undo.pop_all()
        self.get_logger().info(
            f'created {self._bag.writer.path}; discovering all publishers, which takes 3 s'
        )
        for name in sorted(self._finder.awaited):
            self.get_logger().info(f'waiting for a publisher of {name}')

    def activate(self) -> None:
        """Start recording, unless the recorder is paused."""
        if self._buffer.paused and not self._paused:
            self._receiving.resume()

    def deactivate(self) -> None:
        """Stop recording, and write all received messages."""
        self._receiving.settle()
        self._receiving.pause()
        self._bag.flush()

    @property
    def lost(self) -> int:
        """Number of messages that were lost, as `ReceivingThread.losses` defines it."""
        return sum(self._receiving.losses.values())

    @property
    def missed(self) -> int:
        """Number of messages sent before the recorder was connected to their publisher.

        Only messages that were sent after the start of the recorder are counted. They are not
        included in `lost`.
        """
        return sum(self._receiving.missed.values())

    @property
    def messages(self) -> int:
        """Number of messages in the bag."""
        return self._bag.writer.messages

    @property
    def failure(self) -> Exception | None:
        """Error that ended the recording, or None if no error has occurred."""
        if not self.configured:
            return None
        return self._receiving.failure or self._bag.failure

    def cleanup(self) -> None:
        """Write the remaining messages and finish the bag. Raise the error if writing failed."""
        self._bag.close(self._receiving.stop())
        self._inbox.destroy_node()
        path = self._bag.writer.path
        if self._bag.failure is None:
            missed = f', {self.missed} missed before matching' if self.missed else ''
            self.get_logger().info(
                f'closed {path}: {self.messages} messages, {self.lost} lost{missed}'
            )
        if self.failure is not None:
            raise self.failure

    def _announce(self, missing: Sequence[str]) -> None:
        writer = self._bag.writer
        without = f', but a publisher of {", ".join(missing)} did not respond' if missing else ''
        self.get_logger().info(f'recording to {writer.path}{writer.gap_description}{without}')
        self._connected = True

    def _offer_services(self) -> None:
        serve(self, 'pause', 'Pause', lambda _: self._pause())
        serve(self, 'resume', 'Resume', lambda _: self._resume())
        serve(self, 'split_bagfile', 'SplitBagfile', lambda _: self._split())
        serve(self, 'snapshot', 'Snapshot', lambda _: self._snapshot())
        serve_value(self, 'is_paused', 'IsPaused', 'paused', lambda: self._buffer.paused)

    def _pause(self) -> Reply:
        self._paused = True
        self._receiving.pause()
        return Reply('paused until ~/resume')

    def _resume(self) -> Reply:
        self._paused = False
        latched = self._receiving.resume()
        return Reply(f'recording again, with {latched} latched messages of the pause')

    def _split(self) -> Reply:
        self._bag.post(self._bag.writer.split)
        return Reply('the bag continues in a new file')

    def _snapshot(self) -> Reply:
        duration = self._settings.snapshot_duration
        if not duration:
            raise ValueError(
                'parameter snapshot_duration of bag_recorder = 0 keeps no messages; set it above 0'
            )
        return Reply(f'{self._receiving.snapshot()} messages of the last {duration:g} s written')

    def _report(self) -> Report:
        lost, rejected = self.lost, {**self._finder.rejected, **self._bag.rejected}
        state = 'recording' if self._connected else 'discovering publishers'
        if self._buffer.paused:
            state = 'paused'
        if lost:
            state = f'{state}, {lost} messages lost'
        elif self.missed:
            state = f'{state}, {self.missed} messages missed before their publisher was matched'
        elif rejected:
            state = f'{state}, but not {", ".join(rejected)}: {next(iter(rejected.values()))}'
        elif self._finder.awaited:
            state = f'{state}, waiting for {", ".join(sorted(self._finder.awaited))}'
        losses, missed = self._receiving.losses, self._receiving.missed
        figures = {
            'bag': self._bag.writer.path,
            'messages': self.messages,
            'lost messages': lost,
            'missed messages': self.missed,
            'files': self._bag.writer.files,
            'bytes waiting for the disk': self._bag.waiting,
            'messages held back': self._buffer.held,
            'topics received': ' '.join(self._receiving.connected_topics),
            **{f'lost on {name}': n for name, n in losses.items() if n},
            **{f'missed on {name}': n for name, n in missed.items()},
        }
        warning = bool(lost or self.missed or rejected or self._finder.awaited)
        return Report(state, figures, warning)


def _create_writer(settings: BagRecorderParameters) -> BagWriter:
    now = time.strftime('%Y_%m_%d-%H_%M_%S')
    name = Path(settings.output or f'recording_{now}')
    unfinished = unfinished_bag(name) if settings.append else None
    begun = take_over(unfinished) if unfinished else None
    sync, limits = settings.sync_interval, (settings.max_bag_size, settings.max_bag_duration)
    return BagWriter(name, settings.compression, *limits, sync_interval=sync, begun=begun)
