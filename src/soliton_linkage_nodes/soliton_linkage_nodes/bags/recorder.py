# SPDX-License-Identifier: Apache-2.0
"""The bag recorder: every message of the suite, as it came, into a bag."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_nodes.bags.record.bag_writer import COMPRESSIONS, BagWriter
from soliton_linkage_nodes.bags.record.inlets import InletFinder
from soliton_linkage_nodes.bags.record.message_gate import MessageGate
from soliton_linkage_nodes.bags.record.taking_thread import TakingThread
from soliton_linkage_nodes.bags.record.writing_thread import WritingThread
from soliton_linkage_nodes.bags.rescue import take_over, unfinished_bag
from soliton_linkage_nodes.bags.services import Reply, serve, tell
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run

_LAST_STAMP = 2.0**31
"""Where the stamps of ROS end [s]."""


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of the recorder."""

    output: str = quantity(
        '', 'path of the bag, to which _0, _1, ... is added; empty for the date and time'
    )
    compression: str = quantity('none', 'compression of the chunks', choices=COMPRESSIONS)
    topics: tuple[str, ...] = quantity((), 'names of topics to record; empty for all of the suite')
    regex: str = quantity('', 'also record the topics whose full names contain this pattern')
    exclude_regex: str = quantity('', 'do not record topics whose full names contain this pattern')
    max_bag_size: int = quantity(0, 'size from which on a new file is begun, 0 for never', 'B', 0)
    max_bag_duration: float = quantity(
        0.0, 'time after which a new file is begun, 0 for never', 's', 0.0, _LAST_STAMP
    )
    snapshot_duration: float = quantity(
        0.0,
        'keep only the last seconds, and write them when ~/snapshot is called; 0 to record',
        's',
        0.0,
        3600.0,
    )
    sync_interval: float = quantity(
        1.0,
        'how often the disk is made to take what came, against a loss of power; 0 for never',
        's',
        0.0,
        3600.0,
    )
    append: bool = quantity(
        False,
        'whether to go on, in a new file, with the last bag of this output where its recorder '
        'was killed',
    )
    start_paused: bool = quantity(False, 'record nothing until ~/resume is called')


