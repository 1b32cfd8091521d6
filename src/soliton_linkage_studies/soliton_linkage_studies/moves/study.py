# SPDX-License-Identifier: Apache-2.0
"""Moves of walls as a file of settings asks for them, and the table of what became of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from soliton_linkage.steering.steering import Outcome
from soliton_linkage_studies.moves.runs import Condition, MoveKey, MoveRun, MoveTask
from soliton_linkage_studies.settings import Section, chain_from

_QUICK_MOVES = 2
"""Moves of each chain and condition that a quick study makes."""
_KEYS = ('seed', 'frame_rate', 'moves', 'held', 'torque_limit', 'conditions', 'chains')


@dataclass(frozen=True)
class MoveStudy:
    """The moves that a file of settings asks for."""

    tasks: dict[MoveKey, list[MoveTask]]
    """By the names of chain and condition."""

    @property
    def numbered(self) -> dict[tuple[MoveKey, int], MoveTask]:
        """All moves, each by a key of its own."""
        return {
            (key, number): task
            for key, tasks in self.tasks.items()
            for number, task in enumerate(tasks)
        }


def read_move_study(settings: Section, quick: bool) -> MoveStudy:
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
                MoveTask(
                    chain, condition, start, goal, seed + move, frame_rate, held, torque_limit
                )
                for move, (start, goal) in enumerate(places.tolist())
            ]
    return MoveStudy(tasks)


def runs_by_key(numbered: Mapping[tuple[MoveKey, int], MoveRun]) -> dict[MoveKey, list[MoveRun]]:
    """Runs of `MoveStudy.numbered` by the names of chain and condition, in their order."""
    runs: dict[MoveKey, list[MoveRun]] = {}
    for (key, _), run in numbered.items():
        runs.setdefault(key, []).append(run)
    return runs


def table_lines(runs: Mapping[MoveKey, Sequence[MoveRun]]) -> list[str]:
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
