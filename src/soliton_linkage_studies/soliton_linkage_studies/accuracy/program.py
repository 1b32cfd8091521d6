# SPDX-License-Identifier: Apache-2.0
"""Measure errors of estimators, and check the standard deviations that the analyser states.

The errors of estimators are compared with the Cramer-Rao bound, the contraction of walls with
theory, and the errors of the analyser in test cells with its stated standard deviations. The
errors of bar lengths and energy are measured over a million steps of the rigid-bar simulation. The
results depend only on the settings and the seed of the cells, not on the number of processes or on
interruptions.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from soliton_linkage.linkage.chain import Motion
from soliton_linkage_studies.accuracy.contraction import read_contraction_study
from soliton_linkage_studies.accuracy.frames import mark_handle, read_frame_study
from soliton_linkage_studies.accuracy.record import read_record_study
from soliton_linkage_studies.accuracy.rigid_steps import read_rigid_steps
from soliton_linkage_studies.accuracy.runs import CellStudy, read_cell_study
from soliton_linkage_studies.accuracy.statistics import (
    CONSISTENT,
    Row,
    check_comparable,
    worse_cells,
)
from soliton_linkage_studies.drawing import LEGEND_ABOVE
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.palette import BLACK, BLUE, GREEN, GREY, ORANGE, PALE
from soliton_linkage_studies.program import run_parallel, run_study, select_names, study_parser
from soliton_linkage_studies.settings import Section, load_settings
from soliton_linkage_studies.sweep.table import fill_table, markdown_table, read_rows

_CAPTION = """ Errors of the analyser in cells of {frames} frames each. Random cells, drawn with
seed {seed}, are on the left, and named hard cases on the right. Flippers are blue, wobbling
flippers orange and spinners green. (a) Root mean square of the position error divided by its
stated standard deviation. (b) The same for the rate. Error bars are jackknife standard errors over
records. Dashed lines mark 0.95 and 1.05. (c) Failures per 10,000 frames, if any: lost walls
(discs), false walls (triangles) and frames with the wrong leg (black crosses). The true position
is the point of the static path nearest to the noiseless frame, averaged over a period of the
slowest phonon, or over the passage of a rotor if that is shorter. The true rate is the slope over
three times this duration.
"""
_COLOURS = {Motion.FLIPPER: BLUE, Motion.WOBBLING_FLIPPER: ORANGE, Motion.SPINNER: GREEN}
_LABELS = (
    'a  position error / stated, rms [1]',
    'b  rate error / stated, rms [1]',
    'c  failures per 10,000 frames [1]',
)
_MOST = 20.0
"""Larger normalised errors are drawn at this value [1]."""
_SHOWN = (
    ('cell', '', ''),
    ('class', '', ''),
    ('N', 'rotors', ''),
    ('d / d_c', 'd_over_critical', '.3f'),
    ('noise [rad]', 'noise', '.3g'),
    ('v / c', 'speed', '.2g'),
    ('walls', 'walls', ''),
    ('phonons', 'phonons', '.2g'),
    ('position rms', 'position_rms', '.2f'),
    ('±', 'position_rms_error', '.2f'),
    ('99 %', 'position_99', '.2f'),
    ('in 1, 2 σ [%]', 'position_coverage', ''),
    ('bias [σ]', 'position_bias', '+.2f'),
    ('instant rms', 'instant_rms', '.2f'),
    ('rate rms', 'rate_rms', '.2f'),
    ('± ', 'rate_rms_error', '.2f'),
    ('in 1, 2 σ [%] ', 'rate_coverage', ''),
    ('σ [spacings]', 'deviation_median', '.2g'),
    ('shift [σ]', 'shift_max', '.2g'),
    ('lost', 'lost', '.0f'),
    ('false', 'false', '.0f'),
    ('leg', 'wrong_leg', '.0f'),
    ('failure', '', ''),
)


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


def draw_cells(rows: Sequence[Row], seed: int, frames: int) -> FigureReport:
    """Draw the normalised errors and the failures of all cells."""
    width = max(10.0, 3 + 0.16 * len(rows))
    figure = Figure(figsize=(width, 11), layout='constrained')
    report = FigureReport(figure, _CAPTION.format(seed=seed, frames=frames))
    panels = figure.subplots(3, 1, sharex=True)
    for axes, name in zip(panels, ('position', 'rate'), strict=False):
        for number, row in enumerate(rows):
            _draw_errors(report, axes, name, number, row)
        for limit in CONSISTENT:
            axes.axhline(limit, color=GREY, linestyle='--', linewidth=0.8, zorder=0)
    for number, row in enumerate(rows):
        _draw_failures(report, panels[2], number, row)
    for axes, label in zip(panels, _LABELS, strict=True):
        axes.set(ylabel=label, yscale='log')
    names = [row['cell'] for row in rows]
    panels[2].set_xticks(range(len(rows)), names, rotation=90, fontsize=7)
    hard = next((n for n, name in enumerate(names) if not name.isdecimal()), len(names))
    for axes in panels:
        axes.axvline(hard - 0.5, color=PALE, linewidth=1.5, zorder=0)
        axes.set_xlim(-1, len(rows))
    marks = [(motion.value, colour, 'o') for motion, colour in _COLOURS.items()]
    marks += [('c: lost', GREY, 'o'), ('c: false', GREY, '^'), ('c: wrong leg', BLACK, 'x')]
    handles = [mark_handle(*mark) for mark in marks]
    figure.legend(handles=handles, loc=LEGEND_ABOVE, ncols=6)
    return report


def write_cells(rows: Sequence[Row], path: Path) -> None:
    """Write the table of the cells as Markdown."""
    titles = [title for title, _, _ in _SHOWN]
    shown = ([_shown(row, *each) for each in _SHOWN] for row in rows)
    path.write_text(markdown_table(titles, shown), encoding='utf-8')


def _shown(row: Row, title: str, name: str, form: str) -> str:
    if name.endswith('_coverage'):
        both = (row[f'{name}_1'], row[f'{name}_2'])
        return ', '.join(f'{float(each):.0f}' for each in both) if all(both) else ''
    text = row[name or title]
    return f'{float(text):{form}}' if form and text else text.replace('|', '∣')


def _draw_errors(report: FigureReport, axes: Axes, name: str, number: int, row: Row) -> None:
    text, error = row[f'{name}_rms'], row[f'{name}_rms_error']
    if not text:
        return
    rms = float(text)
    shown = min(rms, _MOST)
    colour = _COLOURS[Motion(row['class'])]
    bar = min(float(error), 0.9 * shown) if error else 0.0
    marker = 'o' if rms <= _MOST else '^'
    axes.errorbar(number, shown, bar, fmt=marker, color=colour, markersize=4, linewidth=1)
    report.add_points(name, row['cell'], ('cell', 'error / stated, rms [1]'), number, rms)


def _draw_failures(report: FigureReport, axes: Axes, number: int, row: Row) -> None:
    frames = float(row['frames'] or 'nan')
    colour = _COLOURS[Motion(row['class'])]
    for name, marker, shade, shift in (
        ('lost', 'o', colour, -0.2),
        ('false', '^', colour, 0.0),
        ('wrong_leg', 'x', BLACK, 0.2),
    ):
        share = 1e4 * float(row[name] or 'nan') / frames
        if share > 0:
            axes.plot(number + shift, share, marker, color=shade, markersize=4)
        if math.isfinite(share):
            report.add_points('failures', f'{row["cell"]}, {name}', ('cell', '1'), number, share)


def _count(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and int(text)):
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number above 0')
    return int(text)
