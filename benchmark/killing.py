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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
from processes import node_command
from rclpy.publisher import Publisher

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.recovery import recover_bag
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.child_processes import private_domain
from soliton_linkage_nodes.runtime.stamps import time_from_msg

ROTORS = 40
RATE = 1000.0
START_LIMIT = 60.0
LATEST_KILL = 2.5
POLL = 0.01
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
    arguments = parse_arguments()
    folder = arguments.output
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    chance = random.Random(arguments.seed)
    kills = []
    with Load(arguments.load) as load:
        for number in range(arguments.kills):
            given = {
                'output': folder / str(number) / 'run',
                'real_time': str(arguments.real_time).lower(),
            }
            command = list(map(str, node_command('bag_recorder', given)))
            kill = killed(command, folder / str(number), chance.uniform(0, LATEST_KILL), load)
            kills.append(kill)
            print(f'{number}: {described(kill)}', flush=True)
    print(summary(kills, arguments.load))
    sys.exit(0 if max(kill.lost for kill in kills) < MOST_LOST else 1)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--kills', type=int, default=50, help='(%(default)s)')
    parser.add_argument('--load', type=int, default=0, help='busy processes (%(default)s)')
    parser.add_argument(
        '--real-time', action='store_true', help='request real-time priority for the recorder'
    )
    parser.add_argument('--seed', type=int, default=1, help='(%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('out/benchmark/killing'))
    return parser.parse_args()


def described(kill: Kill) -> str:
    return (
        f'killed after {kill.after:.3f} s: lost the last {kill.lost:.3f} s and the first '
        f'{kill.begun:.3f} s; the transport of the last message took {kill.received:.3f} s'
    )


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


class Load:
    """Processes that use all processors, except while they pause."""

    def __init__(self, number: int) -> None:
        self._processes = [
            subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(number)
        ]
        self.pause()

    def __enter__(self) -> Load:
        return self

    def __exit__(self, *_of_error: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def pause(self) -> None:
        """Pause all processes."""
        self._signal(signal.SIGSTOP)

    def work(self) -> None:
        """Continue all processes."""
        self._signal(signal.SIGCONT)

    def _signal(self, number: signal.Signals) -> None:
        for process in self._processes:
            process.send_signal(number)


@dataclass
class Stream:
    """Thread that publishes joint states at a rate until it is stopped."""

    publisher: Publisher
    stamps: list[int] = field(default_factory=list)
    """Stamps of the published messages [ns]."""
    _stopping: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Stream:
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_of_error: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Stop publishing."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        named = NamedChain(Chain(number_of_rotors=ROTORS), default_joint_names(ROTORS))
        buffer, zeros = JointStateBuffer(named), np.zeros(ROTORS)
        start = time.monotonic()
        while not self._stopping.is_set():
            stamp = time.time_ns()
            self.publisher.publish(buffer.write(stamp, zeros, zeros, zeros))
            self.stamps.append(stamp)
            time.sleep(max(0.0, start + len(self.stamps) / RATE - time.monotonic()))


@contextmanager
def lone_publisher() -> Iterator[Publisher]:
    """Yield a publisher on a new domain, because DDS removes killed subscribers late."""
    with private_domain():
        context = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node('killer', context=context)
        topic = interfaces.JOINT_STATES
        try:
            yield node.create_publisher(topic.type, topic.name, topic.qos)
        finally:
            node.destroy_node()
            rclpy.shutdown(context=context)


def killed(command: Sequence[str], folder: Path, after: float, load: Load) -> Kill:
    """Kill a recorder at a time after its log line [s], and return its losses."""
    load.pause()
    bag = folder / 'run_0'
    with (
        lone_publisher() as publisher,
        Stream(publisher) as stream,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as recorder,
    ):
        wait_for(bag, recorder)
        load.work()
        line = next(line for line in recorder.stderr or () if 'recording to' in line)
        announced = time.time_ns()
        time.sleep(after)
        recorder.kill()
        at = time.time_ns()
        stream.stop()
        load.pause()
    if not line:
        raise RuntimeError('the recorder did not start')
    return losses_of(
        bag, folder / 'recovered', [s for s in stream.stamps if s < at], announced, at
    )


def wait_for(path: Path, recorder: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + START_LIMIT
    while not path.exists():
        if time.monotonic() > deadline or recorder.poll() is not None:
            raise TimeoutError(f'no {path} after {START_LIMIT:g} s')
        time.sleep(POLL)


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
