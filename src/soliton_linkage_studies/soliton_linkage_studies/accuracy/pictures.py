# SPDX-License-Identifier: Apache-2.0
"""Pictures of how well estimators tell the place of a wall."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.accuracy.estimators import ESTIMATORS, ORBIT_COLD
from soliton_linkage_studies.accuracy.table import Line
from soliton_linkage_studies.captions import class_and_shape
from soliton_linkage_studies.drawing import ABOVE
from soliton_linkage_studies.palette import COLOURS, GREY, MARKERS, PALE, WHITE
from soliton_linkage_studies.plates import Plate

_ESTIMATORS = """
Estimators, a colour and a marker each: the zero crossing of u, for spinners also that of
cos(θ − θ̄); a fit of tanh; the nearest point of the orbit of the chain, found from a guess, and the
same found cold, without one. Chains are named by class and (r/a, θ̄).
"""
_FRAMES = f"""
How well single frames of noisy angles tell the place of a wall, a column for each noise.
(a) Standard deviation of the error over its least, the bound of Cramér and Rao, which is the
dashed line at 1; an estimator that is biased may be below it. (b) Absolute bias, hollow where it
is within {{significant:g}} standard errors of 0, so that chance can make it; the dashed line is
{{unbiased:g}} rotor spacings, below which an estimator is taken for unbiased. (c) Share of the
frames in which the stated interval of 95 % holds the place; the dashed line is at 95 %. Those that
state no interval have no point. Thin pale grey lines part the chains.

{_ESTIMATORS}
"""
_BIASES = f"""
Absolute bias of estimators without noise against the place of the wall between two even rotors, a
panel for each chain. Bias changes sign where a line dips: by symmetry at a rotor and half
way between rotors. The thin dashed grey line is {{unbiased:g}} rotor spacings, below which an
estimator is taken for unbiased; less than {{rounding:g}} is drawn as that.

