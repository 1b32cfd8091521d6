# SPDX-License-Identifier: Apache-2.0
"""Measure errors of estimators, and check the standard deviations that the analyser states.

The errors of estimators are compared with the Cramer-Rao bound, the contraction of walls with
theory, and the errors of the analyser in test cells with its stated standard deviations. Rigid
bars are simulated for a million steps. The results depend only on the settings and the seed of the
cells, not on the number of processes or on interruptions.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from soliton_linkage_studies.accuracy.contraction import read_contraction_study
from soliton_linkage_studies.accuracy.frames import read_frame_study
from soliton_linkage_studies.accuracy.record import read_record_study
from soliton_linkage_studies.accuracy.rigid_steps import read_rigid_steps
from soliton_linkage_studies.accuracy.runs import CellStudy, read_cell_study
from soliton_linkage_studies.accuracy.statistics import (
    check_comparable,
    draw_cells,
    worse_cells,
    write_cells,
)
from soliton_linkage_studies.program import run_parallel, run_study, select_names, study_parser
from soliton_linkage_studies.settings import Section, load_settings
from soliton_linkage_studies.sweep.table import fill_table, read_rows


class AccuracyPart(Protocol):
    """Independent part of the study, with its own section in the settings file."""

    def tasks(self) -> list[Callable[[], Any]]:
        """Return the measurements as tasks that other processes can run."""

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures; `results` are the results of the tasks in order."""


PARTS: dict[str, Callable[[Section, bool], AccuracyPart]] = {
    'single_frame': read_frame_study,
    'contraction': read_contraction_study,
    'record': read_record_study,
    'rigid_steps': read_rigid_steps,
}
CELLS = 'cells'
_LEFT = 'finished cells are kept; the same command with the same --seed continues the measurement'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `accuracy` and return its exit status."""
    parser = study_parser('accuracy', __doc__, 'fewer frames', selective=True)
    title = 'cells of the analyser (each of these options selects only the cells)'
    cells = parser.add_argument_group(title)
    many: Any = {'nargs': '+', 'default': [], 'metavar': 'NAME'}
    cells.add_argument('--cells', help='cells to measure [all]', **many)
    cells.add_argument('--frames', type=_count, help='frames of each cell [from the settings]')
    about = 'seed of the random cells [the date as YYYYMMDD]'
    cells.add_argument('--seed', type=_count, help=about)
    cells.add_argument('--against', type=Path, metavar='CSV', help='earlier table to compare with')
    return run_study(parser, arguments, _written, _LEFT)


def _written(options: argparse.Namespace) -> str:
    settings = load_settings(options.config)
    alone = options.cells or options.frames or options.seed or options.against
    names = [CELLS] if alone else select_names(list(settings.values), options.only)
    parts = read_parts(settings, options.quick, names)
    study = None
    if CELLS in names:
        seed = options.seed or int(time.strftime('%Y%m%d'))
        section = settings.section(CELLS)
        study = read_cell_study(section, options.quick, seed, options.frames, options.cells)
    said = []
    if parts:
        options.output.mkdir(parents=True, exist_ok=True)
        _measure(parts, options.output, options.workers)
        said.append(f'tables and pictures are in {options.output}')
    if study:
        folder = options.output / f'{study.name}_{study.seed}'
        said += _fill_cells(study, folder, options.workers, options.against)
    return '\n'.join(said)


def read_parts(
    settings: Section, quick: bool, names: Sequence[str] | None = None
) -> list[AccuracyPart]:
    """Read the named parts, or all parts. Raises ValueError for invalid settings."""
    settings.check_keys(*PARTS, CELLS)
    if not settings.values:
        raise ValueError(f'{settings.file}: is empty; give one or more of {", ".join(PARTS)}')
    asked = settings.values if names is None else names
    return [read(settings.section(name), quick) for name, read in PARTS.items() if name in asked]


def _measure(parts: Sequence[AccuracyPart], folder: Path, workers: int) -> None:
    tasks = [task for part in parts for task in part.tasks()]
    order = np.random.default_rng(0).permutation(len(tasks)).tolist()
    done = run_parallel('accuracy', {number: tasks[number] for number in order}, workers)
    results = iter([done[number] for number in range(len(tasks))])
    for part in parts:
        part.write([next(results) for _ in part.tasks()], folder)


def _fill_cells(study: CellStudy, folder: Path, workers: int, against: Path | None) -> list[str]:
    earlier = read_rows(against) if against else []
    if against:
        check_comparable(study.all, study.seed, earlier)
    print(f'cells: seed {study.seed}, in {folder}')
    _, rows = fill_table(study, folder, workers)
    write_cells(rows, folder / 'table.md')
    draw_cells(rows, study.seed, study.frames).save(folder, 'normalised_errors')
    said = [f'{len(rows)} cells of seed {study.seed} are in {folder}']
    return [*said, *worse_cells(rows, earlier)] if against else said


def _count(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and int(text)):
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number above 0')
    return int(text)
