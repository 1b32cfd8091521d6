# SPDX-License-Identifier: Apache-2.0
"""Processor time of each node per frame of joint states.

This process publishes the frames of a kicked chain to one node after the other. The simulator
publishes to a number of subscribers. The table contains, per frame, the processor time of the
process, the processor time of the thread that runs the callbacks, and the number of waits.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import processes
import rclpy
from many_chains import SETTLING, Chains, kicked, kicked_parser, name

from soliton_linkage.linkage.recording import Recording
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND

FOLDER = Path(__file__).parent
NODES = (
    *('listener', 'soliton_analyser', 'soliton_steering', 'edge_actuator', 'chain_identifier'),
    *('visualisation', 'live_view', 'bag_recorder'),
)


@dataclass(frozen=True)
class Spent:
    """Processor time of a process and of its first thread [s], and number of waits."""

    processor: float
    first: float
    waits: int

    def __sub__(self, before: Spent) -> Spent:
        return Spent(
            self.processor - before.processor, self.first - before.first, self.waits - before.waits
        )


def spent(process: int) -> Spent:
    """Return the totals of all threads of a process."""
    times, waits = {}, 0
    for task in Path(f'/proc/{process}/task').iterdir():
        # Time on the processor [ns], time in its queue [ns], number of times that it ran.
        times[task.name] = int((task / 'schedstat').read_text(encoding='ascii').split()[0])
        status = (task / 'status').read_text(encoding='ascii')
        waits += int(status.partition('\nvoluntary_ctxt_switches:')[2].split()[0])
    first = times[str(process)] / SECOND
    return Spent(sum(times.values()) / SECOND, first, waits)


@contextmanager
def node_process(which: str) -> Iterator[int]:
    """Start a node that subscribes to the chain; yield the number of its process."""
    with tempfile.TemporaryDirectory() as folder:
        settings: Mapping[str, Any] = {
            'bag_recorder': {'output': Path(folder, 'bag')},
            'live_view': {'port': 18_779},
        }.get(which, {})
        command = [*processes.node_command(which, settings), '-r', f'__ns:={name(0)}']
        if which == 'listener':
            command = processes.program_command(FOLDER / 'listener.py', f'{name(0)}/joint_states')
        with processes.running(command) as process:
            yield process.pid


def of_node(which: str, named: NamedChain, moved: Recording, arguments: Any) -> tuple[Spent, int]:
    """Publish frames to a node; return its cost and the number of frames."""
    node = rclpy.create_node('cost')
    chains = Chains(node, named, moved, round(SECOND / arguments.rate), 1)
    with node_process(which) as process:
        processes.until(lambda: chains.subscribed, f'subscription of {which}')
        chains.publish(SETTLING)
        before = spent(process)
        frames, _ = chains.publish(arguments.seconds)
        taken = spent(process) - before
    node.destroy_node()
    return taken, frames


def of_simulator(listeners: int, arguments: Any) -> tuple[Spent, int]:
    """Return the cost of a simulator with `listeners` subscribers, and the number of frames."""
    settings = {
        'chain.number_of_rotors': arguments.rotors,
        'publish_rate': float(arguments.rate),
        'initial_state': 'soliton',
        'initial_position': 2.0,
        'initial_velocity': 0.3,
        'integrator': arguments.integrator,
        'subscribers': listeners,
    }
    listener = processes.program_command(FOLDER / 'listener.py', interfaces.JOINT_STATES.name)
    with ExitStack() as stack:
        for _ in range(listeners):
            stack.enter_context(processes.running(listener))
        simulator = stack.enter_context(
            processes.running(processes.node_command('simulator', settings))
        )
        frame()
        time.sleep(SETTLING)
        begun, before = frame(), spent(simulator.pid)
        time.sleep(arguments.seconds)
        ended, after = frame(), spent(simulator.pid)
        return after - before, ended - begun


def frame() -> int:
    """Return the number of the frame that is published now."""
    node = rclpy.create_node('cost')
    inbox = processes.raw_subscription(node, interfaces.JOINT_STATES)
    _, info = processes.until(lambda: processes.take_all(inbox), 'joint_states')[0]
    node.destroy_node()
    return info['publication_sequence_number']


def row(what: str, taken: Spent, frames: int) -> str:
    each, first = (1e6 * seconds / frames for seconds in (taken.processor, taken.first))
    return f'| {what} | {each:.0f} | {first:.0f} | {taken.waits / frames:.2f} |'


def main() -> None:
    parser = kicked_parser(__doc__, rotors=100, rate=1000.0, seconds=5.0, rounds=1)
    parser.add_argument('--nodes', nargs='*', choices=NODES, default=NODES)
    parser.add_argument('--listeners', type=int, nargs='*', default=[0, 1, 6])
    parser.add_argument('--integrator', default='symplectic', help='integrator of the simulator')
    arguments = parser.parse_args()
    named, moved = kicked(arguments)
    print('| node | processor time per frame [µs] | first thread [µs] | waits per frame |')
    print('| --- | --- | --- | --- |')
    with processes.own_domain():
        for _ in range(arguments.rounds):
            for which in arguments.nodes:
                print(row(which, *of_node(which, named, moved, arguments)), flush=True)
            for listeners in arguments.listeners:
                work = f'simulator, {listeners} subscribers'
                print(row(work, *of_simulator(listeners, arguments)), flush=True)


if __name__ == '__main__':
    main()
