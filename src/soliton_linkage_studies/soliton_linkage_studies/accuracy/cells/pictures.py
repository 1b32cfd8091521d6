# SPDX-License-Identifier: Apache-2.0
"""The picture of the cells, and their table as Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Motion
from soliton_linkage_studies.drawing import ABOVE
from soliton_linkage_studies.palette import BLACK, BLUE, GREEN, GREY, ORANGE, PALE
from soliton_linkage_studies.plates import Plate

_CAPTION = """
What the analyser states against what is true, in cells of {frames} frames each, drawn at random
with the seed {seed}, and in named hard cases, on the right: blue are flippers, orange wobbling
flippers, green spinners. (a) Root mean square of the error of the place over its stated standard
deviation, and (b) the same of the rate; bars are standard errors by the jackknife over records,
the dashed lines are at 0.95 and 1.05. (c) Failures for each 10,000 frames, nothing where there
are none: walls that were lost (discs), walls that are none (triangles), and frames with the
wrong leg (black crosses). The true place is the nearest point of the static path to the noiseless
frame, on the mean of a period of the slowest phonon, or of the passage of a rotor where that is
shorter, and the true rate is the slope over three times as long.
"""
_COLOURS = {Motion.FLIPPER: BLUE, Motion.WOBBLING_FLIPPER: ORANGE, Motion.SPINNER: GREEN}
_LIMITS = (0.95, 1.05)
"""Of root mean squares that are as they should be [1]."""
_MOST = 20.0
"""Largest normalised error that is drawn where it is."""
_SHOWN = (
    ('cell', '', ''),
    ('class', '', ''),
    ('N', 'rotors', ''),
    ('d / d_c', 'd_over_critical', '.3f'),
    ('noise [rad]', 'noise', '.3g'),
    ('v / c', 'speed', '.2g'),
    ('walls', 'walls', ''),
    ('phonons', 'phonons', '.2g'),
    ('place rms', 'place_rms', '.2f'),
    ('±', 'place_rms_error', '.2f'),
    ('99 %', 'place_99', '.2f'),
    ('in 1, 2 σ [%]', 'place_coverage', ''),
    ('bias [σ]', 'place_bias', '+.2f'),
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
Row = Mapping[str, str]


def draw_cells(rows: Sequence[Row], seed: int, frames: int) -> Plate:
    """Normalised errors and failures of all cells."""
    width = max(10.0, 3 + 0.16 * len(rows))
    figure = Figure(figsize=(width, 11), layout='constrained')
    plate = Plate(figure, _CAPTION.format(seed=seed, frames=frames))
    panels = figure.subplots(3, 1, sharex=True)
    for axes, name in zip(panels, ('place', 'rate'), strict=False):
        for number, row in enumerate(rows):
            _draw_errors(plate, axes, name, number, row)
        for limit in _LIMITS:
            axes.axhline(limit, color=GREY, linestyle='--', linewidth=0.8, zorder=0)
        axes.set(yscale='log')
    for number, row in enumerate(rows):
        _draw_failures(plate, panels[2], number, row)
    panels[0].set(ylabel='a  error of the place / stated, rms [1]')
    panels[1].set(ylabel='b  error of the rate / stated, rms [1]')
    panels[2].set(ylabel='c  failures in 10,000 frames [1]', yscale='log')
    names = [row['cell'] for row in rows]
    panels[2].set_xticks(range(len(rows)), names, rotation=90, fontsize=7)
    hard = next((n for n, name in enumerate(names) if not name.isdecimal()), len(names))
    for axes in panels:
        axes.axvline(hard - 0.5, color=PALE, linewidth=1.5, zorder=0)
        axes.set_xlim(-1, len(rows))
    handles = [
        Line2D([], [], color=colour, marker='o', linestyle='', label=motion.value)
        for motion, colour in _COLOURS.items()
    ]
    handles += [
        Line2D([], [], color=GREY, marker=marker, linestyle='', label=label)
        for marker, label in (('o', 'c: lost'), ('^', 'c: false'))
    ]
    handles.append(Line2D([], [], color=BLACK, marker='x', linestyle='', label='c: wrong leg'))
    figure.legend(handles=handles, loc=ABOVE, ncols=6)
    return plate


def write_cells(rows: Sequence[Row], path: Path) -> None:
    """Write the table as Markdown."""
    lines = [
        '| ' + ' | '.join(title for title, _, _ in _SHOWN) + ' |',
        '|' + ' --- |' * len(_SHOWN),
        *('| ' + ' | '.join(_shown(row, *each) for each in _SHOWN) + ' |' for row in rows),
    ]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


def _shown(row: Row, title: str, name: str, form: str) -> str:
    if name.endswith('_coverage'):
        both = (row[f'{name}_1'], row[f'{name}_2'])
        return ', '.join(f'{float(each):.0f}' for each in both) if all(both) else ''
    text = row[name or title]
    return f'{float(text):{form}}' if form and text else text.replace('|', '∣')


def _draw_errors(plate: Plate, axes: Axes, name: str, number: int, row: Row) -> None:
    text, error = row[f'{name}_rms'], row[f'{name}_rms_error']
    if not text:
        return
    rms = float(text)
    shown = min(rms, _MOST)
    colour = _COLOURS[Motion(row['class'])]
    bar = min(float(error), 0.9 * shown) if error else 0.0
    marker = 'o' if rms <= _MOST else '^'
    axes.errorbar(number, shown, bar, fmt=marker, color=colour, markersize=4, linewidth=1)
    plate.note(name, row['cell'], ('cell', 'error / stated, rms [1]'), number, rms)


def _draw_failures(plate: Plate, axes: Axes, number: int, row: Row) -> None:
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
            plate.note('failures', f'{row["cell"]}, {name}', ('cell', '1'), number, share)
