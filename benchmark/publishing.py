# SPDX-License-Identifier: Apache-2.0
"""What the simulator's publishing costs and how well it keeps its deadlines.

A simulator with a soliton on its way runs as a process of its own; this one takes every message,
counts the gaps, and reads the other's processor time from the kernel. Before that, a loop that
does nothing but sleep until each deadline shows what the machine itself makes of them.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import domain_coordinator
import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.chain import Chain
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.conversions import NamedChain, default_joint_names, impulses_to_msg
from soliton_linkage_nodes.sequence_gaps import SequenceGaps

NUDGE = 10.0
POLL = 0.005
SETTLING = 3.0
SLEEPING = 10.0


def main() -> None:
    arguments = parse_arguments()
    idle = share_missed_by_a_loop_that_sleeps(arguments.rate)
    with domain_coordinator.domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        rclpy.init()
        simulator = start_simulator(arguments.rotors, arguments.rate)
        try:
            figures = measure(simulator.pid, arguments)
        finally:
            simulator.send_signal(signal.SIGINT)
            simulator.wait()
            rclpy.try_shutdown()
    report({**figures, 'share_missed_by_sleeping': idle}, arguments.output)


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rotors', type=int, default=40, help='(%(default)s)')
    parser.add_argument('--rate', type=float, default=1000.0, help='in Hz (%(default)s)')
    parser.add_argument('--seconds', type=float, default=60.0, help='(%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('out/benchmark/publishing.json'))
    return parser.parse_args()


def share_missed_by_a_loop_that_sleeps(rate: float) -> float:
    ticks = round(SLEEPING * rate)
    start, missed = time.monotonic(), 0
    for tick in range(ticks):
        time.sleep(max(0.0, start + tick / rate - time.monotonic()))
        missed += time.monotonic() - start > (tick + 1) / rate
    return missed / ticks


def start_simulator(rotors: int, rate: float) -> subprocess.Popen[bytes]:
    folder = Path(get_package_prefix('soliton_linkage_nodes'), 'lib', 'soliton_linkage_nodes')
    settings = {'chain.number_of_rotors': rotors, 'publish_rate': rate}
    arguments = [part for pair in settings.items() for part in ('-p', '{}:={}'.format(*pair))]
    return subprocess.Popen([str(folder / 'simulator'), '--ros-args', *arguments])


def measure(process: int, arguments: argparse.Namespace) -> dict[str, float]:
    node = rclpy.create_node('benchmark')
    subscriptions = [
        node.create_subscription(topic.type, topic.name, lambda _: None, topic.qos, raw=True)
        for topic in (interfaces.JOINT_STATES, interfaces.DIAGNOSTICS)
    ]
    kick(node, Chain(number_of_rotors=arguments.rotors))
    drain(subscriptions, SETTLING)
    before = drain(subscriptions, 1.5)[1]
    start, cpu_start = time.monotonic(), processor_time(process)
    progress = ProgressLine(f'{arguments.rotors} rotors at {arguments.rate:g} Hz', 1.0)
    infos, after = drain(subscriptions, arguments.seconds, progress)
    elapsed, cpu = time.monotonic() - start, processor_time(process) - cpu_start
    progress.end(f'measured for {elapsed:.0f} s')
    gaps = SequenceGaps()
    for info in infos:
        gaps.take(info['publication_sequence_number'], 1)
    published = np.array([info['source_timestamp'] for info in infos]) * 1e-9
    period = np.diff(published)
    return {
        'rotors': arguments.rotors,
        'rate_hz': arguments.rate,
        'seconds': elapsed,
        'messages': len(infos),
        'messages_not_received': gaps.lost,
        'measured_rate_hz': 1 / float(np.mean(period)),
        'missed_deadlines': after['missed deadlines'] - before['missed deadlines'],
        'share_missed': (after['missed deadlines'] - before['missed deadlines']) / len(infos),
        'period_p50_ms': 1e3 * float(np.percentile(period, 50)),
        'period_p99_ms': 1e3 * float(np.percentile(period, 99)),
        'period_max_ms': 1e3 * float(np.max(period)),
        'share_of_a_core': cpu / elapsed,
        'energy_drift': after['energy drift'],
    }


def kick(node: Node, chain: Chain) -> None:
    topic = interfaces.ROTOR_IMPULSES
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    while not publisher.get_subscription_count():
        time.sleep(POLL)
    mode = edge_mode(chain, chain.uniform_state(-1), Edge.FIRST)
    named = NamedChain(chain, default_joint_names(chain.number_of_rotors))
    impulses = NUDGE * chain.moment_of_inertia * mode
    publisher.publish(impulses_to_msg(named, impulses, node.get_clock().now().to_msg()))


def drain(
    subscriptions: list, seconds: float, progress: ProgressLine | None = None
) -> tuple[list[dict[str, int]], dict[str, float]]:
    """Take messages for a while; return what is known of each frame, and the last report."""
    frames, figures = [], {}
    start = time.monotonic()
    while (elapsed := time.monotonic() - start) < seconds or not figures:
        for subscription in subscriptions:
            handle = subscription.handle
            with handle:
                while (taken := handle.take_message(subscription.msg_type, True)) is not None:
                    if subscription is subscriptions[0]:
                        frames.append(taken[1])
                    else:
                        figures = figures_of(deserialize_message(taken[0], DiagnosticArray))
        if progress is not None:
            progress.show(elapsed / seconds)
        time.sleep(POLL)
    return frames, figures


def figures_of(message: DiagnosticArray) -> dict[str, float]:
    wanted = ('missed deadlines', 'energy drift')
    pairs = message.status[0].values
    return {pair.key: float(pair.value) for pair in pairs if pair.key in wanted}


def processor_time(process: int) -> float:
    fields = Path(f'/proc/{process}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def report(figures: dict[str, float], output: Path) -> None:
    for name, value in figures.items():
        sys.stdout.write(f'{name:24}{value:>14.6g}\n')
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps(figures, indent=2) + '\n', encoding='utf-8')
    sys.stdout.write(f'written to {output}\n')


if __name__ == '__main__':
    main()
