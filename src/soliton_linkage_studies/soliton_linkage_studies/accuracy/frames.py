# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo study of the single-frame estimators: accuracy, table and pictures."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle, product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.accuracy import estimators
from soliton_linkage_studies.accuracy.statistics import number_text
from soliton_linkage_studies.drawing import LEGEND_ABOVE, class_and_shape
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.palette import COLOURS, GREY, MARKERS, PALE, WHITE
from soliton_linkage_studies.settings import Section, chain_from
from soliton_linkage_studies.sweep.table import markdown_table

_CHUNK = 250
"""Number of frames per task [1]; each task has its own random seed."""
_COLUMNS = (
    *('class', 'r/a', 'rest angle [rad]', 'noise [rad]', 'estimator', 'frames'),
    *('bias [spacings]', 'standard error of the bias [spacings]', 'std [spacings]'),
    *('bound [spacings]', 'std / bound', 'coverage of 95 % [%]', 'failures'),
)
_TITLES = (
    *('class (r/a, θ̄)', 'noise [rad]', 'estimator', 'bias [spacings]', 'std / bound'),
    *('coverage of 95 %', 'failures'),
)
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
rotors, one panel per chain. The bias changes sign at the sharp minima of a line: by symmetry
at a rotor and half way between rotors. The thin dashed grey line marks {{unbiased:g}} rotor
spacings, below which an estimator is regarded as unbiased. Values below {{rounding:g}} are drawn
at this limit.

{_ESTIMATORS}
"""
_STYLES = dict(zip(estimators.ESTIMATORS, cycle(zip(COLOURS, MARKERS, strict=True)), strict=False))
_SIGNIFICANT = 3.0
"""The picture marks a bias as significant if it is above this [standard errors]; chance alone
exceeds it in 0.3 % of the cases."""
_UNBIASED = 0.002
"""Absolute bias below which an estimator is regarded as unbiased [rotor spacings], even if the
bias is significant; a dashed line in the pictures."""
_ROUNDING = 1e-12
"""Lower limit of the axis of noiseless biases [rotor spacings]."""
_BEYOND = 'position beyond an even rotor [rotor spacings]'


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of an estimator over many frames.

    Bias, standard deviation and coverage exclude the frames in which the estimator failed. They
    are NaN if fewer than two frames remain.
    """

    frames: int
    failures: int
    bias: float
    """Mean error [rotor spacings]."""
    bias_error: float
    """Standard error of the bias [rotor spacings]."""
    deviation: float
    """Standard deviation of the error [rotor spacings]."""
    bound: float
    """Cramer-Rao bound: smallest standard deviation of any unbiased estimator [rotor spacings]."""
    coverage: float
    """Fraction of frames whose stated interval contains the true position; also NaN if the
    estimator states no interval."""

    @property
    def ratio(self) -> float:
        """Standard deviation divided by the Cramer-Rao bound [1]."""
        return self.deviation / self.bound


@dataclass(frozen=True)
class Line:
    """Accuracy of one estimator for one chain and one noise."""

    chain: Chain
    noise: float
    """Standard deviation of the noise of each angle [rad]."""
    estimator: str
    accuracy: Accuracy


def accuracy_of(samples: Array, bound: float) -> Accuracy:
    """Return the accuracy from errors and margins, shape (frames, 2); a NaN error is a failure."""
    succeeded = samples[np.isfinite(samples[:, 0])]
    errors, margins = succeeded.T
    known = len(errors) > 1
    deviation = float(errors.std(ddof=1)) if known else math.nan
    stated = known and bool(np.isfinite(margins).all())
    return Accuracy(
        frames=len(samples),
        failures=len(samples) - len(errors),
        bias=float(errors.mean()) if known else math.nan,
        bias_error=deviation / math.sqrt(len(errors)) if known else math.nan,
        deviation=deviation,
        bound=bound,
        coverage=float((np.abs(errors) <= margins).mean()) if stated else math.nan,
    )


def write_lines(lines: Sequence[Line], folder: Path) -> None:
    """Write the rows of the estimators as table.md and table.csv."""
    rows = []
    with (folder / 'table.csv').open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(_COLUMNS)
        for line in lines:
            chain, found, noise = line.chain, line.accuracy, f'{line.noise:g}'
            covered, ratio = 100 * found.coverage, chain.rotor_length / chain.spacing
            errors = (found.bias, found.bias_error, found.deviation, found.bound, found.ratio)
            texts = (number_text(each) for each in (*errors, covered))
            cell = chain.motion.value, f'{ratio:g}', f'{chain.rest_angle:g}', noise, line.estimator
            writer.writerow([*cell, found.frames, *texts, found.failures])
            bias, share = f'{found.bias:+.4f} ± {found.bias_error:.4f}', f'{found.ratio:.3f}'
            coverage = '' if math.isnan(covered) else f'{covered:.1f} %'
            failures = f'{found.failures} of {found.frames}'
            named = class_and_shape(chain), noise, line.estimator
            rows.append([*named, bias, share, coverage, failures])
    (folder / 'table.md').write_text(markdown_table(_TITLES, rows), encoding='utf-8')


