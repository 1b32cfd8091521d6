# SPDX-License-Identifier: Apache-2.0
"""The page that shows how a chain is driven: actuator, energy balance, bars, tilt and moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.driving.runs import BalancedRun, TiltedRun
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.figures.actuator import DrivenChain
from soliton_linkage_studies.figures.rigid_limit import draw_convergence
from soliton_linkage_studies.moves import MoveKey, MoveRun
from soliton_linkage_studies.palette import (
    BLACK,
    COLOURS,
    GREY,
    MECHANICS_COLOURS,
    PALE,
    chain_colours,
)

IMBALANCE_LIMIT = 1e-9
"""Of the energy balance, over the largest energy: what the tolerance of a run leaves [1]."""

_CAPTION = """
What drives a chain, on one page.

(a) The soft actuator: pressure after a command of a step up and down (dashed grey), in closed form
(blue line) and solved by small steps (black dots). (b) Imbalance of the energy of driven chains,
over their largest energy, of springs (blue) and of rigid bars (red); an imbalance of 0 is drawn as
{least:g}. Grey marks above say when there was what: kicks (triangles), turns of gravity
(squares), torques (pale grey bars); the dashed line is the limit, what the tolerance of a run
leaves. (c) Largest distance of an angle of chains of springs from that of a chain of rigid bars,
against the stiffness of the springs (dots), with a line of slope −1 through the last dot (dashed).

