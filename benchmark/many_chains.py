# SPDX-License-Identifier: Apache-2.0
"""Cost of the analysers of many chains, in one process per chain and in a common process.

This process publishes the same kicked chain in several namespaces and receives all states. The
table contains processor time and memory of the analysers, and the number of missing states.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import processes
import rclpy
from rclpy.node import Node
from wall_bag import named_chain

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode
from soliton_linkage.linkage.recording import Recording
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg

KICK = 10.0
SETTLING = 5.0
MEBIBYTE = 2**20


class Chains:
    """Chains with the same motion in different namespaces, and their received states."""

    def __init__(
        self, node: Node, named: NamedChain, moved: Recording, period: int, chains: int
    ) -> None:
        self._moved, self._buffer = moved, JointStateBuffer(named)
        self._frame, self._stamp, self._period = 0, time.time_ns(), period
        chain, joints, states = interfaces.CHAIN, interfaces.JOINT_STATES, interfaces.SOLITON_STATE
        self._latched, self._joints = (
            [
                node.create_publisher(topic.type, f'{name(n)}/{topic.name}', topic.qos)
                for n in range(chains)
            ]
            for topic in (chain, joints)
        )
        names = [f'{name(n)}/{states.name}' for n in range(chains)]
        self._answers = [processes.raw_subscription(node, states, each) for each in names]
        for publisher in self._latched:
            publisher.publish(chain_to_msg(named, time_to_msg(0)))

    def publish(self, seconds: float) -> tuple[int, int]:
        """Publish frames for a time [s]; return the numbers of frames and received states."""
        begin, sent, answered = time.monotonic(), 0, 0
        for frame in range(round(seconds * SECOND / self._period)):
            time.sleep(max(0.0, begin + frame * self._period / SECOND - time.monotonic()))
            now = self._frame % len(self._moved.angles)
            angles, rates = self._moved.angles[now], self._moved.rates[now]
            stamp = self._stamp + self._frame * self._period
            message = bytes(self._buffer.fill(stamp, angles, rates, 0 * angles))
            for publisher in self._joints:
                publisher.publish(message)
            self._frame += 1
            sent += len(self._joints)
            answered += self._taken()
        time.sleep(1.0)
        return sent, answered + self._taken()

    @property
    def ready(self) -> bool:
        """Whether every chain has an analyser that has received the parameters of the chain."""
        return self.subscribed and all(answer.get_publisher_count() for answer in self._answers)

    @property
    def subscribed(self) -> bool:
        """Whether the joint states of every chain have a subscriber."""
        return all(publisher.get_subscription_count() for publisher in self._joints)

    def _taken(self) -> int:
        return sum(len(processes.take_all(answer)) for answer in self._answers)


def kicked_parser(description: str | None, **defaults: float) -> argparse.ArgumentParser:
    """Return a parser with the options `rotors`, `rate` [Hz], `seconds` and `rounds`."""
    parser = argparse.ArgumentParser(description=description)
    for option, default in defaults.items():
        parser.add_argument(
            f'--{option}', type=type(default), default=default, help='(%(default)s)'
        )
    return parser


def kicked(arguments: argparse.Namespace) -> tuple[NamedChain, Recording]:
    """Return a flipper chain and its motion after a kick at the first edge."""
    named = named_chain(arguments.rotors)
    rest = named.chain.uniform_state(-1)
    rates = KICK * edge_mode(named.chain, rest, Edge.FIRST)
    duration = math.ceil(arguments.seconds + 2 * SETTLING)
    return named, simulate(named.chain, rest, rates, duration, 1 / arguments.rate)


def name(number: int) -> str:
    return f'/chain_{number}'


@contextmanager
def analysers(chains: int, together: bool) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Start the processes that analyse a number of chains."""
    names = [f'{name(n)}/soliton_analyser' for n in range(chains)]
    one = [[processes.node_command('suite', {})[0], *names]]
    each = [
        [*processes.node_command('soliton_analyser', {}), '-r', f'__ns:={name(n)}']
        for n in range(chains)
    ]
    with ExitStack() as stack:
        yield [
            stack.enter_context(processes.running(command))
            for command in (one if together else each)
        ]


def memory(process: int) -> tuple[float, float]:
    """Return the resident and the proportional memory of a process [MB]."""
    text = Path(f'/proc/{process}/smaps_rollup').read_text(encoding='ascii')
    entries = dict(line.split(':') for line in text.splitlines()[1:])
    resident, shared = (int(entries[key].split()[0]) * 1024 / MEBIBYTE for key in ('Rss', 'Pss'))
    return resident, shared


def measure(
    node: Node, named: NamedChain, moved: Recording, arguments: Any, together: bool
) -> Sequence[float]:
    """Return processor load [cores], resident and unshared memory [MB], and missing states."""
    period = round(SECOND / arguments.rate)
    chains = Chains(node, named, moved, period, arguments.chains)
    with analysers(arguments.chains, together) as started:
        processes.until(lambda: chains.ready, 'analyser of each chain')
        chains.publish(SETTLING)
        before = [processes.processor_time(process.pid) for process in started]
        begin = time.monotonic()
        sent, answered = chains.publish(arguments.seconds)
        took = time.monotonic() - begin
        used = sum(processes.processor_time(p.pid) for p in started) - sum(before)
        sizes = [memory(process.pid) for process in started]
    return used / took, *map(sum, zip(*sizes, strict=True)), sent - answered


def main() -> None:
    parser = kicked_parser(__doc__, rotors=40, rate=100.0, seconds=20.0, rounds=3)
    parser.add_argument('--chains', type=int, default=10)
    arguments = parser.parse_args()
    named, moved = kicked(arguments)
    print('| processes | cores | resident [MB] | unshared [MB] | states lost |')
    print('| --- | --- | --- | --- | --- |')
    with processes.own_domain():
        for _ in range(arguments.rounds):
            for together in (False, True):
                node = rclpy.create_node('many_chains')
                cores, resident, alone, lost = measure(node, named, moved, arguments, together)
                count = 1 if together else arguments.chains
                print(f'| {count} | {cores:.3f} | {resident:.0f} | {alone:.0f} | {lost} |')
                node.destroy_node()


if __name__ == '__main__':
    main()
