# SPDX-License-Identifier: Apache-2.0
"""How much a recorder that is killed loses, at random instants while it records at 1000 Hz.

A recorder runs as a process of its own; this one publishes joint states, kills it, recovers the
bag and compares what came back with what was sent.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import domain_coordinator
import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.publisher import Publisher

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.bags.read.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.rescue.bag_rescue import recover_bag
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.messages.conversions import NamedChain, default_joint_names
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg

ROTORS = 40
RATE = 1000.0
LONGEST_START = 30.0


def main() -> None:
    arguments = parse_arguments()
    folder = arguments.output
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    chance = random.Random(arguments.seed)
    worst = 0.0
    for number in range(arguments.kills):
        storage = ('mcap', 'sqlite3')[number % 2]
        with lone_publisher() as publisher:
            lost = lost_by_a_kill(publisher, folder / str(number), storage, chance)
        worst = max(worst, lost)
        print(f'{number} {storage}: lost the last {lost:.3f} s', flush=True)
    print(f'{arguments.kills} kills, at most {worst:.3f} s lost')
    sys.exit(0 if worst < 1.0 else 1)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--kills', type=int, default=50, help='(%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='(%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('out/benchmark/killing'))
    return parser.parse_args()


@contextmanager
def lone_publisher() -> Iterator[Publisher]:
    """A publisher on a domain where no recorder was killed before: the dead are long missed."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
    with domain_coordinator.domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        context = rclpy.Context()
        rclpy.init(context=context)
        node = rclpy.create_node('killer', context=context)
        topic = interfaces.JOINT_STATES
        try:
            yield node.create_publisher(topic.type, topic.name, topic.qos)
        finally:
            node.destroy_node()
            rclpy.shutdown(context=context)


def lost_by_a_kill(
    publisher: Publisher, folder: Path, storage: str, chance: random.Random
) -> float:
    """Time before the kill of which nothing came back [s]."""
    executable = Path(get_package_prefix('soliton_linkage_nodes'), 'lib/soliton_linkage_nodes')
    given = ['-p', f'output:={folder / "run"}', '-p', f'storage:={storage}']
    with subprocess.Popen(
        [executable / 'bag_recorder', '--ros-args', *given], stderr=subprocess.DEVNULL
    ) as recorder:
        deadline = time.monotonic() + LONGEST_START
        while publisher.get_subscription_count() != 1:
            if time.monotonic() > deadline:
                raise TimeoutError(f'no recorder after {LONGEST_START:g} s')
            time.sleep(0.01)
        sent = publish(publisher, chance.uniform(0.3, 2.5))
        recorder.kill()
    _, bag = recover_bag(folder / 'run_0', folder / 'recovered')
    with open_bag(bag) as reader:
        stamps = [time_from_msg(m.header.stamp) for _, m in read_topic(reader, 'joint_states')]
    # What was sent before the recorder had met the publisher does not count.
    met = sent.index(stamps[0]) if stamps else 0
    if stamps != sent[met : met + len(stamps)]:
        raise AssertionError(f'{bag} is not what was sent, up to some instant')
    return (sent[-1] - (stamps[-1] if stamps else sent[0])) * 1e-9


def publish(publisher: Publisher, seconds: float) -> list[int]:
    """Publish at the rate until the time is over, and return the stamps [ns]."""
    named = NamedChain(Chain(number_of_rotors=ROTORS), default_joint_names(ROTORS))
    buffer, zeros = JointStateBuffer(named), np.zeros(ROTORS)
    start, stamps = time.monotonic(), []
    while time.monotonic() < start + seconds:
        stamps.append(time.time_ns())
        publisher.publish(buffer.write(stamps[-1], zeros, zeros, zeros))
        time.sleep(max(0.0, start + len(stamps) / RATE - time.monotonic()))
    return stamps


if __name__ == '__main__':
    main()