(d) Place of the wall in a chain of springs (blue) and in one of rigid bars (red) that are tilted
to and fro under gravity; above it the tilt (black), positive where the last rotor is the lower
one. (e) Places of walls that are carried to their goals (wide pale lines, a colour for each class
of chain) and their reference trajectories (thin lines in them: dashed for ideal chains, dotted for
those with noise, damping and disorder). (f) Energy that a chain gains (wide pale lines) and work
that is booked from torques and angles (thin dashed lines in them), for an actuator below its
saturation (blue) and a saturated one (red).
"""
_A4 = (8.27, 11.69)
"""Of the page [inches]."""
_LAYOUT = 3 * 'ab;' + 'ct;' + 2 * 'cd;' + 2 * 'ef;' + 'ef'
"""Panels row by row; t is the tilt above d."""
_TITLES = {
    'a': 'a  Soft actuator: a step up and down',
    'b': 'b  Energy balance of chains that are driven',
    'c': 'c  Springs that get stiffer move as bars',
    't': 'd  A tilted chain: the wall falls to and fro',
    'e': 'e  Walls carried (wide) along reference trajectories (thin)',
    'f': 'f  Work of a pressure on the chain',
}
_LEAST = 1e-17
"""Drawn in place of an imbalance of 0, below any that rounding makes [1]."""
_TIME = 'time [s]'
_ROOM = 0.25
"""Above the curves of moves for their legend, over the height of what they show."""


def blank_page() -> tuple[FigureReport, dict[str, Axes]]:
    """Return a page, and its axes by the name of the panel."""
    caption = _CAPTION.format(least=_LEAST)
    report = FigureReport(Figure(figsize=_A4, layout='constrained'), caption)
    panels = report.figure.subplot_mosaic(_LAYOUT)
    return report, panels


def entitle(panels: Mapping[str, Axes]) -> None:
    """Write the title of each panel, and make its letters fit the page."""
    for name, axes in panels.items():
        axes.set_title(_TITLES.get(name, ''), loc='left', fontsize='medium')
        axes.set_title('', loc='center')
        axes.tick_params(labelsize='small')
        legend = axes.get_legend()
        for text in legend.get_texts() if legend else ():
            text.set_fontsize('small')


def draw_balance(report: FigureReport, axes: Axes, runs: Mapping[str, BalancedRun]) -> Axes:
    """Imbalance over time for each mechanics, and when there was what; 0 is drawn as 1e-17."""
    for mechanics, run in runs.items():
        colour = MECHANICS_COLOURS[mechanics]
        shown = np.maximum(run.imbalances, _LEAST)
        axes.semilogy(run.times, shown, '.', color=colour, markersize=3, label=mechanics)
        report.add_points('b', mechanics, (_TIME, 'imbalance [1]'), run.times, run.imbalances)
    run = next(iter(runs.values()))
    for marker, instants, label in (('v', run.kicks, 'kick'), ('s', run.turns, 'gravity turns')):
        places = np.full(len(instants), 4 * IMBALANCE_LIMIT)
        axes.plot(instants, places, marker, color=GREY, markersize=4, label=label)
    axes.fill_between(
        run.times,
        2 * IMBALANCE_LIMIT,
        8 * IMBALANCE_LIMIT,
        where=run.pushed.tolist(),
        color=PALE,
        zorder=0,
        label='torques',
    )
    axes.axhline(IMBALANCE_LIMIT, color=BLACK, linestyle='--', linewidth=0.8, label='limit')
    axes.set(xlabel=_TIME, ylabel='|imbalance| / largest energy [1]', ylim=(1e-20, 2e-8))
    axes.legend(ncols=3, loc='lower center', columnspacing=1.0, handlelength=1.2)
    return axes


def draw_stiffness(
    report: FigureReport,
    axes: Axes,
    stiffnesses: Sequence[float],
    apart: Sequence[float],
    order: float,
) -> Axes:
    """Largest distance of angles from those of bars against stiffness, and a line of order 1."""
    draw_convergence(axes, stiffnesses, apart, f'springs, order {order:.3f}')
    axes.set(xlabel='stiffness $k_e$ [N/m]')
    names = ('stiffness [N/m]', 'largest distance of an angle [rad]')
    report.add_points('c', 'springs from bars', names, stiffnesses, apart)
    return axes


def draw_tilt(
    report: FigureReport, above: Axes, axes: Axes, runs: Mapping[str, TiltedRun]
) -> Axes:
    """Tilt over time, and beneath it the place of the wall for each mechanics."""
    for mechanics, run in runs.items():
        colour = MECHANICS_COLOURS[mechanics]
        axes.plot(run.times, run.places, color=colour, linewidth=1.2, label=mechanics)
        report.add_points('d', mechanics, (_TIME, 'place [rotor spacings]'), run.times, run.places)
    run = next(iter(runs.values()))
    above.step(run.times, run.tilts, where='post', color=BLACK)
    report.add_points('d', 'tilt', (_TIME, 'tilt [rad]'), run.times, run.tilts)
    above.sharex(axes)
    above.tick_params(labelbottom=False)
    above.set(ylabel='tilt [rad]')
    axes.set(xlabel=_TIME, ylabel='wall [rotor spacings]')
    axes.legend()
    return axes


def draw_moves(
    report: FigureReport, axes: Axes, chains: Mapping[str, Chain], runs: Mapping[MoveKey, MoveRun]
) -> Axes:
    """Place of each wall over time, wide and pale, and its reference as a line in it."""
    colours = dict(zip(chains, chain_colours(list(chains.values())), strict=True))
    styles = dict(zip(dict.fromkeys(title for _, title in runs), ('--', ':', '-.'), strict=False))
    for (name, title), run in runs.items():
        colour = colours[name]
        axes.plot(run.times, run.positions, color=colour, linewidth=4, alpha=0.35)
        axes.plot(run.times, run.references, styles.get(title, '-'), color=colour, linewidth=1.2)
        for series, values in (('place', run.positions), ('reference trajectory', run.references)):
            names = (_TIME, 'place [rotor spacings]')
            report.add_points('e', f'{name}, {title}: {series}', names, run.times, values)
    handles = [
        *(Line2D([], [], color=colour, linewidth=4, alpha=0.35) for colour in colours.values()),
        *(axes.plot([], [], style, color=BLACK)[0] for style in styles.values()),
    ]
    axes.legend(handles, [*chains, *styles], ncols=2, loc='upper center')
    axes.set(xlabel='time since the goal was given [s]', ylabel='wall [rotor spacings]')
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + _ROOM * (top - bottom))
    return axes


def draw_work(report: FigureReport, axes: Axes, runs: Mapping[str, DrivenChain]) -> Axes:
    """Energy that a chain gains, and the work that is booked, for each actuator."""
    for colour, (actuator, run) in zip(COLOURS, runs.items(), strict=False):
        for series, values, style, width in (
            ('energy gained', run.energies, '-', 4.0),
            ('work booked', run.works, '--', 1.2),
        ):
            label = f'{series}, {actuator}'
            shade = 0.35 if style == '-' else 1.0
            axes.plot(
                run.times,
                1e3 * values,
                style,
                color=colour,
                linewidth=width,
                alpha=shade,
                label=label,
            )
            report.add_points('f', label, (_TIME, 'energy [J]'), run.times, values)
    axes.set(xlabel=_TIME, ylabel='energy [mJ]')
    axes.legend()
    return axes
