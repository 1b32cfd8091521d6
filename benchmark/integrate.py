# SPDX-License-Identifier: Apache-2.0
"""Time of our integrator and of other tools to integrate a chain at equal error.

Flippers (r/a = 0.5, theta_bar = 0.97, edge kick of 0.1) of 20 to 10,000 rotors and a spinner (r/a
= 2, theta_bar = 1.18, edge kick of 0.3) move for 200 units of time. The error is the largest error
of an angle at the end, compared with heyoka at a tolerance of 1e-16. Times at errors of 1e-5 and
1e-8 are interpolated, in double logarithmic scale, between the two nearest settings. Ratios are
computed within a round. Set-up and compilation are listed separately.

Times of MuJoCo, which has a constant step, are extrapolated from the first part of long runs. In
chains of more than 150 rotors, the errors of MuJoCo are measured with 150 rotors, because no wall
moves beyond rotor 150.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from comparison import Comparison, Figure, Part, parse, parser, write
from integrate_peers import OURS, PEERS, Peer, Problem, Ready, heyoka_taylor

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import nystrom_loops
from soliton_linkage.dynamics.integrators.symplectic_nystrom import (
    KICKS,
    NystromSteps,
    zeros_in_line,
)
from soliton_linkage.dynamics.terms import (
    VECTOR,
    SpringTorques,
    padded_size,
    sum_terms,
    term_table,
)
from soliton_linkage.linkage.chain import Array
from soliton_linkage.progress import ProgressLine

TARGETS = (1e-5, 1e-8)
FINEST = 3e-9
LONGEST_RUN = 20.0
ERRORS_FROM = 150
SHORTEST_ROUND = 0.03


@dataclass
class Setting:
    """Prepared setting of a method, with its error and its times [s]."""

    value: float
    ready: Ready
    set_up: float
    error: float
    share: float = 1.0
    times: list[float] = field(default_factory=list)

    def run(self) -> Array:
        """Run repeatedly for `SHORTEST_ROUND` and store the median time."""
        times: list[float] = []
        while not times or sum(times) < SHORTEST_ROUND:
            run = self.ready()
            start = time.perf_counter()
            angles = run()
            times.append(time.perf_counter() - start)
        self.times.append(statistics.median(times) / self.share)
        return angles

    def as_json(self) -> dict[str, Any]:
        """Return the setting for the JSON file."""
        numbers = {'error': self.error, 'seconds': self.times, 'set_up': self.set_up}
        return {'setting': self.value, **numbers}


Settings = tuple[Setting, ...]


def main() -> None:
    plt.switch_backend('agg')
    made = parser(__doc__)
    made.add_argument('--rotors', type=int, nargs='*', help='(20, 150, 1000, 10000; quick: 20)')
    made.add_argument('--no-spinner', dest='spinner', action='store_false')
    options = parse(made, rounds=(2, 5), rotors=([20], [20, 150, 1000, 10000]))
    problems = problems_of(options)
    measured = {name_of(each): measure(each, options.rounds) for each in problems}
    accounts = account([each.rotors for each in problems if each.name == 'flipper'])
    details = {'curves': {name: result['curves'] for name, result in measured.items()}}
    part = Part(
        'integrate',
        [each for result in measured.values() for each in result['comparisons']],
        [*figures_of(accounts), *growth_of(measured, problems), *compilation()],
        {**details, 'account': accounts},
    )
    write(part, options.output)
    draw(details['curves'], options.output.with_name('benchmark_integrate.png'))


def problems_of(options: argparse.Namespace) -> list[Problem]:
    """Return the problems, with a tenth of the duration for --quick."""
    problems = [flipper(rotors) for rotors in options.rotors]
    if options.spinner and not options.quick:
        problems.append(Problem('spinner', 150, 200.0, 2.0, 1.18, 0.3))
    return [replace(each, duration=20.0) for each in problems] if options.quick else problems


def name_of(problem: Problem) -> str:
    return f'{problem.name} of {problem.rotors}'


def flipper(rotors: int) -> Problem:
    return Problem('flipper', rotors, 200.0, 0.5, 0.97, 0.1)


def measure(problem: Problem, rounds: int) -> dict[str, Any]:
    """Return the work-precision curves of all methods, and the comparisons at equal error."""
    progress = ProgressLine(name_of(problem), len(PEERS) + 1 + rounds)
    reference = heyoka_taylor(problem, 1e-16)()()
    curves = {}
    for done, peer in enumerate((OURS, *PEERS)):
        progress.show(done, peer.name)
        if peer.name != 'MuJoCo implicitfast' or problem.rotors <= ERRORS_FROM:
            curves[peer.name] = curve_of(peer, problem, reference)
    needed = {name: [around(each, target) for target in TARGETS] for name, each in curves.items()}
    chosen = {id(s): s for pairs in needed.values() for pair in pairs for s in pair}
    for each in chosen.values():
        each.times.clear()
    for turn in range(rounds):
        progress.show(len(PEERS) + 1 + turn, f'round {turn + 1} of {rounds}')
        for each in chosen.values():
            each.run()
    progress.end(f'{name_of(problem)} rotors measured')
    shown = {name: [setting.as_json() for setting in curve] for name, curve in curves.items()}
    return {'comparisons': comparisons_of(name_of(problem), needed, curves), 'curves': shown}


def comparisons_of(
    work: str, needed: dict[str, list[Settings]], curves: dict[str, list[Setting]]
) -> list[Comparison]:
    made = []
    for name in needed.keys() - {OURS.name}:
        for number, target in enumerate(TARGETS):
            theirs, mine = (times_at(needed[n][number], target) for n in (name, OURS.name))
            made.append(Comparison(name, f'{work}, error {target:g} rad', 's', theirs, mine))
        set_up = [[max(s.set_up for s in curves[n])] for n in (name, OURS.name)]
        made.append(Comparison(name, f'{work}, set-up', 's', *set_up))
    return sorted(made, key=lambda each: [peer.name for peer in PEERS].index(each.peer))


def curve_of(peer: Peer, problem: Problem, reference: Array) -> list[Setting]:
    """Return settings from coarse to fine until the error is below the smallest target."""
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


def around(curve: list[Setting], target: float) -> Settings:
    """Return the settings with errors just above and below a target, if they exist."""
    for coarse, fine in itertools.pairwise(curve):
        if coarse.error >= target >= fine.error:
            return coarse, fine
    return (curve[0],) if curve[0].error < target else ()


def times_at(pair: Settings, target: float) -> list[float]:
    """Return the time [s] to reach an error in each round; empty if the error was not reached."""
    if len(pair) < 2:
        return [t for setting in pair for t in setting.times]
    coarse, fine = pair
    share = math.log(coarse.error / target) / math.log(coarse.error / fine.error)
    pairs = zip(coarse.times, fine.times, strict=True)
    return [slow**share * quick ** (1 - share) for quick, slow in pairs]


REPEATS = 7
BUDGET = 2e6
"""Number of rotors times number of forces in a timed call [1]; a call takes a few milliseconds."""

WHOLE = 'integrating'
STEP = 0.1


def account(sizes: list[int]) -> dict[str, dict[str, list[float]]]:
    """Return the time per rotor and force [ns], in long runs and in single loops."""
    return {str(size): {WHOLE: symplectic(size), **loops(size)} for size in sizes}


def symplectic(size: int) -> list[float]:
    motion, state = moving(size)
    steps = NystromSteps(motion)
    count = max(4, math.ceil(BUDGET / size / len(KICKS)))
    return nanoseconds(lambda: steps.advance(state, STEP, count), count * len(KICKS) * size)


def moving(size: int) -> tuple[EquationOfMotion, Array]:
    problem = Problem('flipper', size, 1.0, 0.5, 0.97, 0.1)
    return EquationOfMotion(problem.chain), np.concatenate([problem.angles, problem.rates])


def loops(size: int) -> dict[str, list[float]]:
    """Return the times of single loops on rows so long that call overhead is negligible."""
    longer = max(size, 8000)
    motion, _ = moving(longer)
    work = zeros_in_line(nystrom_loops.WORK_ROWS, padded_size(longer) + VECTOR)
    work[:] = np.random.default_rng(1).uniform(-0.1, 0.1, work.shape)
    table = term_table([SpringTorques(motion.chain)], longer)
    calls: dict[str, Callable[[], object]] = {
        'springs': lambda: sum_terms(work, longer, *table),
        'turn': lambda: nystrom_loops.turn(work, nystrom_loops.RATES, 1e-9),
    }
    repeats = math.ceil(BUDGET / longer)
    return {
        name: nanoseconds(lambda call=call: repeated(call, repeats), repeats * longer)
        for name, call in calls.items()
    }


def repeated(call: Callable[[], object], times: int) -> None:
    for _ in range(times):
        call()


def nanoseconds(call: Callable[[], object], parts: int) -> list[float]:
    """Return the time per equal part of a call [ns], one number per repetition."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call()
        times.append(1e9 * (time.perf_counter() - start) / parts)
    return times


