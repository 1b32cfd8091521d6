# SPDX-License-Identifier: Apache-2.0
"""A slow disk loses no message; a full disk loses no written message."""

import os
import resource
import subprocess
import threading

import pytest
from recordings import messages_of, publish_frames

from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.record.writing_thread import (
    ReceivedMessage,
    RecordedTopic,
    WritingThread,
)
from soliton_linkage_nodes.runtime import interfaces

NUDGES = RecordedTopic('/nudge', 'std_msgs/msg/Float64', (interfaces.NUDGE.qos,))


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 3 MB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=3m', 'tmpfs', str(disk)]
    if os.geteuid() or subprocess.run(mount, check=False).returncode:
        pytest.skip('needs a small disk: run as root, or in a privileged container')
    yield disk
    subprocess.run(['umount', str(disk)], check=True)


def test_a_full_disk_ends_it_with_one_line(graph, start, named, tmp_path):
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


@pytest.mark.parametrize('largest', [0, 100_000])
def test_messages_on_a_full_disk_can_be_read(small_disk, largest):
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
    assert failed.endswith(f'; choose another output; the {len(held)} earlier messages are kept')


@pytest.mark.parametrize(('room', 'kept'), [(1000, 10), (10_000, 100)])
def test_messages_wait_for_a_stalled_disk_and_are_counted_as_lost_beyond_the_limit(
    tmp_path, room, kept
):
    gate = threading.Event()

    class StalledDisk(BagWriter):
        def split(self) -> None:
            gate.wait()

    thread = WritingThread(lambda: StalledDisk(tmp_path / 'run'), most_waiting=room)
    thread.post(thread.writer.split)
    sent = [number.to_bytes(100, 'big') for number in range(100)]
    for number, message in enumerate(sent):
        thread.put([ReceivedMessage(NUDGES, number, message)])
    gate.set()
    thread.close({})
    assert thread.dropped['/nudge'] == 100 - kept
    assert messages_of(tmp_path / 'run_0')['/nudge'] == sent[:kept]
