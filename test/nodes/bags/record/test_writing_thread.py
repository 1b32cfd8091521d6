# SPDX-License-Identifier: Apache-2.0
"""A slow disk loses no message; a full disk loses no written message."""

from __future__ import annotations

import os
import resource
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from graphs import Graph
from programs import Program
from rclpy.serialization import serialize_message
from recordings import frame_message, lost_in, messages_of, publish_frames

from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.record.writing_thread import (
    ReceivedMessage,
    RecordedTopic,
    WritingThread,
)
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces

NUDGES = RecordedTopic('/nudge', 'std_msgs/msg/Float64', (interfaces.NUDGE.qos,))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=3m', 'tmpfs', str(disk)]
    if os.geteuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip('a small disk can be mounted by root only')
    yield disk
    subprocess.run(['umount', str(disk)], check=True)


def test_a_full_disk_ends_it_with_one_line(
    graph: Graph,
    start: Callable[..., Program],
    named: NamedChain,
    tmp_path: Path,
) -> None:
    bag = tmp_path / 'run'
    program = start('bag_recorder', '--ros-args', '-p', f'output:={bag}')
    publisher = graph.speak(interfaces.JOINT_STATES)
    graph.next_report('bag_recorder')
    limits = (200_000, 200_000)
    resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE, limits)

    def ended() -> bool:
        publish_frames(publisher, named, 200)
        return program.process.poll() is not None

    graph.until(ended, 'the end of the recorder')
    assert program.process.returncode == 1
    begun, *told, failed = program.said
    assert f'created {bag}_0; ' in begun
    assert all(line.endswith(f'recording to {bag}_0') for line in told[:1])
    assert len(told) <= 1
    assert f"bag '{bag}_0' cannot be written: " in failed
    assert 'choose another output; ' in failed


def test_a_disk_that_stalls_for_two_seconds_loses_nothing(
    graph: Graph, named: NamedChain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = BagWriter.write_all
    stalled = threading.Event()

    def stalling(*arguments: Any) -> None:
        if not stalled.is_set():
            stalled.set()
            time.sleep(2.0)
        write(*arguments)

    monkeypatch.setattr(BagWriter, 'write_all', stalling)
    given = {'output': str(tmp_path / 'run'), 'topics': ['joint_states']}
    recorder = graph.start(BagRecorder, given)
    publisher = graph.speak(interfaces.JOINT_STATES)
    sent = [serialize_message(frame_message(named, number)) for number in range(2000)]
    begin = time.monotonic()
    for number, message in enumerate(sent):
        publisher.publish(message)
        time.sleep(max(0.0, begin + number / 1000 - time.monotonic()))
    assert stalled.is_set()
    graph.stop(recorder)
    assert messages_of(tmp_path / 'run_0')['/joint_states'] == sent
    assert lost_in(tmp_path / 'run_0') == {'/joint_states': 0}


@pytest.mark.parametrize('largest', [0, 100_000])
def test_what_a_full_disk_took_can_be_read(small_disk: Path, largest: int) -> None:
    bag = small_disk / 'run'
    thread = WritingThread(lambda: BagWriter(bag, largest_file=largest, flush_interval=0.0))
    sent: list[bytes] = []
    while thread.failure is None:
        messages = [ReceivedMessage(NUDGES, len(sent) + n, os.urandom(100)) for n in range(100)]
        sent += [message.serialized for message in messages]
        thread.put(messages)
    thread.close({})
    held = messages_of(small_disk / 'run_0')['/nudge']
    assert len(held) > 1000
    assert held == sent[: len(held)]
    failed = str(thread.failure)
    assert f"bag '{bag}_0' cannot be written: " in failed
    assert 'full' in failed or 'No space left' in failed
    assert failed.endswith(f'; choose another output; the {len(held)} messages before are kept')


def test_messages_are_told_lost_that_a_slow_disk_leaves_no_room_for(
    named: NamedChain, tmp_path: Path
) -> None:
    gate = threading.Event()

    class SlowDisk(BagWriter):
        def split(self) -> None:
            gate.wait()

    thread = WritingThread(lambda: SlowDisk(tmp_path / 'run'), most_waiting=1000)
    thread.split()
    for number in range(100):
        thread.put([ReceivedMessage(NUDGES, number, bytes(100))])
    gate.set()
    thread.close({})
    assert thread.dropped == {'/nudge': 90}
    assert len(messages_of(tmp_path / 'run_0')['/nudge']) == 10
