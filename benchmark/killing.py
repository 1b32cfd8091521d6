# SPDX-License-Identifier: Apache-2.0
"""Losses of recorders that are killed at random times after their log line `recording to`.

This process publishes joint states at 1000 Hz beside a number of busy processes, kills the
recorder with SIGKILL, recovers the bag, and compares the messages. The busy processes pause while
the recorder starts. With --real-time the recorder requests real-time priority.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from processes import node_command, own_domain, until
from rclpy.publisher import Publisher
from wall_bag import named_chain

from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.recovery import recover_bag
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg

ROTORS = 40
RATE = 1000.0
LATEST_KILL = 2.5
MOST_LOST = 1.0


@dataclass(frozen=True)
class Kill:
    """Losses of one recorder [s]."""

    after: float
    """Time from the line `recording to` to the kill."""
    lost: float
    """Duration without recovered messages before the kill."""
    begun: float
    """Duration without recovered messages after the line `recording to`."""
    received: float
    """Transport time of the last recovered message."""
    empty: bool
    """Whether no message was recovered."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default, about in (
        ('kills', 50, ''),
        ('load', 0, 'busy processes '),
        ('seed', 1, ''),
    ):
        parser.add_argument(f'--{name}', type=int, default=default, help=f'{about}(%(default)s)')
    about = 'request real-time priority for the recorder'
    parser.add_argument('--real-time', action='store_true', help=about)
    parser.add_argument('--output', type=Path, default=Path('out/benchmark/killing'))
    arguments = parser.parse_args()
    folder = arguments.output
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    chance = random.Random(arguments.seed)
    kills = []
    with busy_processes(arguments.load) as send:
        for number in range(arguments.kills):
            given = {
                'output': folder / str(number) / 'run',
                'real_time': str(arguments.real_time).lower(),
            }
            command = list(map(str, node_command('bag_recorder', given)))
            kill = killed(command, folder / str(number), chance.uniform(0, LATEST_KILL), send)
            kills.append(kill)
            print(
                f'{number}: killed after {kill.after:.3f} s: lost the last {kill.lost:.3f} s and '
                f'the first {kill.begun:.3f} s; the transport of the last message took '
                f'{kill.received:.3f} s',
                flush=True,
            )
    print(summary(kills, arguments.load))
    sys.exit(0 if max(kill.lost for kill in kills) < MOST_LOST else 1)


def summary(kills: Sequence[Kill], load: int) -> str:
    lost = sorted(kill.lost for kill in kills)
    empty = sum(kill.empty for kill in kills)
    begun = sum(kill.begun > 0 for kill in kills)
    return (
        f'{len(kills)} kills with {load} busy processes: loss {statistics.median(lost):.3f} s '
        f'(median), {lost[int(0.9 * (len(lost) - 1))]:.3f} s (90th percentile), '
        f'{lost[-1]:.3f} s (largest); {empty} empty bags, {begun} '
        f'without the first message after "recording to"'
    )


@contextmanager
def busy_processes(number: int) -> Iterator[Callable[[signal.Signals], None]]:
    """Start processes that use all processors; yield a function that sends a signal to them."""
    command = [sys.executable, '-c', 'while True: pass']
    processes = [subprocess.Popen(command) for _ in range(number)]

    def send(signal_number: signal.Signals) -> None:
        for process in processes:
            process.send_signal(signal_number)

    send(signal.SIGSTOP)
    try:
        yield send
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextmanager
def published_stamps() -> Iterator[list[int]]:
    """Publish joint states at a rate in a thread; yield the stamps of the messages [ns].

    The publisher has a new domain, because DDS removes killed subscribers late.
    """
    stamps: list[int] = []
    stopping = threading.Event()
    buffer, zeros = JointStateBuffer(named_chain(ROTORS)), np.zeros(ROTORS)

    def publish(publisher: Publisher) -> None:
        start = time.monotonic()
        while not stopping.is_set():
            stamp = time.time_ns()
            publisher.publish(bytes(buffer.fill(stamp, zeros, zeros, zeros)))
            stamps.append(stamp)
            time.sleep(max(0.0, start + len(stamps) / RATE - time.monotonic()))

    with own_domain():
        node = rclpy.create_node('killer')
        publisher = interfaces.JOINT_STATES.publisher(node)
        thread = threading.Thread(target=publish, args=(publisher,))
        thread.start()
        try:
            yield stamps
        finally:
            stopping.set()
            thread.join()
            node.destroy_node()


def killed(
    command: Sequence[str], folder: Path, after: float, send: Callable[[signal.Signals], None]
) -> Kill:
    """Kill a recorder at a time after its log line [s], and return its losses.

    `send` sends a signal to the busy processes.
    """
    bag = folder / 'run_0'
    with (
        published_stamps() as stamps,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder,
    ):
        until(bag.exists, str(bag), recorder)
        send(signal.SIGCONT)
        assert recorder.stderr is not None
        if not any('recording to' in line for line in recorder.stderr):
            raise RuntimeError('the recorder did not start')
        announced = time.time_ns()
        time.sleep(after)
        recorder.kill()
        at = time.time_ns()
        send(signal.SIGSTOP)
    sent = [stamp for stamp in stamps if stamp < at]
    return losses_of(bag, folder / 'recovered', sent, announced, at)


def losses_of(bag: Path, recovered: Path, sent: Sequence[int], announced: int, at: int) -> Kill:
    """Return the losses, given the times of the line `recording to` and of the kill [ns]."""
    held = recovered_stamps(bag, recovered)
    stamps = [stamp for stamp, _ in held]
    first_index = sent.index(stamps[0]) if stamps else 0
    if stamps != sent[first_index : first_index + len(stamps)]:
        raise AssertionError(f'{bag} is not a contiguous part of the published messages')
    # Messages that were published before the line `recording to` are not losses.
    last = max(stamps[-1], announced) if stamps else announced
    first = next((stamp for stamp in sent if stamp >= announced), at)
    return Kill(
        after=(at - announced) * 1e-9,
        lost=max(0, sent[-1] - last) * 1e-9,
        begun=max(0, (stamps[0] if stamps else at) - first) * 1e-9,
        received=(held[-1][1] - held[-1][0]) * 1e-9 if held else 0.0,
        empty=not held,
    )


def recovered_stamps(bag: Path, recovered: Path) -> list[tuple[int, int]]:
    """Return the times of publication and receipt of each recovered message [ns]."""
    try:
        _, new = recover_bag(bag, recovered)
    except ValueError as error:
        print(error)
        return []
    with open_bag(new) as reader:
        return [(time_from_msg(m.header.stamp), r) for r, m in read_topic(reader, 'joint_states')]


if __name__ == '__main__':
    main()
