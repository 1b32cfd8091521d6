# SPDX-License-Identifier: Apache-2.0
"""Drive chains in every way there is, and show on one page that what was promised holds.

Writes a page as PNG and PDF with its data as CSV, and a table as Markdown.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from soliton_linkage.actuation.edge_drive import EdgeOrder, Kind
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.profile import Profile, trapezoid
from soliton_linkage.linear.rigidity import Edge
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.steering.steering import Outcome
from soliton_linkage.studies.driving.pictures import (
    BOOKS_LIMIT,
    blank_page,
    draw_books,
    draw_moves,
    draw_stiffness,
    draw_tilt,
    draw_work,
    entitle,
)
from soliton_linkage.studies.driving.runs import (
    MECHANICS,
    BookedRun,
    BooksTask,
    StiffnessTask,
    TiltedRun,
    TiltTask,
)
from soliton_linkage.studies.figures.actuator import DrivenChain, draw_response, driven_chain
from soliton_linkage.studies.moves.program import read_study, table_lines
from soliton_linkage.studies.moves.runs import MoveRun, Task
from soliton_linkage.studies.plates import Plate
from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.settings import Section, chain_from, load_settings
from soliton_linkage.studies.workers import local_processes, process_count

_STOPPED = 130
_KEYS = ('step', 'work', 'books', 'stiffness', 'tilt', 'moves')
_WORK_PERIOD = 0.002
_SHORT = 1.0


@dataclass(frozen=True)
class WorkTask:
    """A chain that an actuator drives by a pressure at its first edge."""

    chain: Chain
    actuator: PneumaticActuator
    order: EdgeOrder

    def __call__(self) -> DrivenChain:
        """Simulate it."""
        return driven_chain(self.chain, self.actuator, self.order, _WORK_PERIOD)


@dataclass(frozen=True)
class DrivingStudy:
    """What a file of settings asks for."""

    step: Profile
    """Commanded pressure [Pa] over time [s]."""
    works: dict[str, WorkTask]
    """By actuator."""
    books: dict[str, BooksTask]
    """By mechanics."""
    stiffnesses: list[StiffnessTask]
    tilts: dict[str, TiltTask]
    """By mechanics."""
    moves: dict[tuple[str, str], list[Task]]
    """By the names of chain and condition."""


@dataclass(frozen=True)
class Results:
    """What came of a study, by the same keys and in the same order."""

    works: dict[str, DrivenChain]
    books: dict[str, BookedRun]
    apart: list[float]
    """Largest distance of springs from bars [rad]."""
    tilts: dict[str, TiltedRun]
    moves: dict[tuple[str, str], list[MoveRun]]


@dataclass(frozen=True)
class Finding:
    """A number that is to lie in a range, bounds included."""

    panel: str
    quantity: str
    lowest: float
    highest: float
    measured: float

    @property
    def holds(self) -> bool:
        """Whether it does."""
        return self.lowest <= self.measured <= self.highest


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the page of a file of settings; return 1 where that fails, 130 on Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        study = read_driving(load_settings(options.config), options.quick)
        options.output.mkdir(parents=True, exist_ok=True)
        results = simulated(study, options.workers)
        plate, findings = page(study, results)
        plate.save(options.output, 'driving')
        table = '\n'.join([*finding_lines(findings), '', *table_lines(results.moves)]) + '\n'
        (options.output / 'table.md').write_text(table, encoding='utf-8')
    except (OSError, ValueError, ArithmeticError) as error:
        print(f'driving: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('\ndriving: stopped; nothing new is written', file=sys.stderr)
        return _STOPPED
    print(f'{table}\npage and table are in {options.output}')
    return 0


def read_driving(settings: Section, quick: bool) -> DrivingStudy:
    """DrivingStudy of a file of settings; raises ValueError for what cannot be."""
    settings.allow(*_KEYS)
    books = {name: BooksTask.read(settings.section('books'), name) for name in MECHANICS}
    moves = read_study(settings.section('moves'), quick).tasks
    if quick:
        books = {name: replace(task, duration=_SHORT) for name, task in books.items()}
        moves = {key: tasks[:1] for key, tasks in moves.items()}
    return DrivingStudy(
        _step(settings.section('step')),
        _works(settings.section('work')),
        books,
        StiffnessTask.read(settings.section('stiffness'), quick),
        {name: TiltTask.read(settings.section('tilt'), name) for name in MECHANICS},
        moves,
    )


def simulated(study: DrivingStudy, workers: int) -> Results:
    """Results of all tasks, from processes side by side."""
    with local_processes(workers) as processes:
        moves = {
            key: [processes.submit(task) for task in tasks] for key, tasks in study.moves.items()
        }
        apart = [processes.submit(task) for task in reversed(study.stiffnesses)][::-1]
        books = {name: processes.submit(task) for name, task in study.books.items()}
        tilts = {name: processes.submit(task) for name, task in study.tilts.items()}
        works = {name: processes.submit(task) for name, task in study.works.items()}
        count = processes.unfinished
        progress = ProgressLine('driving', count)
        for done, future in enumerate(processes.finished(), start=1):
            future.result()
            progress.show(done)
    progress.end(f'driving: {count} runs made')
    return Results(
        {name: future.result() for name, future in works.items()},
        {name: future.result() for name, future in books.items()},
        [future.result() for future in apart],
        {name: future.result() for name, future in tilts.items()},
        {key: [future.result() for future in made] for key, made in moves.items()},
    )


def page(study: DrivingStudy, results: Results) -> tuple[Plate, list[Finding]]:
    """Draw the page of results, and say which numbers of it are to lie where."""
    plate, panels = blank_page()
    apart = draw_response(plate, panels['a'], PneumaticActuator(), study.step)
    draw_books(plate, panels['b'], results.books)
    stiffnesses = [task.chain.stiffness for task in study.stiffnesses]
    order = -float(np.polyfit(np.log(stiffnesses[-3:]), np.log(results.apart[-3:]), 1)[0])
    draw_stiffness(plate, panels['c'], stiffnesses, results.apart, order)
    draw_tilt(plate, panels['t'], panels['d'], results.tilts)
    draw_moves(plate, panels['e'], {key: runs[0] for key, runs in results.moves.items()})
    draw_work(plate, panels['f'], results.works)
    entitle(panels)
    highest = float(study.step.values.max())
    findings = [
        Finding('a', 'closed form off small steps, over the pressure', 0, 1e-6, apart / highest),
        *_book_findings(results),
        Finding('c', 'order in 1/k_e of the distance of springs from bars', 0.9, 1.1, order),
        *_tilt_findings(study, results),
        *_move_findings(results),
        *_work_findings(results),
    ]
    return plate, findings


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Lines of the table in Markdown."""
    return [
        '| panel | quantity | measured | to lie in | holds |',
        '| --- | --- | --- | --- | --- |',
        *(
            f'| {found.panel} | {found.quantity} | {found.measured:.3g} '
            f'| {found.lowest:g} to {found.highest:g} | {"yes" if found.holds else "no"} |'
            for found in findings
        ),
    ]