{_ESTIMATORS}
"""
_STYLES = dict(zip(ESTIMATORS, cycle(zip(COLOURS, MARKERS, strict=True)), strict=False))
"""Colour and marker of each estimator."""
_SIZE = 6
"""Of a marker [points]."""
_OFFSET = 0.15
"""From estimator to estimator of a chain, the chains being 1 apart."""
_SIGNIFICANT = 3.0
"""Standard errors from which on a bias is taken for one: chance makes it so in 0.3 %."""
_UNBIASED = 0.002
"""Bias that is drawn as a limit [rotor spacings], far below any bound on the spread."""
_LEAST_BIAS = 1e-5
"""Lower end of the scale of a bias [rotor spacings]."""
_ROUNDING = 1e-12
"""Drawn in place of a bias without noise that is less [rotor spacings]."""
_BEYOND = 'place beyond an even rotor [rotor spacings]'


def draw_accuracy(lines: Sequence[Line]) -> Plate:
    """Spread over its bound, bias and coverage, in a column of panels for each noise."""
    noises = sorted({line.noise for line in lines})
    chains = list(dict.fromkeys(line.chain for line in lines))
    width = 1.5 + 0.6 * (len(chains) + 1) * len(noises)
    caption = _FRAMES.format(significant=_SIGNIFICANT, unbiased=_UNBIASED)
    plate = Plate(Figure(figsize=(max(width, 9), 9), layout='constrained'), caption)
    panels = plate.figure.subplots(3, len(noises), sharex=True, sharey='row', squeeze=False)
    for column, noise in zip(panels.T, noises, strict=True):
        for line in lines:
            if line.noise == noise:
                _draw_line(plate, column, line, chains.index(line.chain))
        _dress(column, noise, [class_and_shape(chain) for chain in chains])
    panels[0, 0].set(ylabel='a  standard deviation / bound [1]', yscale='log')
    panels[1, 0].set(ylabel='b  |bias| [rotor spacings]', yscale='log')
    panels[1, 0].set_ylim(bottom=_LEAST_BIAS)
    panels[2, 0].set(ylabel='c  coverage of the stated 95 % [%]', ylim=(50, 101))
    drawn = {line.estimator for line in lines}
    handles = [_handle(name, *_STYLES[name]) for name in _STYLES if name in drawn]
    handles.append(_handle(f'hollow: within {_SIGNIFICANT:g} standard errors of 0', GREY, 'o'))
    handles[-1].set_markerfacecolor(WHITE)
    plate.figure.legend(handles=handles, loc=ABOVE, ncols=4)
    for axes, words in zip(
        panels[:, 0],
        ('bound of Cramér and Rao', f'unbiased below {_UNBIASED:g}', 'stated 95 %'),
        strict=True,
    ):
        axes.legend(handles=[_level(words)], loc='best', fontsize=8)
    return plate


def draw_bias(biases: Sequence[tuple[Chain, tuple[Array, dict[str, Array]]]]) -> Plate:
    """Bias without noise against the place between rotors, a panel for each chain."""
    rows = (len(biases) + 2) // 3
    caption = _BIASES.format(unbiased=_UNBIASED, rounding=_ROUNDING)
    plate = Plate(Figure(figsize=(13, 1 + 3.6 * rows), layout='constrained'), caption)
    panels = plate.figure.subplots(
        rows, min(len(biases), 3), sharex=True, sharey=True, squeeze=False
    )
    names: set[str] = set()
    for axes, (chain, (places, found)) in zip(panels.flat, biases, strict=False):
        for name, bias in found.items():
            colour, _ = _STYLES[name]
            size = np.maximum(np.abs(bias), _ROUNDING)
            axes.plot(places, size, _dashes(name), color=colour, linewidth=2)
            plate.note(
                class_and_shape(chain), name, (_BEYOND, 'bias [rotor spacings]'), places, bias
            )
            names.add(name)
        axes.axhline(_UNBIASED, color=GREY, linewidth=0.8, linestyle='--')
        axes.set(title=class_and_shape(chain), yscale='log', ylim=(_ROUNDING, 9))
    for axes in panels[-1]:
        axes.set(xlabel=_BEYOND)
    for axes in panels[:, 0]:
        axes.set(ylabel='|bias| [rotor spacings]')
    handles = [
        Line2D([], [], color=colour, linestyle=_dashes(name), linewidth=2, label=name)
        for name, (colour, _) in _STYLES.items()
        if name in names
    ]
    handles.append(_level(f'unbiased below {_UNBIASED:g} rotor spacings'))
    plate.figure.legend(handles=handles, loc=ABOVE, ncols=len(handles))
    return plate


def _draw_line(plate: Plate, column: Sequence[Axes], line: Line, place: int) -> None:
    found, colour, marker = line.accuracy, *_STYLES[line.estimator]
    x = place + _OFFSET * (list(_STYLES).index(line.estimator) - (len(_STYLES) - 1) / 2)
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
        plate.note(panel, series, ('number of the chain', name), place, y)


def _dress(column: Sequence[Axes], noise: float, names: Sequence[str]) -> None:
    column[0].set(title=f'noise {noise:g} rad')
    for axes, level in zip(column, (1.0, _UNBIASED, 95.0), strict=True):
        axes.axhline(level, color=GREY, linewidth=0.8, linestyle='--', zorder=0)
        for place in range(1, len(names)):
            axes.axvline(place - 0.5, color=PALE, linewidth=0.8, zorder=0)
    column[-1].set_xticks(range(len(names)), names, rotation=40, ha='right')


def _dashes(name: str) -> Literal['-', ':']:
    """Return the style of a line, which lets that beneath a cold search be seen."""
    return ':' if name == ORBIT_COLD else '-'


def _handle(name: str, colour: str, marker: str) -> Line2D:
    return Line2D([], [], color=colour, marker=marker, linestyle='', markersize=_SIZE, label=name)


def _level(words: str) -> Line2D:
    return Line2D([], [], color=GREY, linewidth=0.8, linestyle='--', label=words)
