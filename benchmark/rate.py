# SPDX-License-Identifier: Apache-2.0
"""Largest number of rotors and highest rate in real time, of our simulator and of an rclpy timer.

This process records the publication time and the sequence number of every joint_states. A deadline
is missed if an interval exceeds two periods. A run is in real time if its real-time factor is 1
within 0.001 and the simulator misses at most n + 2 sqrt(n) deadlines. A third process that only
sleeps misses n deadlines at the same time.

The largest number of rotors at 1000 Hz and the highest rate of 40 rotors are searched in runs of a
few seconds. In these runs three missed deadlines are allowed, and a failed run is repeated once. A
long run confirms the result. If this run fails, smaller values are tried.
"""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import processes
import rclpy
from comparison import Comparison, Figure, Part, parse, parser, write
from rclpy.node import Node
from rclpy.subscription import Subscription
from wall_bag import named_chain

from soliton_linkage.linkage.chain import Array
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.messages.cdr import JointStateBuffer
from soliton_linkage_nodes.runtime import interfaces

Command = Callable[[int, float], list[str | Path]]
Sizes = Callable[[float], tuple[int, float]]
"""Function from the searched value to the number of rotors and the rate [Hz]."""

ROTORS, RATE = 40, 1000.0
POSITION, VELOCITY = 1.5, 0.3
MOST_ROTORS = 20_000
ROTOR_RANGE, RATE_RANGE = (3.0, MOST_ROTORS), (10.0, 10_000.0)
FINEST_STEP = 1.15
STEP_DOWN = 0.9
PACE = 1e-3
CHANCE = 2.0
FEW = 3
TRIES = 2
SETTLING = 1.5
POLL = 0.005
FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Run:
    """Deadlines of a simulator in one run."""

    rotors: int
    rate: float
    real_time_factor: float
    frames: int
    missed: int
    missed_by_sleeping: int
    jitter: tuple[float, float, float]
    """Median, 99th percentile and maximum of |interval - period| [s]."""
    share_of_a_core: float

    @property
    def holds(self) -> bool:
        """Whether the run was in real time, apart from chance."""
        return self.holds_but_for(0)

    def holds_but_for(self, deadlines: int) -> bool:
        """Return whether the run would be in real time without some missed deadlines."""
        in_pace = abs(self.real_time_factor - 1) < PACE
        chance = CHANCE * math.sqrt(self.missed_by_sleeping)
        return in_pace and self.missed - deadlines <= self.missed_by_sleeping + chance


class Bench:
    """Runner of simulators, one after the other."""

    def __init__(self, node: Node, seconds: float, confirming: float) -> None:
        self._node = node
        self._seconds = seconds
        self._confirming = confirming
        self.runs: dict[str, list[Run]] = {}

    def most_rotors(self, name: str, command: Command) -> list[float]:
        """Return the largest number of rotors in real time; empty if no run is in real time."""
        return self._largest(name, command, lambda value: (round(value), RATE), ROTOR_RANGE)

    def highest_rate(self, name: str, command: Command) -> list[float]:
        """Return the highest rate in real time [Hz]; empty if no run is in real time."""
        return self._largest(name, command, lambda value: (ROTORS, round(value)), RATE_RANGE)

    def run(self, name: str, command: Command, rotors: int, rate: float, seconds: float) -> Run:
        """Run for a number of seconds after the start."""
        qos = interfaces.stream_qos(len(JointStateBuffer(named_chain(rotors))))
        subscription = processes.raw_subscription(self._node, interfaces.JOINT_STATES, qos=qos)
        progress = ProgressLine(f'{name}, {rotors} rotors at {rate:g} Hz', seconds)
        sleeping = processes.program_command(FOLDER / 'sleeper.py', rate, seconds)
        with processes.running(command(rotors, rate)) as process:
            processes.until(lambda: processes.take_all(subscription), 'joint_states', process)
            drain(subscription, SETTLING)
            with subprocess.Popen(sleeping, stdout=subprocess.PIPE, text=True) as sleeper:
                start, before = time.monotonic(), processes.processor_time(process.pid)
                frames = drain(subscription, seconds, progress)
                spent = processes.processor_time(process.pid) - before
                share = spent / (time.monotonic() - start)
                slept = np.array(sleeper.communicate()[0].split(), dtype=np.int64)
        self._node.destroy_subscription(subscription)
        done = run_of(rotors, rate, frames, slept, share)
        verdict = 'holds' if done.holds else 'does not hold'
        progress.end(
            f'{name}, {rotors} rotors at {rate:g} Hz {verdict}: real-time factor '
            f'{done.real_time_factor:.4f}, {done.missed} of {done.frames} deadlines missed, '
            f'{done.missed_by_sleeping} by a sleeping loop'
        )
        self.runs.setdefault(name, []).append(done)
        return done

    def _largest(
        self, name: str, command: Command, sizes: Sizes, ends: tuple[float, float]
    ) -> list[float]:
        """Bisect between a value in real time and one not in real time; confirm by long runs."""
        least, most = ends

        def run(value: float, seconds: float) -> Run:
            return self.run(name, command, *sizes(value), seconds)

        def promising(value: float) -> bool:
            return any(run(value, self._seconds).holds_but_for(FEW) for _ in range(TRIES))

        held, failed = least, most * FINEST_STEP
        value = math.sqrt(least * most)
        while held < most and failed / held > FINEST_STEP:
            if promising(value):
                held = value
            else:
                failed = value
            value = min(math.sqrt(held * failed), most)
        step = STEP_DOWN
        while held >= least:
            if run(held, self._confirming).holds:
                return [float(round(held))]
            held *= step
            step *= step
        return []