def _book_findings(results: Results) -> list[Finding]:
    title = 'largest imbalance of the energy books over the largest energy'
    return [
        Finding('b', f'{title}, {name}', 0, BOOKS_LIMIT, float(run.imbalances.max()))
        for name, run in results.books.items()
    ]


def _tilt_findings(study: DrivingStudy, results: Results) -> list[Finding]:
    """Where each tilt has left the wall, as its distance from the end that is then the lower."""
    findings = []
    for name, run in results.tilts.items():
        task = study.tilts[name]
        last = task.chain.number_of_rotors - 1
        lower = [last if tilt > 0 else 0 for tilt in task.tilts]
        left = run.places.reshape(len(task.tilts), -1)[:, -1]
        farthest = float(np.abs(left - lower).max())
        title = f'wall from the lower end after each tilt [rotor spacings], {name}'
        findings.append(Finding('d', title, 0, 2, farthest))
    return findings


def _move_findings(results: Results) -> list[Finding]:
    """Largest error of all moves of a chain, NaN where one has not been made."""
    findings = []
    for (name, title), runs in results.moves.items():
        reached = all(run.outcome is Outcome.REACHED for run in runs)
        error = max(run.error for run in runs) if reached else np.nan
        quantity = f'wall from its goal after its arrival [rotor spacings], {name}, {title}'
        findings.append(Finding('e', quantity, 0, 0.1, float(error)))
    return findings


def _work_findings(results: Results) -> list[Finding]:
    title = 'work booked off the energy gained, over the energy'
    return [
        Finding('f', f'{title}, {name}', 0, 1e-9, abs(float(run.works[-1] / run.energies[-1] - 1)))
        for name, run in results.works.items()
    ]


def _step(section: Section) -> Profile:
    section.allow('pressure', 'duration')
    pressure = section.number('pressure', 1.0, PneumaticActuator().highest_pressure)
    return trapezoid(pressure, 0.0, section.number('duration', 0.01, 10.0), 0.0)


def _works(section: Section) -> dict[str, WorkTask]:
    section.allow('chain', 'pressure', 'duration', 'ramp', 'saturation_torque')
    actuator = PneumaticActuator()
    pressure = section.number('pressure', 1.0, actuator.highest_pressure)
    duration = section.number('duration', 0.01, 10.0)
    ramp = section.number('ramp', 0.0, 10.0)
    order = EdgeOrder(Edge.FIRST, Kind.PRESSURE, pressure, duration, ramp, ramp)
    saturating = replace(
        actuator, saturation_torque=section.number('saturation_torque', 1e-9, 1e6)
    )
    chain = chain_from(section.section('chain'))
    return {
        'below saturation': WorkTask(chain, actuator, order),
        'saturated': WorkTask(chain, saturating, order),
    }


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='driving', description=__doc__)
    parser.add_argument('config', type=Path, help='settings, as config/studies/driving.yaml')
    parser.add_argument('--output', type=Path, default=Path('out/driving'), help='folder')
    parser.add_argument('--quick', action='store_true', help='fewer runs, to try it out')
    parser.add_argument(
        '--workers', type=process_count, default=os.cpu_count() or 1, help='processes [one a core]'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
