# SPDX-License-Identifier: Apache-2.0
"""Measure how well walls are measured, and whether what the analyser states of them is true.

Estimators are set against their bound, contraction of walls against theory, and stated deviations
against errors, in cells drawn at random and in hard cases; rigid bars take a million steps.
Writes tables as Markdown and CSV and pictures as PNG and PDF. They depend on the settings and the
seed of the cells alone, not on the number of processes, nor on interruptions.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from soliton_linkage_studies.accuracy.cells.program import run_cells
from soliton_linkage_studies.accuracy.cells.study import read_cell_study
from soliton_linkage_studies.accuracy.contraction import read_contraction_study
from soliton_linkage_studies.accuracy.frames import read_frame_study
from soliton_linkage_studies.accuracy.record import read_record_study
from soliton_linkage_studies.accuracy.rigid_steps import read_rigid_steps
from soliton_linkage_studies.program import chosen, run_study, side_by_side, study_parser
from soliton_linkage_studies.settings import Section, load_settings


class AccuracyPart(Protocol):
    """One of the studies that a file of settings may ask for."""

    def tasks(self) -> list[Callable[[], Any]]:
        """What there is to measure, in pieces for other processes."""

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures into a folder, from the results of the tasks in order."""


PARTS: dict[str, Callable[[Section, bool], AccuracyPart]] = {
    'single_frame': read_frame_study,
    'contraction': read_contraction_study,
    'record': read_record_study,
    'rigid_steps': read_rigid_steps,
}


CELLS = 'cells'
_LEFT = 'of the cells, the same command with the same --seed goes on where it was'


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what a file of settings says; return 1 where that fails, 130 on Ctrl-C."""
    parser = study_parser('accuracy', __doc__, 'fewer frames', selective=True)
    cells = parser.add_argument_group('cells of the analyser, which alone are measured then')
    cells.add_argument('--cells', nargs='+', default=[], metavar='NAME', help='these [all]')
    cells.add_argument('--frames', type=_count, help='of each cell [as the settings say]')
    cells.add_argument('--seed', type=_count, help='that draws them [the date, 20261231]')
    cells.add_argument('--against', type=Path, metavar='CSV', help='earlier table: what is worse')
    return run_study(parser, arguments, _written, _LEFT)


def _written(options: argparse.Namespace) -> str:
    settings = load_settings(options.config)
    alone = options.cells or options.frames or options.seed or options.against
    names = [CELLS] if alone else chosen(list(settings.values), options.only)
    study = None
    if CELLS in names:
        seed = options.seed or int(time.strftime('%Y%m%d'))
        section = settings.section(CELLS)
        study = read_cell_study(section, options.quick, seed, options.frames, options.cells)
    said = []
    if set(names) - {CELLS}:
        values = {name: settings.values[name] for name in names if name != CELLS}
        said.append(_parts_written(replace(settings, values=values), options))
    if study:
        folder = options.output / f'{study.name}_{study.seed}'
        said.append(run_cells(study, folder, options.workers, options.against))
    return '\n'.join(said)


def _parts_written(settings: Section, options: argparse.Namespace) -> str:
    parts = read_parts(settings, options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    results = measured([task for part in parts for task in part.tasks()], options.workers)
    for part in parts:
        count = len(part.tasks())
        part.write(results[:count], options.output)
        results = results[count:]
    return f'tables and pictures are in {options.output}'


def _count(text: str) -> int:
    """Whole number above 0 of a command line; raises ArgumentTypeError for what is none."""
    if not (text.isdecimal() and text.isascii() and int(text)):
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number above 0')
    return int(text)


def read_parts(settings: Section, quick: bool) -> list[AccuracyPart]:
    """Parts of a file of settings, all checked; raises ValueError for what cannot be measured."""
    settings.allow(*PARTS, CELLS)
    if not settings.values:
        raise ValueError(f'{settings.file}: is empty; give one or more of {", ".join(PARTS)}')
    return [
        read(settings.section(name), quick)
        for name, read in PARTS.items()
        if name in settings.values
    ]


def measured(tasks: Sequence[Callable[[], Any]], workers: int) -> list[Any]:
    """Results of tasks in their order.

    They are begun in a mixed order, so that those done so far tell how long the rest will take.
    """
    order = np.random.default_rng(0).permutation(len(tasks)).tolist()
    results = side_by_side('accuracy', {number: tasks[number] for number in order}, workers)
    return [results[number] for number in range(len(tasks))]


if __name__ == '__main__':
    sys.exit(main())
