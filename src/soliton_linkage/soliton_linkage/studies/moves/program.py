# SPDX-License-Identifier: Apache-2.0
"""Carry walls along simulated chains, and show where they end and what phonons they wake.

Writes a table as Markdown and a picture as PNG and PDF with its data as CSV.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from soliton_linkage.linkage.chain import Chain
from soliton_linkage.steering.steering import Outcome
from soliton_linkage.studies.moves.pictures import draw_moves
from soliton_linkage.studies.moves.runs import Condition, MoveRun, Task
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.settings import Section, chain_from, load_settings
from soliton_linkage.studies.workers import local_processes, process_count

_STOPPED = 130
_QUICK_MOVES = 2
_KEYS = ('seed', 'frame_rate', 'moves', 'held', 'torque_limit', 'conditions', 'chains')


@dataclass(frozen=True)
class MoveStudy:
    """The moves that a file of settings asks for."""

    chains: dict[str, Chain]
    conditions: dict[str, Condition]
    tasks: dict[tuple[str, str], list[Task]]
    """By the names of chain and condition."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the moves of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        study = read_study(load_settings(options.config), options.quick)
        options.output.mkdir(parents=True, exist_ok=True)
        runs = made_runs(study, options.workers)
        table = '\n'.join(table_lines(runs)) + '\n'
        (options.output / 'table.md').write_text(table, encoding='utf-8')
        draw_moves(study.tasks, runs).save(options.output, 'moves')
    except (OSError, ValueError, ArithmeticError) as error:
        print(f'moves: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\nmoves: stopped; nothing new is written', file=sys.stderr)
        return _STOPPED
    print(f'{table}\ntable and picture are in {options.output}')
    return 0


def read_study(settings: Section, quick: bool) -> MoveStudy:
    """Study of a file of settings; raises ValueError for what cannot be."""
    settings.allow(*_KEYS)
    seed = settings.whole_number('seed', 0, 2**31)
    frame_rate = settings.number('frame_rate', 10.0, 2000.0)
    moves = settings.whole_number('moves', 1, 10_000)
    held = settings.number('held', 0.0, 60.0)
    torque_limit = settings.number('torque_limit', 1e-9, 1e6)
    conditions = {
        name: _condition(section)
        for name, section in settings.section('conditions').sections().items()
    }
    chains = {
        name: chain_from(section)
        for name, section in settings.section('chains').sections().items()
    }
    tasks = {}
    for number, (name, chain) in enumerate(chains.items()):
        places = np.random.default_rng([seed, number]).uniform(
            0, chain.number_of_rotors - 1, (moves, 2)
        )[: _QUICK_MOVES if quick else moves]
        for title, condition in conditions.items():
            tasks[name, title] = [
                Task(chain, condition, start, goal, seed + move, frame_rate, held, torque_limit)
                for move, (start, goal) in enumerate(places.tolist())
            ]
    return MoveStudy(chains, conditions, tasks)


def made_runs(study: MoveStudy, workers: int) -> dict[tuple[str, str], list[MoveRun]]:
    """Runs of all tasks in their order, from processes side by side."""
    flat = [(key, task) for key, tasks in study.tasks.items() for task in tasks]
    progress = ProgressLine('moves', len(flat))
    done: dict[int, MoveRun] = {}
    with local_processes(min(workers, len(flat))) as processes:
        futures = {processes.submit(task): number for number, (_, task) in enumerate(flat)}
        for future in processes.finished():
            done[futures[future]] = future.result()
            progress.show(len(done))
    progress.end(f'moves: {len(flat)} made')
    runs: dict[tuple[str, str], list[MoveRun]] = {key: [] for key in study.tasks}
    for number, (key, _) in enumerate(flat):
        runs[key].append(done[number])
    return runs


def table_lines(runs: dict[tuple[str, str], list[MoveRun]]) -> list[str]:
    """Lines of the table in Markdown."""
    lines = [
        '| chain | condition | reached | largest error [spacings] | phonons at the end [J] '
        '| over the peak energy of the wall | time [s] |',
        '| --- | --- | --- | --- | --- | --- | --- |',
    ]
    for (name, title), made in runs.items():
        reached = [run for run in made if run.outcome is Outcome.REACHED]
        cells = [name, title, f'{len(reached)} of {len(made)}', '', '', '', '']
        if reached:
            left = max(run.energy_left for run in reached)
            share = max(run.energy_left / run.peak_energy for run in reached)
            durations = [run.duration for run in reached]
            cells[3:] = [
                f'{max(run.error for run in reached):.4f}',
                f'{left:.1e}',
                f'{share:.1e}',
                f'{min(durations):.1f} to {max(durations):.1f}',
            ]
        lines.append('| ' + ' | '.join(cells) + ' |')
    return lines


def _condition(section: Section) -> Condition:
    section.allow('noise', 'decay', 'disorder')
    return Condition(
        section.number('noise', 0.0, 1.0),
        section.number('decay', 0.0, 1e6),
        section.number('disorder', 0.0, 0.3),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='moves', description=__doc__)
    parser.add_argument('config', type=Path, help='settings, as config/studies/moves.yaml')
    parser.add_argument('--output', type=Path, default=Path('out/moves'), help='folder')
    parser.add_argument('--quick', action='store_true', help='fewer moves, to try it out')
    parser.add_argument(
        '--workers', type=process_count, default=os.cpu_count() or 1, help='processes [one a core]'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
