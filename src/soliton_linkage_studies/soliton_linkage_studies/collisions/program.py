# SPDX-License-Identifier: Apache-2.0
"""Simulate collisions of kinks and anti-kinks on rings of springs.

Write tables as CSV and Markdown, and figures as PNG and PDF. After an interruption, the same
command continues the study.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Array, Motion
from soliton_linkage_studies import palette
from soliton_linkage_studies.collisions import study
from soliton_linkage_studies.collisions.runs import (
    INITIAL_DISTANCE,
    Collision,
    ring_order_field,
    simulate_frames,
)
from soliton_linkage_studies.drawing import LEGEND_ABOVE, PIXELS, parameters
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.program import study_command
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.sweep.table import RESUMES, fill_table

_SPEEDS = """ A kink and an anti-kink collide on a ring of springs, each with the speed v. v′ is
half of their relative speed after the collision; c is the speed of sound. Each panel shows one
ring, with its class and (r/a, θ̄). For spinners, the title states whether the second wall turns
the rotors back or onwards. Each dot is a collision. Its colour shows the number of overlaps before
the walls separate: none (pink), one (blue), two (orange), three (green) or more (black). Grey
ticks at the bottom: captured pairs. Red ticks: broken anti-kinks. In a flipper, rotors have turned
over; in a spinner, the wall has less than half of its continuum rest energy. Dashed line: v′ = v,
an elastic collision.
"""
_WINDOWS = """
(a) Bounce windows of a flipper: speed v′ of each wall after the collision against its speed v
before, both relative to the speed of sound c; v′ is half of the relative speed of the walls. The
walls separate after one collision (blue), two (orange), three (green) or more (black), or form a
captured pair (grey ticks at the bottom). Dashed line: v′ = v. (b) The same collisions with one
changed setting per row. The colour of each tick is the outcome; white marks a captured pair.
(c) Critical speed, above
which the walls separate after one collision, against d = 2 r sin θ̄ / a for two rotor lengths r.
Dashed line: critical speed of phi⁴ theory, {phi4:g} c, the limit of small d.
"""
_OUTCOME_COLOURS = (palette.PURPLE, palette.BLUE, palette.ORANGE, palette.GREEN, palette.BLACK)
"""Colours of collisions with 0, 1, 2, 3, and 4 or more overlaps."""
_NAMES = ('never overlapped', '1 collision', '2 collisions', '3 collisions', 'more collisions')
"""Labels of the same outcomes; the collisions in these labels are overlaps."""
_SPEED, _SPEED_AFTER = 'v / c [1]', "v' / c [1]"


def draw_speeds(rows: Sequence[study.Row]) -> FigureReport:
    """Draw the speed after a collision against the speed before, one panel per ring."""
    series = study.series_of(rows, 'sweeps')
    report, panels = _panels(_SPEEDS, len(series), 4, (4.1, 3.9, 0.5), 'v′ / c [1]')
    for axes, (name, each) in zip(panels, series.items(), strict=True):
        _draw_speeds(report, axes, name, each)
        axes.set(title=name, xlabel='v / c [1]', xlim=(0, None), ylim=(0, None))
    report.figure.legend(handles=_handles(True), loc=LEGEND_ABOVE, ncols=8, frameon=False)
    return report


def _panels(
    caption: str, count: int, most: int, size: tuple[float, float, float], label: str
) -> tuple[FigureReport, Any]:
    columns = min(most, count)
    lines = -(-count // columns)
    shape = size[0] * columns, size[1] * lines + size[2]
    report = FigureReport(Figure(figsize=shape, layout='constrained'), caption)
    panels = report.figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    for axes in panels[::columns]:
        axes.set_ylabel(label)
    return report, panels[:count]


def draw_windows(rows: Sequence[study.Row]) -> FigureReport:
    """Draw bounce windows, their sensitivity to settings, and critical speeds against d."""
    figure = Figure(figsize=(13, 7), layout='constrained')
    report = FigureReport(figure, _WINDOWS.format(phi4=study.PHI4_SPEED))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1), height_ratios=(2, 1))
    above, aside = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[:, 1])
    below = figure.add_subplot(grid[1, 0], sharex=above)
    series = study.series_of([row for row in rows if not row.name], 'variations')
    whole = next(iter(series.values()))
    _draw_speeds(report, above, 'a', whole)
    above.set(ylabel='v′ / c [1]', ylim=(0, None))
    above.margins(x=0.01)
    above.tick_params(labelbottom=False)
    _draw_strips(report, below, series)
    _draw_critical(report, aside, study.series_of(rows, 'critical_speeds'))
    for panel, letter in zip((above, below, aside), 'abc', strict=True):
        panel.set_title(letter, loc='left', fontweight='bold')
    figure.legend(handles=_handles(False), loc=LEGEND_ABOVE, ncols=8, frameon=False)
    return report


def _draw_speeds(report: FigureReport, axes: Axes, name: str, rows: Sequence[study.Row]) -> None:
    speeds = np.array([row.speed for row in rows])
    bottom = axes.get_xaxis_transform()
    ends = [speeds.min(), speeds.max()]
    axes.plot(ends, ends, '--', color=palette.GREY, linewidth=0.9, zorder=1)
    for outcome, label in [*enumerate(_NAMES), (None, 'captured'), (-1, 'anti-kink broken')]:
        chosen = [row for row in rows if row.run and _outcome(row) == outcome]
        if not chosen:
            continue
        before = np.array([row.speed for row in chosen])
        if outcome is None or outcome < 0:
            colour, after = palette.GREY if outcome is None else palette.RED, np.zeros_like(before)
            axes.vlines(before, 0.0, 0.04, color=colour, linewidth=0.6, transform=bottom)
        else:
            colour = _OUTCOME_COLOURS[outcome]
            after = np.array([row.run.speed_after for row in chosen if row.run])
            axes.plot(before, after, '.', color=colour, markersize=3.5, zorder=2 + outcome)
        report.add_points(name, label, (_SPEED, _SPEED_AFTER), before, after)


def _draw_strips(report: FigureReport, axes: Axes, series: dict[str, list[study.Row]]) -> None:
    for number, (name, rows) in enumerate(series.items()):
        width = (rows[-1].speed - rows[0].speed) / max(len(rows) - 1, 1)
        for outcome, label in enumerate(_NAMES):
            speeds = [row.speed for row in rows if row.run and _outcome(row) == outcome]
            bars, places = [(speed - width / 2, width) for speed in speeds], [number] * len(speeds)
            axes.broken_barh(bars, (number - 0.4, 0.8), color=_OUTCOME_COLOURS[outcome])
            report.add_points('b', f'{name}: {label}', (_SPEED, 'row'), speeds, places)
    axes.set_yticks(range(len(series)), list(series))
    axes.set(xlabel='v / c [1]', ylim=(len(series) - 0.5, -0.5))


def _draw_critical(report: FigureReport, axes: Axes, series: dict[str, list[study.Row]]) -> None:
    for (name, rows), colour in zip(
        series.items(), (palette.BLUE, palette.GREEN, palette.SKY), strict=False
    ):
        found = [(float(row.name), row.speed) for row in rows if row.run]
        leans, speeds = np.array(found).reshape(-1, 2).T
        look, names = (
            {'color': colour, 'markersize': 4, 'label': name},
            ('d [1]', study.CRITICAL_SPEED),
        )
        report.plot(axes, ('c', name), names, leans, speeds, 'o-', **look)
    axes.axhline(
        study.PHI4_SPEED, color=palette.BLACK, linestyle='--', linewidth=0.9, label='phi⁴ theory'
    )
    axes.set(xlabel='d = 2 r sin θ̄ / a [1]', ylabel=study.CRITICAL_SPEED)
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.legend(frameon=False)


def _outcome(row: study.Row) -> int | None:
    """Return the number of overlaps (at most 4) before escape, -1 if broken, None if captured."""
    after = study.escaped_after(row)
    if row.run and row.run.broken:
        return -1
    return None if after is None else min(after, len(_NAMES) - 1)


def _handles(whole: bool) -> list[Line2D]:
    dots = [(name, colour, 'o', 5) for name, colour in zip(_NAMES, _OUTCOME_COLOURS, strict=True)]
    ticks = [('captured', palette.GREY, '|', 9), ('anti-kink broken', palette.RED, '|', 9)]
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle='', markersize=size, label=name)
        for name, colour, marker, size in ([*dots, *ticks] if whole else [*dots[1:], ticks[0]])
    ]
    return [*handles, Line2D([], [], color=palette.GREY, linestyle='--', label='v′ = v')]


_CAPTION = """
Collisions of kinks (from the left) and anti-kinks (from the right) on rings of springs. Titles
state the relative speed v / c and (r/a, θ̄). Colours show the order field m: u / ū for flippers
and cos(θ − θ̄) for spinners, with u = r sin θ, ū = r sin θ̄ and θ the staggered angle. m is +1
(purple) where the chain leans right and −1 (orange) where it leans left. Time runs upwards in
units of 2 ℓ / c, with ℓ the penetration depth and c the speed of sound. Only a part of the ring is
shown. Numbers in the domains of spinners are the turns of the rotors since the right-leaning
state.
"""
_SHOWN = 40.0
"""Width of the part of the ring that a panel shows, divided by `Collision.reach` [1]."""
_AFTERWARDS = 35.0
"""A collision is drawn until this time after free walls would meet [`Collision.unit`]."""
_LARGEST = 1.6
"""The colour scale of the order field ends at plus and minus this [1]; all values are smaller."""
_TURNS = {-2: '−1', -1: '−½', 0: '0', 1: '+½', 2: '+1'}
"""Labels of the turns of a rotor; keys are numbers of half turns."""


def draw_pictures(collisions: Mapping[str, Collision]) -> FigureReport:
    """Draw the order field of each collision against position and time."""
    most, size = 3, (4.6, 4.4, 0.0)
    report, panels = _panels(_CAPTION, len(collisions), most, size, 't c / 2 ℓ [1]')
    for axes, (name, collision) in zip(panels, collisions.items(), strict=True):
        _draw(report, axes, name, collision)
    figure = report.figure
    look: Any = {'shrink': 0.6, 'extend': 'both', 'pad': 0.01}
    bar = figure.colorbar(panels[0].images[0], ax=figure.axes, **look)
    bar.set_label('order field m [1]')
    return report


def _draw(report: FigureReport, axes: Axes, name: str, collision: Collision) -> None:
    times, angles = _recorded(collision)
    rotors = np.arange(angles.shape[1])
    positions = rotors - (len(rotors) - 1) / 2
    shown = np.abs(positions) < _SHOWN / 2 * collision.reach
    fields = ring_order_field(collision.ring, angles)[:, shown]
    positions = positions[shown]
    extent = positions[0] - 0.5, positions[-1] + 0.5, times[0], times[-1]
    axes.imshow(fields, vmin=-_LARGEST, vmax=_LARGEST, extent=extent, **PIXELS)
    ring = collision.ring
    title = f'{name}: v / c = {collision.speed:g}\n{ring.motion.value}, {parameters(ring)}'
    axes.set_title(title, fontsize=10)
    axes.set_xlabel('position [rotor spacings]')
    if ring.motion is Motion.SPINNER:
        _label_turns(axes, collision, times, angles)
    middle = int(np.argmin(np.abs(positions)))
    names = ('t c / 2 l [1]', 'order field in the middle [1]')
    report.add_points(name, 'middle', names, times, fields[:, middle])


def _recorded(collision: Collision) -> tuple[Array, Array]:
    duration = (INITIAL_DISTANCE / 2 / collision.speed + _AFTERWARDS) * collision.unit
    times, angles = [], []
    for instants, frame, _ in simulate_frames(collision):
        times.append(instants)
        angles.append(frame)
        if instants[-1] > duration:
            break
    return np.concatenate(times) / collision.unit, np.concatenate(angles)


def _label_turns(axes: Axes, collision: Collision, times: Array, angles: Array) -> None:
    rest = collision.ring.uniform_state(1)
    middle = len(rest) // 2
    outside = min(middle + round(0.42 * _SHOWN * collision.reach), len(rest) - 1)
    for rotor, share in ((middle, 0.03), (middle, 0.94), (outside, 0.03)):
        frame = round(share * (len(times) - 1))
        halves = round((angles[frame, rotor] - rest[rotor]) / math.pi)
        position = (rotor - (len(rest) - 1) / 2, times[frame])
        axes.annotate(_TURNS.get(halves, f'{halves}/2'), position, ha='center', va='center')


def _collided(options: argparse.Namespace) -> str:
    asked = study.read_collision_study(load_settings(options.config), options.quick)
    folder = options.output / ('quick' if options.quick else 'runs')
    _, cells = fill_table(asked, folder, options.workers)
    rows = [study.read_row(each) for each in cells]
    draw_speeds(rows).save(options.output, 'collisions')
    draw_windows(rows).save(options.output, 'collision_windows')
    draw_pictures(asked.pictures).save(options.output, 'collision_pictures')
    table = study.finding_tables(rows)
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    failed = sum(bool(row.failure) for row in rows)
    remark = f'; {failed} of {len(rows)} collisions failed' if failed else ''
    return f'{table}\ntables and pictures are in {options.output}{remark}'


main = study_command(_collided, RESUMES, 'collisions', __doc__, 'few speeds')
