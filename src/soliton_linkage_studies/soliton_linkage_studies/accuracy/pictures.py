# SPDX-License-Identifier: Apache-2.0
"""Pictures and tables of the errors of estimators and of the analyser."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Array, Chain, Motion
from soliton_linkage_studies.accuracy.estimators import ESTIMATORS, ORBIT_COLD
from soliton_linkage_studies.accuracy.statistics import Line, Row
from soliton_linkage_studies.drawing import LEGEND_ABOVE, class_and_shape
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.palette import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    MARKERS,
    ORANGE,
    PALE,
    WHITE,
)
from soliton_linkage_studies.sweep.table import markdown_table

_ESTIMATORS = """ Each estimator has a colour and a marker: the zero crossing of u; for spinners
also the zero crossing of cos(θ − θ̄); a tanh fit; the nearest point of the orbit of the chain,
found from an initial guess; and the same point found without a guess. Chains are named by class
and (r/a, θ̄).
"""
_FRAMES = f""" Errors of the wall position estimated from single noisy frames, one column per
noise. (a) Standard deviation of the error, divided by the Cramér-Rao bound. The dashed line at 1
is the bound; a biased estimator may be below it. (b) Absolute bias. Markers are hollow if the bias
is within {{significant:g}} standard errors of 0 and therefore not significant. The dashed line
marks {{unbiased:g}} rotor spacings, below which an estimator is regarded as unbiased. (c) Fraction
of frames whose stated 95 % interval contains the position. The dashed line marks 95 %. Estimators
without an interval have no point. Thin pale grey lines separate the chains.

{_ESTIMATORS}
"""
_BIASES = f""" Absolute bias of estimators without noise against the wall position between two even
rotors, one panel per chain. The bias changes sign where a line dips: by symmetry at a rotor and
half way between rotors. The thin dashed grey line marks {{unbiased:g}} rotor spacings, below which
an estimator is regarded as unbiased. Values below {{rounding:g}} are drawn at this limit.