def figures_of(accounts: dict[str, dict[str, list[float]]]) -> list[Figure]:
    figures = []
    for size, what in itertools.product(accounts, next(iter(accounts.values()), {})):
        title, goal = f'{what}, per rotor and force, N = {size}', 'under 4 ns' * (what == WHOLE)
        figures.append(Figure(title, 'ns', accounts[size][what], goal))
    return figures


def growth_of(measured: dict[str, dict[str, Any]], problems: list[Problem]) -> list[Figure]:
    """Return the ratio of times per rotor in the longest and the shortest chain."""
    flippers = [each for each in problems if each.name == 'flipper']
    short, long = (end(flippers, key=lambda each: each.rotors) for end in (min, max))
    found = [measured[name_of(each)]['comparisons'] for each in (short, long)]
    times = [next(c.ours for c in each if f'{TARGETS[-1]:g}' in c.work) for each in found]
    ratio = short.rotors / long.rotors
    per_rotor = [ratio * t_long / t_short for t_short, t_long in zip(*times, strict=True)]
    what = f'time per rotor, {long.rotors} / {short.rotors} rotors'
    return [Figure(what, '', per_rotor, 'linear in N: 1')] if short != long else []


def compilation() -> list[Figure]:
    """Return the times of set-up and first run in new processes, with and without a cache."""
    command = (
        'import time, integrate as i; start = time.perf_counter(); '
        'i.OURS.prepare(i.flipper(20), 1e-8); print(time.perf_counter() - start)'
    )
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, 'NUMBA_CACHE_DIR': folder}
        for _ in range(2):
            how: Any = {'capture_output': True, 'check': True, 'text': True}
            done = subprocess.run(
                [sys.executable, '-c', command], cwd=Path(__file__).parent, env=environment, **how
            )
            seconds.append(float(done.stdout.splitlines()[-1]))
    return [
        Figure('numba and compilation of ours, once on a machine', 's', seconds[:1]),
        Figure('numba and loading of ours, in each process', 's', seconds[1:]),
    ]


def draw(curves: dict[str, dict[str, list[dict[str, Any]]]], path: Path) -> None:
    colours = {peer.name: f'C{number}' for number, peer in enumerate((OURS, *PEERS))}
    size = 4 * len(curves), 4
    figure, axes = plt.subplots(1, len(curves), figsize=size, squeeze=False, layout='constrained')
    for axis, (work, by_method) in zip(axes[0], curves.items(), strict=True):
        for name, curve in by_method.items():
            points = np.array([[s['error'], min(s['seconds'])] for s in curve if s['seconds']])
            axis.loglog(*points.T, 'o-', color=colours[name], label=name)
        axis.set(title=work, xlabel='largest error of an angle [rad]', ylabel='wall time [s]')
        axis.invert_xaxis()
    lines = axes[0][0].get_legend_handles_labels()
    figure.legend(*lines, loc='outside lower center', ncols=len(colours))
    figure.savefig(path, dpi=120)


if __name__ == '__main__':
    main()