def main() -> None:
    options = parser(__doc__)
    about = 'integrator of our simulator (%(default)s)'
    options.add_argument('--integrator', default='symplectic', help=about)
    arguments = parse(options, rounds=(1, 1))
    quick = arguments.quick
    commands = {'ours': ours(arguments.integrator), 'theirs': timer_node}
    found: dict[str, dict[str, list[float]]] = {'rotors': {}, 'rate': {}}
    kept: dict[str, list[Run]] = {'ours': [], 'theirs': []}
    with processes.own_domain():
        node = rclpy.create_node('benchmark')
        bench = Bench(node, *((1.0, 1.0) if quick else (3.0, 30.0)))
        for _ in range(arguments.rounds):
            for side, command in commands.items():
                seconds = 1.0 if quick else 30.0
                kept[side].append(bench.run(side, command, ROTORS, RATE, seconds))
                if not quick:
                    found['rotors'].setdefault(side, []).extend(bench.most_rotors(side, command))
                    found['rate'].setdefault(side, []).extend(bench.highest_rate(side, command))
        node.destroy_node()
    details = {
        'runs': {side: [asdict(run) for run in runs] for side, runs in bench.runs.items()},
        'integrator': arguments.integrator,
    }
    comparisons = [*searched(found), *compared(kept)] if not quick else compared(kept)
    write(Part('rate', comparisons, figures_of(kept), details), arguments.output)


def ours(integrator: str) -> Command:
    def command(rotors: int, rate: float) -> list[str | Path]:
        settings = {
            'chain.number_of_rotors': rotors,
            'publish_rate': float(rate),
            'integrator': integrator,
            'initial_state': 'soliton',
            'initial_position': min(POSITION, rotors - POSITION),
            'initial_velocity': VELOCITY,
            'subscribers': 1,
            'real_time': 'true',
        }
        return processes.node_command('simulator', settings)

    return command


def timer_node(rotors: int, rate: float) -> list[str | Path]:
    position = min(POSITION, rotors - POSITION)
    return processes.program_command(FOLDER / 'timer_node.py', rotors, rate, position, VELOCITY)


def drain(
    subscription: Subscription, seconds: float, progress: ProgressLine | None = None
) -> Array:
    """Return sequence number and publication time [ns] of each frame, shape (frames, 2)."""
    frames = []
    start = time.monotonic()
    while (elapsed := time.monotonic() - start) < seconds:
        for _, info in processes.take_all(subscription):
            frames.append((info['publication_sequence_number'], info['source_timestamp']))
        if progress is not None:
            progress.show(elapsed)
        time.sleep(POLL)
    return np.array(frames, dtype=np.int64).reshape(-1, 2)


def run_of(rotors: int, rate: float, frames: Array, slept: Array, share: float) -> Run:
    """Return the run at a rate [Hz]; `frames` and `slept` contain times [ns]."""
    if len(frames) < 2:
        return Run(rotors, rate, 0.0, len(frames), 0, 0, (math.inf,) * 3, share)
    numbers, instants = frames.T
    deviations = np.diff(instants) * 1e-9 - np.diff(numbers) / rate
    median, most, largest = np.percentile(np.abs(deviations), (50, 99, 100)).tolist()
    lasted = (instants[-1] - instants[0]) * 1e-9
    factor = float((numbers[-1] - numbers[0]) / rate / lasted)
    failures = missed(deviations, rate), missed(np.diff(slept) * 1e-9 - 1 / rate, rate)
    return Run(rotors, rate, factor, len(frames), *failures, (median, most, largest), share)


def missed(deviations: Array, rate: float) -> int:
    """Return the number of intervals above two periods, given interval - period [s]."""
    return int(np.count_nonzero(deviations > 1 / rate))


def searched(found: dict[str, dict[str, list[float]]]) -> list[Comparison]:
    works = {'rotors': f'most rotors at {RATE:g} Hz', 'rate': f'highest rate of {ROTORS} rotors'}
    units = {'rotors': 'rotors', 'rate': 'Hz'}
    return [
        Comparison('rclpy timer', works[what], units[what], sides['theirs'], sides['ours'], True)
        for what, sides in found.items()
    ]


def compared(kept: dict[str, list[Run]]) -> list[Comparison]:
    """Return the comparison of both simulators at the common size."""
    work = f'{ROTORS} rotors at {RATE:g} Hz'
    quantities: tuple[tuple[str, str, Callable[[Run], float], bool], ...] = (
        ('real-time factor', '', lambda run: run.real_time_factor, True),
        ('jitter p50', 's', lambda run: run.jitter[0], False),
        ('jitter p99', 's', lambda run: run.jitter[1], False),
        ('largest jitter', 's', lambda run: run.jitter[2], False),
        ('processor load [cores]', '', lambda run: run.share_of_a_core, False),
    )
    comparisons = []
    for what, unit, quantity, more in quantities:
        sides = ([quantity(run) for run in kept[side]] for side in ('theirs', 'ours'))
        comparisons.append(Comparison('rclpy timer', f'{what}, {work}', unit, *sides, more))
    return comparisons


def figures_of(kept: dict[str, list[Run]]) -> list[Figure]:
    work, runs = f'{ROTORS} rotors at {RATE:g} Hz', kept['ours']
    slept = [run.missed_by_sleeping for run in runs]
    return [
        Figure(
            f'missed deadlines, {work}', '', [run.missed for run in runs], 'as a sleeping loop'
        ),
        Figure(f'missed by a sleeping loop, {work}', '', slept),
        Figure(f'frames, {work}', '', [run.frames for run in runs]),
    ]


if __name__ == '__main__':
    main()
