# SPDX-License-Identifier: Apache-2.0
"""What integrating a chain costs at equal error: ours against what a user would take instead.

Flippers (r/a = 0.5, theta_bar = 0.97, edge kick of 0.1) of 20 to 10,000 rotors and a spinner
(r/a = 2, 1.18, 0.3) move for 200 units of time. A method's error is the largest in an angle at the
end, against heyoka at a tolerance of 1e-16; its time at 1e-5 and at 1e-8 lies, in double
logarithm, between those of the two settings whose errors are around it. All are run in turn, and
ratios are taken within a round. Set-up and compilation are listed beside.

MuJoCo, whose step is constant, is timed over a part of the duration where the whole takes long,
and in chains of more than 150 rotors its errors are those in 150: the wall comes no further.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from integrate_account import COLUMNS, account
from integrate_peers import OURS, PEERS, Peer, Problem, Ready, heyoka_taylor

from soliton_linkage.chain import Array
from soliton_linkage.progress import ProgressLine

TARGETS = (1e-5, 1e-8)
FINEST = 3e-9
LONGEST_RUN = 20.0
ERRORS_FROM = 150
SHORTEST_ROUND = 0.03


@dataclass
class Setting:
    """One setting of a peer, prepared, with its error and its times [s]."""

    value: float
    ready: Ready
    set_up: float
    error: float
    share: float = 1.0
    times: list[float] = field(default_factory=list)

    def run(self) -> Array:
        """Run for a while, as often as fits, and keep the median time."""
        times: list[float] = []
        while not times or sum(times) < SHORTEST_ROUND:
            run = self.ready()
            start = time.perf_counter()
            angles = run()
            times.append(time.perf_counter() - start)
        self.times.append(statistics.median(times) / self.share)
        return angles


def main() -> None:
    plt.switch_backend('agg')
    arguments = parse_arguments()
    problems = [flipper(rotors) for rotors in arguments.rotors]
    if arguments.spinner:
        problems.append(Problem('spinner', 150, 200.0, 2.0, 1.18, 0.3))
    if arguments.quick:
        problems = [replace(problem, duration=20.0) for problem in problems]
    stored = json.loads(arguments.output.read_text()) if arguments.output.exists() else {}
    results = stored.setdefault('integrate', {})
    for problem in problems:
        results[f'{problem.name} {problem.rotors}'] = measured(problem, arguments.rounds)
    results.setdefault('account', {}).update(account(arguments.rotors))
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(stored, indent=2) + '\n', encoding='utf-8')
    table = '\n'.join(table_of(results))
    arguments.output.with_name('benchmark_integrate.md').write_text(table + '\n', encoding='utf-8')
    draw(results, arguments.output.with_name('benchmark_integrate.png'))
    sys.stdout.write(f'{table}\nwritten to {arguments.output}\n')


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--rotors', type=int, nargs='*', default=[20, 150, 1000, 10000])
    parser.add_argument('--no-spinner', dest='spinner', action='store_false')
    parser.add_argument('--rounds', type=int, default=5, help='(%(default)s)')
    parser.add_argument('--quick', action='store_true', help='a tenth of the duration')
    parser.add_argument('--output', type=Path, default=Path('out/benchmark.json'))
    return parser.parse_args()


def flipper(rotors: int) -> Problem:
    return Problem('flipper', rotors, 200.0, 0.5, 0.97, 0.1)


def measured(problem: Problem, rounds: int) -> dict[str, object]:
    progress = ProgressLine(f'{problem.name} of {problem.rotors}', len(PEERS) + 1 + rounds)
    reference = heyoka_taylor(problem, 1e-16)()()
    curves = {}
    for done, peer in enumerate((OURS, *PEERS)):
        progress.show(done, peer.name)
        if peer.name != 'MuJoCo implicitfast' or problem.rotors <= ERRORS_FROM:
            curves[peer.name] = curve_of(peer, problem, reference)
    needed = {
        name: [around(curve, target) for target in TARGETS] for name, curve in curves.items()
    }
    chosen = {id(s): s for pairs in needed.values() for pair in pairs for s in pair}
    for each in chosen.values():
        each.times.clear()
    for turn in range(rounds):
        progress.show(len(PEERS) + 1 + turn, f'round {turn + 1} of {rounds}')
        for each in chosen.values():
            each.run()
    progress.end(f'{problem.name} of {problem.rotors} rotors measured')
    return {
        'duration': problem.duration,
        'rotors': problem.rotors,
        'curves': {
            name: [[s.value, s.error, min(s.times), s.set_up] for s in curve if s.times]
            for name, curve in curves.items()
        },
        'seconds': {
            name: {
                str(target): times_at(pair, target)
                for target, pair in zip(TARGETS, pairs, strict=True)
            }
            for name, pairs in needed.items()
        },
    }


def curve_of(peer: Peer, problem: Problem, reference: Array) -> list[Setting]:
    """Settings from coarse on until the error is below the finest that is asked for."""
    if peer.constant_step and problem.rotors > ERRORS_FROM:
        return scaled_curve_of(peer, problem)
    curve: list[Setting] = []
    for value in peer.settings:
        setting = prepared(peer, problem, value)
        setting.error = float(np.abs(setting.run() - reference).max())
        if math.isfinite(setting.error):
            curve.append(setting)
        if setting.error < FINEST or setting.times[-1] > LONGEST_RUN:
            break
    return curve


def scaled_curve_of(peer: Peer, problem: Problem) -> list[Setting]:
    smaller = replace(problem, rotors=ERRORS_FROM)
    errors = curve_of(peer, smaller, heyoka_taylor(smaller, 1e-16)()())
    share = 0.01
    part = replace(problem, duration=share * problem.duration)
    curve = []
    for known in errors:
        setting = prepared(peer, part, known.value)
        setting.error, setting.share = known.error, share
        setting.run()
        curve.append(setting)
    return curve


def prepared(peer: Peer, problem: Problem, value: float) -> Setting:
    start = time.perf_counter()
    ready = peer.prepare(problem, value)
    return Setting(value, ready, time.perf_counter() - start, math.nan)


def around(curve: list[Setting], target: float) -> tuple[Setting, ...]:
    """The setting just above and just below an error; one if the first is below, or none."""
    for coarse, fine in itertools.pairwise(curve):
        if coarse.error >= target >= fine.error:
            return coarse, fine
    return (curve[0],) if curve[0].error < target else ()


def times_at(pair: tuple[Setting, ...], target: float) -> list[float]:
    """Time at an error in each round [s]; empty where the error was not reached."""
    if len(pair) < 2:
        return [t for setting in pair for t in setting.times]
    coarse, fine = pair
    share = math.log(coarse.error / target) / math.log(coarse.error / fine.error)
    return [
        slow**share * quick ** (1 - share)
        for quick, slow in zip(coarse.times, fine.times, strict=True)
    ]


def table_of(results: dict) -> list[str]:
    rows = [
        '| peer | work | theirs | ours | ratio (spread) | set-up |',
        '| --- | --- | --- | --- | --- | --- |',
    ]
    for work in sorted(results.keys() - {'account'}, key=size_of):
        result = results[work]
        for name, by_target in result['seconds'].items():
            if name == OURS.name:
                continue
            for target, theirs in by_target.items():
                mine = result['seconds'][OURS.name][target]
                rows.append(
                    row(name, f'{work}, error {target}', theirs, mine, result['curves'][name])
                )
    rows += ['', '| rotors | ' + ' | '.join(COLUMNS) + ' |', '| --- ' * (len(COLUMNS) + 1) + '|']
    for size, times in sorted(results['account'].items(), key=lambda item: int(item[0])):
        rows.append(f'| {size} | ' + ' | '.join(f'{value:.2f}' for value in times) + ' |')
    return rows


def row(name: str, work: str, theirs: list[float], mine: list[float], curve: list) -> str:
    if not theirs or not mine:
        reached = f'{1e3 * statistics.median(mine):.3g} ms' if mine else 'not reached'
        return f'| {name} | {work} | not reached | {reached} | | |'
    ratios = sorted(t / m for t, m in zip(theirs, mine, strict=True))
    return (
        f'| {name} | {work} | {1e3 * statistics.median(theirs):.3g} ms '
        f'| {1e3 * statistics.median(mine):.3g} ms '
        f'| {statistics.median(ratios):.3g} ({ratios[0]:.3g} to {ratios[-1]:.3g}) '
        f'| {max(point[3] for point in curve):.2g} s |'
    )


def size_of(work: str) -> tuple[int, str]:
    name, size = work.rsplit(maxsplit=1)
    return int(size), name


def draw(results: dict, path: Path) -> None:
    works = sorted((work for work in results if work != 'account'), key=size_of)
    colours = {peer.name: f'C{place}' for place, peer in enumerate((OURS, *PEERS))}
    figure, axes = plt.subplots(1, len(works), figsize=(4 * len(works), 4), squeeze=False)
    for axis, work in zip(axes[0], works, strict=True):
        for name, curve in results[work]['curves'].items():
            points = np.array(curve)
            axis.loglog(points[:, 1], points[:, 2], 'o-', color=colours[name], label=name)
        axis.set(title=work, xlabel='largest error of an angle [rad]', ylabel='wall time [s]')
        axis.invert_xaxis()
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=120)


if __name__ == '__main__':
    main()