@dataclass(frozen=True)
class FrameStudy:
    """Study of estimators: chains, noise and number of frames."""

    chains: tuple[Chain, ...]
    noises: tuple[float, ...]
    """Tested standard deviations of the noise of each angle [rad]."""
    trial: estimators.EstimatorTrial
    """Parameters of the tested frames; their noise is replaced by each of `noises` in turn."""
    seed: int

    def tasks(self) -> list[Callable[[], Any]]:
        """Return one task per chunk of frames, then one task per chain for the bias."""
        cells = product(range(len(self.chains)), range(len(self.noises)), range(self._chunks))
        return [
            *(partial(self.sample, *numbers) for numbers in cells),
            *(partial(estimators.bias_by_position, chain, 81) for chain in self.chains),
        ]

    def write(self, results: Sequence[Any], folder: Path) -> None:
        """Write tables and pictures; `results` are the results of the tasks in order."""
        biases = list(zip(self.chains, results[-len(self.chains) :], strict=True))
        lines = self.lines(results[: -len(self.chains)])
        write_lines(lines, folder)
        draw_accuracy(lines).save(folder, 'single_frame')
        draw_bias(biases).save(folder, 'bias_by_position')

    def sample(self, chain: int, noise: int, chunk: int) -> dict[str, Array]:
        """Return `errors` for one chunk of frames, given the indices of chain, noise and chunk."""
        frames = min(_CHUNK, self.trial.frames - chunk * _CHUNK)
        trial = replace(self.trial, frames=frames, noise=self.noises[noise])
        generator = np.random.default_rng([self.seed, chain, noise, chunk])
        return estimators.errors(self.chains[chain], trial, generator)

    def lines(self, samples: Sequence[dict[str, Array]]) -> list[Line]:
        """Return the table rows from the results of `sample`, in the order of `tasks`."""
        lines = []
        cells = list(product(self.chains, self.noises))
        for cell, (chain, noise) in enumerate(cells):
            chunks = samples[cell * self._chunks : (cell + 1) * self._chunks]
            for name in estimators.estimators_of(chain):
                pairs = np.concatenate([chunk[name] for chunk in chunks])
                lines.append(
                    Line(chain, noise, name, accuracy_of(pairs, estimators.bound(chain, noise)))
                )
        return lines

    @property
    def _chunks(self) -> int:
        return math.ceil(self.trial.frames / _CHUNK)


def read_frame_study(section: Section, quick: bool) -> FrameStudy:
    """Read the settings. Raises ValueError for invalid settings."""
    values = section.values_of(estimators.EstimatorTrial, 'chains', 'noises', 'seed')
    trial = estimators.EstimatorTrial(math.nan, **values)
    if quick:
        trial = replace(trial, frames=min(trial.frames, 400))
    chains = tuple(_chain_of(each) for each in section.sections('chains').values())
    noises, seed = section.numbers('noises', 1e-9, 1.0), section.whole_number('seed', 0, 2**32)
    return FrameStudy(chains, noises, trial, seed)


def _chain_of(section: Section) -> Chain:
    chain = chain_from(section)
    low, high = estimators.inner_positions(chain)
    if low >= high:
        fewest = math.floor(2 * low) + 2
        raise section.error(
            'number_of_rotors',
            f'leaves no position at a distance of two wall widths ({low:.3g} spacings) from both '
            f'edges; use {fewest} or more',
        )
    return chain


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
    handles = [mark_handle(name, *_STYLES[name]) for name in _STYLES if name in drawn]
    handles.append(mark_handle(f'hollow: within {_SIGNIFICANT:g} standard errors of 0', GREY, 'o'))
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
        axes.plot(x, y, marker, color=colour, markerfacecolor=face, markersize=6)
        report.add_points(panel, series, ('number of the chain', name), position, y)


def _dress(column: Sequence[Axes], noise: float, names: Sequence[str]) -> None:
    column[0].set(title=f'noise {noise:g} rad')
    for axes, level in zip(column, (1.0, _UNBIASED, 95.0), strict=True):
        axes.axhline(level, color=GREY, linewidth=0.8, linestyle='--', zorder=0)
        for position in range(1, len(names)):
            axes.axvline(position - 0.5, color=PALE, linewidth=0.8, zorder=0)
    column[-1].set_xticks(range(len(names)), names, rotation=40, ha='right')


def _dashes(name: str) -> Literal['-', ':']:
    return ':' if name == estimators.ORBIT_COLD else '-'


def _level(label: str) -> Line2D:
    return Line2D([], [], color=GREY, linewidth=0.8, linestyle='--', label=label)


def mark_handle(name: str, colour: str, marker: str) -> Line2D:
    """Return the entry of a legend for a marker."""
    return Line2D([], [], color=colour, marker=marker, linestyle='', markersize=6, label=name)
