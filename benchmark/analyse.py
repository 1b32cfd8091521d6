# SPDX-License-Identifier: Apache-2.0
"""Cost of analysing frames: the analyser node compared with a tanh fit by scipy's curve_fit.

Both receive the same serialised joint states and publish a SolitonState per frame. The joint
states have velocities and a noise of 0.01 rad; they show a wall in mid-chain of a flipper. The
states are counted, and their positions are compared with the true positions. Then the analyser
runs in a separate process at 1000 Hz. Finally, the time per frame is measured for recordings that
are easy or hard to analyse.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
import processes
import rclpy
from analyse_costs import figures_of, records, times_of
from comparison import Comparison, Figure, Part, parse, parser, tracked, write
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from scipy.optimize import curve_fit
from sensor_msgs.msg import JointState
from wall_bag import RATE, SECOND, START, NoisyWall, named_chain

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.progress import ProgressLine
from soliton_linkage.solitons.static_wall import site_arc
from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

PEER = 'curve_fit of a tanh'
PEER_TOPIC = 'tanh_fit'
SPEED = 5.0
IN_USE = 1000
PATIENCE = 5.0
POLL = 0.005
ROTORS_A_ROUND = 200_000
MOST_A_ROUND, LEAST_A_ROUND = 500, 50


@dataclass(frozen=True)
class Run:
    """Times [s] and position errors [rotor spacings] of a number of frames."""

    frames: int
    wall: float
    cpu: float
    error: float


def frames_of(rotors: int, count: int) -> Iterator[tuple[bytes, float]]:
    """Yield joint states of a wall in mid-chain, with its position [rotor spacings]."""
    chain, still = named_chain(rotors), np.zeros(rotors)
    spacings = min(SPEED, rotors / 2 * RATE / count)
    wall = NoisyWall(rotors, begin=rotors / 4, rate=spacings * site_arc(chain.chain))
    buffer = JointStateBuffer(chain)
    for number in range(count):
        stamp = START + number * SECOND // RATE
        yield bytes(buffer.fill(stamp, *wall.frame(number), still)), wall.position(number)


class TanhFit:
    """Simple estimator: fit of u = -ub tanh((n - X) / w), starting from the last result."""

    def __init__(self, node: Node, chain: Chain) -> None:
        self._publisher = node.create_publisher(
            SolitonState, PEER_TOPIC, interfaces.SOLITON_STATE.qos
        )
        self._chain = chain
        self._rotors = np.arange(chain.number_of_rotors)
        self._last: Array | None = None

    def take(self, serialized: bytes) -> None:
        """Fit a frame and publish the result."""
        message = deserialize_message(serialized, JointState)
        sines = np.sin(message.position)
        start = self._last
        if start is None:
            start = np.array([np.argmax(sines < 0), 1.0])
        fitted, covariance = curve_fit(self._profile, self._rotors, sines, start)
        self._last = fitted
        (position, width), deviations = fitted, np.sqrt(np.diag(covariance))
        spacing = self._chain.spacing
        soliton = Soliton(
            rotor=position,
            position=position * spacing,
            width=width * spacing,
            charge=1,
            position_deviation=deviations[0] * spacing,
            width_deviation=deviations[1] * spacing,
        )
        self._publisher.publish(SolitonState(header=message.header, solitons=[soliton]))

    def _profile(self, rotors: Array, position: float, width: float) -> Array:
        return np.asarray(-np.sin(self._chain.rest_angle) * np.tanh((rotors - position) / width))


class StateQueue:
    """Queue of the messages on a topic of soliton states."""

    def __init__(self, node: Node, topic: str) -> None:
        self.subscription = processes.raw_subscription(node, interfaces.SOLITON_STATE, topic)
        self.last = math.nan
        """Time at which a message was last taken from the queue [s]."""

    def has_publisher(self) -> bool:
        """Return whether the topic has a publisher."""
        return bool(self.subscription.get_publisher_count())

    def drain(self) -> list[bytes]:
        """Return all waiting messages."""
        taken = [message for message, _ in processes.take_all(self.subscription)]
        if taken:
            self.last = time.perf_counter()
        return taken

    def wait_for(self, count: int) -> list[bytes]:
        """Return `count` messages, or fewer if no more messages arrive."""
        taken, deadline = self.drain(), time.monotonic() + PATIENCE
        while len(taken) < count and time.monotonic() < deadline:
            time.sleep(POLL)
            fresh = self.drain()
            if fresh:
                deadline = time.monotonic() + PATIENCE
            taken += fresh
        return taken


def main() -> None:
    made = parser(__doc__)
    made.add_argument('--rotors', type=int, nargs='+', help='lengths of the chains')
    made.add_argument('--seconds', type=float, help='duration of the frames sent to the node [s]')
    made.add_argument('--frames', type=int, help='number of frames in each record')
    sizes = [20, 100], [20, 100, 1000, 10000]
    usual = {'rounds': (2, 7), 'rotors': sizes, 'frames': (20, 3000), 'seconds': (1.0, 10.0)}
    arguments = parse(made, **usual)
    with processes.own_domain():
        node = rclpy.create_node('benchmark')
        runs = {rotors: compared(node, rotors, arguments) for rotors in arguments.rotors}
        used = in_use(node, arguments.seconds)
        node.destroy_node()
    chosen = records(arguments.rotors, arguments.frames)
    costs = {record.name: times_of(record) for record in chosen}
    write(part(runs, used, costs), arguments.output)


def compared(node: Node, rotors: int, arguments: argparse.Namespace) -> dict[str, list[Run]]:
    """Return the rounds of both estimators for a chain, except the first round."""
    size = min(max(ROTORS_A_ROUND // rotors, LEAST_A_ROUND), MOST_A_ROUND)
    size = LEAST_A_ROUND if arguments.quick else size
    source = frames_of(rotors, size * (arguments.rounds + 1))
    analyser = SolitonAnalyser(
        parameter_overrides=[
            Parameter('chain_from', value='parameters'),
            Parameter('chain.number_of_rotors', value=rotors),
        ]
    )
    sides = {'theirs': TanhFit(node, Chain(number_of_rotors=rotors)), 'ours': analyser}
    states = {
        'theirs': StateQueue(node, PEER_TOPIC),
        'ours': StateQueue(node, interfaces.SOLITON_STATE.name),
    }
    processes.until(lambda: all(each.has_publisher() for each in states.values()), 'publishers')
    runs: dict[str, list[Run]] = {'theirs': [], 'ours': []}
    ended = f'rounds of {size} frames'
    for _ in tracked(range(arguments.rounds + 1), f'{rotors} rotors', f'{{}} {ended}'):
        given = list(itertools.islice(source, size))
        for name, side in sides.items():
            runs[name].append(run(side.take, states[name], given))
    analyser.destroy_node()
    for each in states.values():
        node.destroy_subscription(each.subscription)
    return {name: all_runs[1:] for name, all_runs in runs.items()}


def run(
    take: Callable[[bytes], None], states: StateQueue, given: list[tuple[bytes, float]]
) -> Run:
    """Pass frames to an estimator; return times and errors of the published states."""
    wall, cpu = time.perf_counter(), time.process_time()
    for serialized, _ in given:
        take(serialized)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    results = [deserialize_message(each, SolitonState) for each in states.wait_for(len(given))]
    positions = zip(results, given, strict=True)
    errors = [state.solitons[0].rotor - position for state, (_, position) in positions]
    return Run(len(given), wall, cpu, float(np.sqrt(np.mean(np.square(errors)))))


def in_use(node: Node, seconds: float) -> dict[str, float]:
    """Send frames to the node in a separate process; ignore the first second."""
    settings = {'chain_from': 'parameters', 'chain.number_of_rotors': IN_USE}
    states = StateQueue(node, interfaces.SOLITON_STATE.name)
    topic = interfaces.JOINT_STATES
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    warm, count = RATE, round(seconds * RATE)
    source = frames_of(IN_USE, warm + count)
    with processes.running(processes.node_command('soliton_analyser', settings)) as process:
        processes.until(publisher.get_subscription_count, 'analyser', process)
        processes.until(states.has_publisher, 'publisher of the states', process)
        send(publisher, states, source, warm, 'first second')
        start, cpu = time.perf_counter(), processes.processor_time(process.pid)
        analysed = send(publisher, states, source, count, f'{IN_USE} rotors at {RATE:g} Hz')
        cpu, wall = processes.processor_time(process.pid) - cpu, states.last - start
    return {'sent': count, 'analysed': analysed, 'seconds': wall, 'cpu': cpu}


def send(
    publisher: Publisher,
    states: StateQueue,
    source: Iterator[tuple[bytes, float]],
    count: int,
    title: str,
) -> int:
    """Publish a number of frames at their rate; return the number of analysed frames."""
    progress, analysed = ProgressLine(title, count), 0
    start = time.perf_counter()
    for number, (frame, _) in enumerate(itertools.islice(source, count)):
        time.sleep(max(0.0, start + number / RATE - time.perf_counter()))
        publisher.publish(frame)
        analysed += len(states.drain())
        progress.show(number)
    analysed += len(states.wait_for(count - analysed))
    progress.end(f'{title}: {analysed} of {count} frames analysed')
    return analysed


def part(
    runs: dict[int, dict[str, list[Run]]], used: dict[str, float], times: dict[str, list[float]]
) -> Part:
    """Return the comparisons and the figures of this part."""
    comparisons = []
    for rotors, sides in runs.items():
        rates = {name: [r.frames / r.wall for r in side] for name, side in sides.items()}
        costs = {name: [r.cpu / r.frames for r in side] for name, side in sides.items()}
        errors = {name: [r.error for r in side] for name, side in sides.items()}
        work = f'N = {rotors}:'
        comparisons += [
            Comparison(PEER, f'{work} frames per second', '1/s', **rates, more_is_better=True),
            Comparison(PEER, f'{work} processor time per frame', 's', **costs),
            Comparison(PEER, f'{work} position error', 'rotor spacings', **errors),
        ]
    work = f'of {IN_USE} rotors at {RATE:g} Hz'
    share = 100 * used['analysed'] / used['sent']
    figures = [
        Figure(f'frames {work} that the node analyses', '%', [share], '100 %'),
        Figure(f'processor load [cores], {work}', '', [used['cpu'] / used['seconds']], '0.5'),
        *(figure for name, seen in times.items() for figure in figures_of(name, seen)),
    ]
    kept = {
        rotors: {n: list(map(asdict, side)) for n, side in s.items()} for rotors, s in runs.items()
    }
    return Part('analyse', comparisons, figures, {'runs': kept, 'in_use': used, 'times': times})


if __name__ == '__main__':
    main()