class BagRecorder(ManagedNode):
    """Records topics, raw, with the time at which each message was received.

    Subscribes to the topics recorded. Publishes `/diagnostics`. Serves, with the types of
    rosbag2_interfaces or std_srvs/Trigger, `~/pause`, `~/resume`, `~/is_paused`,
    `~/split_bagfile` and `~/snapshot`.

    One thread takes the messages from a hidden node, another does all that touches the bag.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {BagRecorderParameters: '', ManagedParameters: ''}

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('bag_recorder', **kwargs)

    def configure(self) -> None:
        """Create the bag and listen, but record nothing yet where a manager is to say when."""
        self._settings = settings = current(self, BagRecorderParameters)
        self._paused = settings.start_paused
        self._inbox = GuardedNode(
            '_bag_recorder_inbox',
            namespace=self.get_namespace(),
            context=self.context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        try:
            self._record(settings)
        except BaseException:
            self._inbox.destroy_node()
            raise
        self.get_logger().info(
            f'{self._bag.writer.path} is begun; finding all who publish, which takes 3 s'
        )
        for name in sorted(self._finder.awaited):
            self.get_logger().info(f'waiting for a publisher of {name}')

    def activate(self) -> None:
        """Record, unless it is paused."""
        if self._gate.paused and not self._paused:
            self._taking.resume()

    def deactivate(self) -> None:
        """Record nothing, with all that was taken in the hands of the system."""
        self._taking.settle()
        self._taking.pause()
        self._bag.flush()

    @property
    def lost(self) -> int:
        """Messages that were published and are not in the bag, pauses aside."""
        return sum(self._taking.losses.values())

    @property
    def messages(self) -> int:
        """Messages in the bag."""
        return self._bag.writer.messages

    @property
    def failure(self) -> Exception | None:
        """Why it cannot go on."""
        if not self.configured:
            return None
        return self._taking.failure or self._bag.failure

    def cleanup(self) -> None:
        """Take what has come, write it and finish the bag; raises OSError where it cannot."""
        self._bag.close(self._taking.stop())
        self._inbox.destroy_node()
        path = self._bag.writer.path
        said = f'closed {path}: {self.messages} messages, {self.lost} lost'
        if self._bag.failure is None:
            self.get_logger().info(said)
        failure = self._taking.failure or self._bag.failure
        if failure is not None:
            raise failure

    def _record(self, settings: BagRecorderParameters) -> None:
        self._finder = InletFinder(
            self._inbox, settings.topics, settings.regex, settings.exclude_regex
        )
        self._gate = MessageGate(settings.snapshot_duration, self._paused or not self.starting)
        self._bag = WritingThread(lambda: _create_writer(settings), real_time=self.real_time)
        try:
            self._taking = TakingThread(
                self._finder, self._gate, self._bag, self._announce, self.real_time
            )
            self.diagnostics = Diagnostics(self, 'recording', self.reporting(self._report))
            self._offer_services()
        except BaseException:
            self._bag.abandon()
            raise

    def _announce(self, missing: Sequence[str]) -> None:
        """Say that nothing of what is published from now on is missed."""
        writer = self._bag.writer
        without = f', without {", ".join(missing)}, whose publisher does not answer'
        self.get_logger().info(
            f'recording to {writer.path}{writer.gap}{without if missing else ""}'
        )

    def _offer_services(self) -> None:
        serve(self, 'pause', 'Pause', lambda _: self._pause())
        serve(self, 'resume', 'Resume', lambda _: self._resume())
        serve(self, 'split_bagfile', 'SplitBagfile', lambda _: self._split())
        serve(self, 'snapshot', 'Snapshot', lambda _: self._snapshot())
        tell(self, 'is_paused', 'IsPaused', 'paused', lambda: self._gate.paused)

    def _pause(self) -> Reply:
        self._paused = True
        self._taking.pause()
        return Reply('nothing is recorded until ~/resume')

    def _resume(self) -> Reply:
        self._paused = False
        latched = self._taking.resume()
        return Reply(f'recording goes on, with {latched} latched messages of the pause')

    def _split(self) -> Reply:
        self._bag.split()
        return Reply('the bag goes on in a new file')

    def _snapshot(self) -> Reply:
        duration = self._settings.snapshot_duration
        if not duration:
            raise ValueError(
                'snapshot_duration of bag_recorder = 0 keeps nothing; give it some seconds'
            )
        return Reply(f'{self._taking.snapshot()} messages of the last {duration:g} s are recorded')

    def _report(self) -> Report:
        lost, refused = self.lost, {**self._finder.refused, **self._bag.refused}
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
            'messages held back': self._gate.held,
            'topics heard': ' '.join(self._taking.heard),
        }
        return Report(
            state,
            {**figures, **{f'lost of {name}': n for name, n in self._taking.losses.items() if n}},
            warning=bool(lost or refused or self._finder.awaited),
        )


def _create_writer(settings: BagRecorderParameters) -> BagWriter:
    now = time.strftime('%Y_%m_%d-%H_%M_%S')
    name = Path(settings.output or f'recording_{now}')
    unfinished = unfinished_bag(name) if settings.append else None
    return BagWriter(
        name,
        settings.compression,
        settings.max_bag_size,
        settings.max_bag_duration,
        sync_interval=settings.sync_interval,
        begun=take_over(unfinished) if unfinished else None,
    )


def _finished(recorder: BagRecorder) -> bool:
    if recorder.failure is not None:
        raise recorder.failure
    return False


def main() -> None:
    """Run the recorder until it is told to stop."""
    run(BagRecorder, _finished)