{_ESTIMATORS}
"""
_STYLES = dict(zip(ESTIMATORS, cycle(zip(COLOURS, MARKERS, strict=True)), strict=False))
_SIZE = 6
"""Marker size [points]."""
_SIGNIFICANT = 3.0
"""Biases above this count as nonzero [standard errors]; 0.3 % of unbiased cases exceed it."""
_UNBIASED = 0.002
"""An estimator counts as unbiased if its absolute bias is below this [rotor spacings]."""
_ROUNDING = 1e-12
"""Lower limit of the axis of noiseless biases [rotor spacings]."""
_BEYOND = 'position beyond an even rotor [rotor spacings]'


def draw_accuracy(lines: Sequence[Line]) -> FigureReport:
    """Draw std / Cramer-Rao bound, bias and coverage of the estimators, one column per noise."""
    noises = sorted({line.noise for line in lines})
    chains = list(dict.fromkeys(line.chain for line in lines))
    width = 1.5 + 0.6 * (len(chains) + 1) * len(noises)
    caption = _FRAMES.format(significant=_SIGNIFICANT, unbiased=_UNBIASED)
    report = new_report(caption, max(width, 9), 9)
    panels = report.figure.subplots(3, len(noises), sharex=True, sharey='row', squeeze=False)
    for column, noise in zip(panels.T, noises, strict=True):
        for line in lines:
            if line.noise == noise:
                _draw_line(report, column, line, chains.index(line.chain))
        _dress(column, noise, [class_and_shape(chain) for chain in chains])
    panels[0, 0].set(ylabel='a  standard deviation / bound [1]', yscale='log')
    panels[1, 0].set(ylabel='b  |bias| [rotor spacings]', yscale='log')
    panels[1, 0].set_ylim(bottom=1e-5)
    panels[2, 0].set(ylabel='c  coverage of the stated 95 % [%]', ylim=(50, 101))
    drawn = {line.estimator for line in lines}
    handles = [_handle(name, *_STYLES[name]) for name in _STYLES if name in drawn]
    handles.append(_handle(f'hollow: within {_SIGNIFICANT:g} standard errors of 0', GREY, 'o'))
    handles[-1].set_markerfacecolor(WHITE)
    report.figure.legend(handles=handles, loc=LEGEND_ABOVE, ncols=4)
    labels = 'Cramér-Rao bound', f'unbiased below {_UNBIASED:g}', 'stated 95 %'
    for axes, label in zip(panels[:, 0], labels, strict=True):
        axes.legend(handles=[_level(label)], loc='best', fontsize=8)
    return report


def draw_bias(biases: Sequence[tuple[Chain, tuple[Array, dict[str, Array]]]]) -> FigureReport:
    """Draw the bias without noise against the position between rotors, one panel per chain."""
    rows = (len(biases) + 2) // 3
    caption = _BIASES.format(unbiased=_UNBIASED, rounding=_ROUNDING)
    report = new_report(caption, 13, 1 + 3.6 * rows)
    columns = min(len(biases), 3)
    panels = report.figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    names: set[str] = set()
    axes_names = (_BEYOND, 'bias [rotor spacings]')
    for axes, (chain, (positions, found)) in zip(panels.flat, biases, strict=False):
        for name, bias in found.items():
            colour, _ = _STYLES[name]
            size = np.maximum(np.abs(bias), _ROUNDING)
            axes.plot(positions, size, _dashes(name), color=colour, linewidth=2)
            report.add_points(class_and_shape(chain), name, axes_names, positions, bias)
            names.add(name)
        axes.axhline(_UNBIASED, color=GREY, linewidth=0.8, linestyle='--')
        axes.set(title=class_and_shape(chain), yscale='log', ylim=(_ROUNDING, 9))
    for axes in panels[-1]:
        axes.set(xlabel='position beyond an even rotor [rotor spacings]')
    for axes in panels[:, 0]:
        axes.set(ylabel='|bias| [rotor spacings]')
    handles = [
        Line2D([], [], color=colour, linestyle=_dashes(name), linewidth=2, label=name)
        for name, (colour, _) in _STYLES.items()
        if name in names
    ]
    handles.append(_level(f'unbiased below {_UNBIASED:g} rotor spacings'))
    report.figure.legend(handles=handles, loc=LEGEND_ABOVE, ncols=len(handles))
    return report


def _draw_line(report: FigureReport, column: Sequence[Axes], line: Line, position: int) -> None:
    found, colour, marker = line.accuracy, *_STYLES[line.estimator]
    x = position + 0.15 * (list(_STYLES).index(line.estimator) - (len(_STYLES) - 1) / 2)
    panel = f'noise {line.noise:g} rad'
    series = f'{line.estimator}, {class_and_shape(line.chain)}'
    unlike_0 = abs(found.bias) > _SIGNIFICANT * found.bias_error
    for axes, name, y, filled in (
        (column[0], 'std / bound [1]', found.ratio, True),
        (column[1], '|bias| [rotor spacings]', abs(found.bias), unlike_0),
        (column[2], 'coverage [%]', 100 * found.coverage, True),
    ):
        face = colour if filled else WHITE
        axes.plot(x, y, marker, color=colour, markerfacecolor=face, markersize=_SIZE)
        report.add_points(panel, series, ('number of the chain', name), position, y)


def _dress(column: Sequence[Axes], noise: float, names: Sequence[str]) -> None:
    column[0].set(title=f'noise {noise:g} rad')
    for axes, level in zip(column, (1.0, _UNBIASED, 95.0), strict=True):
        axes.axhline(level, color=GREY, linewidth=0.8, linestyle='--', zorder=0)
        for position in range(1, len(names)):
            axes.axvline(position - 0.5, color=PALE, linewidth=0.8, zorder=0)
    column[-1].set_xticks(range(len(names)), names, rotation=40, ha='right')


def _dashes(name: str) -> Literal['-', ':']:
    return ':' if name == ORBIT_COLD else '-'


def _handle(name: str, colour: str, marker: str) -> Line2D:
    return Line2D([], [], color=colour, marker=marker, linestyle='', markersize=_SIZE, label=name)


def _level(label: str) -> Line2D:
    return Line2D([], [], color=GREY, linewidth=0.8, linestyle='--', label=label)


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


def draw_cells(rows: Sequence[Row], seed: int, frames: int) -> FigureReport:
    """Draw the normalised errors and the failures of all cells."""
    width = max(10.0, 3 + 0.16 * len(rows))
    figure = Figure(figsize=(width, 11), layout='constrained')
    report = FigureReport(figure, _CAPTION.format(seed=seed, frames=frames))
    panels = figure.subplots(3, 1, sharex=True)
    for axes, name in zip(panels, ('position', 'rate'), strict=False):
        for number, row in enumerate(rows):
            _draw_errors(report, axes, name, number, row)
        for limit in (0.95, 1.05):
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
    handles = [_handle(*mark) for mark in marks]
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
