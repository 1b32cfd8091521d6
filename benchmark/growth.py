# SPDX-License-Identifier: Apache-2.0
"""Growth of time and memory with the number of rotors, and of memory with the length of a bag.

Times are processor times of the working thread. The exponent p of time ~ N^p is fitted to sizes of
1000 and more. Memory is the peak resident memory of a simulator, and of `analyse_bag` on bags.
"""

from __future__ import annotations

import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import rclpy
from comparison import Figure, Part, parse, parser, write
from growth_work import WORKS, Work
from processes import node_command, own_domain, raw_subscription, running, take_all, until
from wall_bag import write_wall_bag

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.runtime import interfaces

ROTORS = (20, 100, 1000, 10_000, 100_000)
QUICK_ROTORS = (20, 100, 1000)
FITTED_FROM = 1000
ROUND = 0.2
QUICK_ROUND = 0.02
MOST_CALLS = 200
MEGABYTE = 1e6
BAG_ROTORS = 100
BAG_FRAMES = (5_000, 40_000)
QUICK_BAG_FRAMES = (200, 800)

Times = dict[str, dict[int, list[float]]]


def main() -> None:
    plt.switch_backend('agg')
    options = parser(__doc__)
    options.add_argument('--rotors', type=int, nargs='*', help=f'sizes {ROTORS}')
    options.add_argument('--frames', type=int, nargs='*', help=f'lengths of the bags {BAG_FRAMES}')
    options.add_argument('--no-memory', dest='memory', action='store_false')
    usual = {'rotors': (QUICK_ROTORS, ROTORS), 'frames': (QUICK_BAG_FRAMES, BAG_FRAMES)}
    arguments = parse(options, rounds=(2, 5), **usual)
    sizes = sorted(arguments.rotors)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    times = measured(sizes, arguments.rounds, QUICK_ROUND if arguments.quick else ROUND)
    figures = [
        Figure(f'{name}, N = {size}', 's', rounds)
        for name, by_size in times.items()
        for size, rounds in by_size.items()
    ]
    figures += exponents(times)
    if arguments.memory:
        figures += memory(sizes[-1], arguments.frames, arguments.output.parent)
    draw(times, arguments.output.with_name('benchmark_growth.png'))
    write(Part('growth', figures=figures, details={'seconds': times}), arguments.output)


def measured(sizes: Sequence[int], rounds: int, seconds: float) -> Times:
    """Return the processor times of each task at each size [s], one number per round."""
    times: Times = {name: {size: [] for size in sizes} for name in WORKS}
    progress = ProgressLine('growing', len(sizes))
    with own_domain():
        for done, size in enumerate(sizes):
            for name, make in WORKS.items():
                progress.show(done, f'{name} of {size} rotors')
                with make(size) as work:
                    for _ in range(rounds):
                        times[name][size].append(time_of(work, seconds))
    progress.end(f'{len(WORKS)} tasks of {len(sizes)} sizes measured')
    return times


def time_of(work: Work, seconds: float) -> float:
    """Return the mean processor time of a unit of work [s] in calls of `seconds` in total."""
    spent, calls, units = 0.0, 0, 0
    while not units or (spent < seconds and calls < MOST_CALLS):
        work.prepare()
        start = time.thread_time()
        units += work.do()
        spent += time.thread_time() - start
        calls += 1
    return spent / units


def exponents(times: Times) -> list[Figure]:
    """Return the growth exponent of each task, one number per round."""
    figures = []
    for name, by_size in times.items():
        sizes = [size for size in by_size if size >= FITTED_FROM]
        sizes = sizes if len(sizes) > 1 else sorted(by_size)[-2:]
        rounds = zip(*(by_size[size] for size in sizes), strict=True)
        fitted = [float(np.polyfit(np.log(sizes), np.log(each), 1)[0]) for each in rounds]
        what = f'{name}: exponent, {min(sizes)} to {max(sizes)}'
        figures.append(Figure(what, '', fitted, '1 or less'))
    return figures


def memory(rotors: int, frames: Sequence[int], folder: Path) -> list[Figure]:
    """Return the peak memory of a large simulator, and of `analyse_bag` for each bag."""
    goal = 'under 500 MB' if rotors == max(ROTORS) else ''
    with own_domain():
        resident = simulator_memory(rotors) / MEGABYTE
    figures = [Figure(f'simulator resident, N = {rotors}', 'MB', [resident], goal)]
    for length in frames:
        resident = analyser_memory(BAG_ROTORS, length, folder) / MEGABYTE
        what = f'analyse_bag resident, N = {BAG_ROTORS}, {length} frames'
        figures.append(Figure(what, 'MB', [resident], 'the same at any length'))
    return figures


FRAMES = 20
SPEED = 0.1
ANALYSE = """
import sys
from pathlib import Path
from soliton_linkage_nodes.programs.analyse_bag import main
main(sys.argv[1:])
print(Path('/proc/self/status').read_text())
"""


def simulator_memory(rotors: int) -> float:
    """Return the peak memory of a simulator with a moving soliton and a subscriber [B]."""
    node = rclpy.create_node('watcher')
    subscription = raw_subscription(node, interfaces.JOINT_STATES)
    taken = 0

    def received() -> bool:
        nonlocal taken
        taken += len(take_all(subscription))
        return taken >= FRAMES

    start = {'initial_state': 'soliton', 'initial_position': rotors / 2}
    settings = {'chain.number_of_rotors': rotors, 'initial_velocity': SPEED, **start}
    with running(node_command('simulator', settings)) as simulator:
        until(received, f'{FRAMES} frames', simulator)
        status = Path(f'/proc/{simulator.pid}/status').read_text(encoding='ascii')
    node.destroy_node()
    return largest_resident(status)


def analyser_memory(rotors: int, frames: int, folder: Path) -> float:
    """Return the peak memory of `analyse_bag` on a bag with a number of frames [B]."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        bag = write_wall_bag(Path(name, 'wall'), rotors, frames, 'zstd')
        command = [sys.executable, '-c', ANALYSE, str(bag), '--output', name]
        ended = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return largest_resident(ended.stdout)


def largest_resident(status: str) -> float:
    """Return the peak memory in the status text of a process [B]."""
    return 1024.0 * int(status.partition('VmHWM:')[2].split()[0])


def draw(times: Times, path: Path) -> None:
    """Draw time against N."""
    figure, axes = plt.subplots(figsize=(7, 5))
    for name, by_size in times.items():
        medians = [1e6 * statistics.median(rounds) for rounds in by_size.values()]
        axes.loglog(list(by_size), medians, 'o-', label=name)
    low, high = axes.get_xlim()
    foot = math.sqrt(math.prod(axes.get_ylim()))
    axes.loglog([low, high], [foot, foot * high / low], 'k:', label='as N')
    axes.set(xlabel='number of rotors N', ylabel='processor time [µs]')
    axes.legend(fontsize='small')
    figure.tight_layout()
    figure.savefig(path, dpi=120)


if __name__ == '__main__':
    main()
