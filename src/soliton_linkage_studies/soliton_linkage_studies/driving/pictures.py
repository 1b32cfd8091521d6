# SPDX-License-Identifier: Apache-2.0
"""Page of driven chains: actuator, energy balance, rigid limit, tilt and moves."""

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
"""Limit of |imbalance| / largest energy [1], which follows from the integration tolerance."""

_CAPTION = """
Validation of driven chains on one page.

(a) Soft actuator: pressure after a step command (dashed grey), in closed form (blue line) and by
numerical integration (black dots). (b) Energy imbalance of driven chains, divided by their largest
energy, for springs (blue) and rigid bars (red). An imbalance of 0 is drawn as {least:g}. Grey
marks show kicks (triangles), changes of gravity (squares) and torques (pale bars). The dashed line
is the limit, which follows from the integration tolerance. (c) Largest deviation of an angle
between chains of springs and a chain of rigid bars, against the spring stiffness (dots). The
dashed line has slope −1 and passes through the last dot.

(d) Wall position in chains of springs (blue) and rigid bars (red) that are tilted back and forth
under gravity. The panel above shows the tilt (black), positive if the last rotor is lower.
(e) Positions of walls that a controller moves to their goals (wide pale lines, one colour for each
class of chain), and their reference trajectories (thin lines). Dashed: ideal chains. Dotted:
chains with noise, damping and disorder. (f) Energy gained by a chain (wide pale lines) and work of
the torques (thin dashed lines), for an actuator below saturation (blue) and a saturated one (red).
"""
_A4 = (8.27, 11.69)
"""Page size [inches]."""
_LAYOUT = 3 * 'ab;' + 'ct;' + 2 * 'cd;' + 2 * 'ef;' + 'ef'
"""Panels row by row; t is the tilt above d."""
_TITLES = {
    'a': 'a  Soft actuator: a step up and down',
    'b': 'b  Energy balance of driven chains',
    'c': 'c  Convergence of stiff springs to bars',
    't': 'd  Wall in a chain that is tilted back and forth',
    'e': 'e  Wall positions (wide) and reference trajectories (thin)',
    'f': 'f  Work of a pressure on the chain',
}
_LEAST = 1e-17
"""Drawn value of an imbalance of 0 [1], below any rounding error."""
_TIME = 'time [s]'
_ROOM = 0.25
"""Vertical space for the legend above the moves, relative to the height of the data [1]."""


def blank_page() -> tuple[FigureReport, dict[str, Axes]]:
    """Return a page, and its axes by the name of the panel."""
    caption = _CAPTION.format(least=_LEAST)
    report = FigureReport(Figure(figsize=_A4, layout='constrained'), caption)
    panels = report.figure.subplot_mosaic(_LAYOUT)
    return report, panels


def entitle(panels: Mapping[str, Axes]) -> None:
    """Set the title and the font sizes of each panel."""
    for name, axes in panels.items():
        axes.set_title(_TITLES.get(name, ''), loc='left', fontsize='medium')
        axes.set_title('', loc='center')
        axes.tick_params(labelsize='small')
        legend = axes.get_legend()
        for text in legend.get_texts() if legend else ():
            text.set_fontsize('small')


def draw_balance(report: FigureReport, axes: Axes, runs: Mapping[str, BalancedRun]) -> Axes:
    """Draw the imbalance over time for springs and bars, and all events; 0 is drawn as 1e-17."""
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
    """Draw the largest angle deviation from rigid bars against stiffness, and order 1."""
    draw_convergence(axes, stiffnesses, apart, f'springs, order {order:.3f}')
    axes.set(xlabel='stiffness $k_e$ [N/m]')
    names = ('stiffness [N/m]', 'largest deviation of an angle [rad]')
    report.add_points('c', 'springs from bars', names, stiffnesses, apart)
    return axes


def draw_tilt(
    report: FigureReport, above: Axes, axes: Axes, runs: Mapping[str, TiltedRun]
) -> Axes:
    """Draw the tilt over time, and below it the wall position for springs and bars."""
    for mechanics, run in runs.items():
        colour = MECHANICS_COLOURS[mechanics]
        axes.plot(run.times, run.places, color=colour, linewidth=1.2, label=mechanics)
        report.add_points(
            'd', mechanics, (_TIME, 'position [rotor spacings]'), run.times, run.places
        )
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
    """Draw the position of each wall over time, and its reference trajectory."""
    colours = dict(zip(chains, chain_colours(list(chains.values())), strict=True))
    styles = dict(zip(dict.fromkeys(title for _, title in runs), ('--', ':', '-.'), strict=False))
    for (name, title), run in runs.items():
        colour = colours[name]
        axes.plot(run.times, run.positions, color=colour, linewidth=4, alpha=0.35)
        axes.plot(run.times, run.references, styles.get(title, '-'), color=colour, linewidth=1.2)
        for series, values in (
            ('position', run.positions),
            ('reference trajectory', run.references),
        ):
            names = (_TIME, 'position [rotor spacings]')
            report.add_points('e', f'{name}, {title}: {series}', names, run.times, values)
    handles = [
        *(Line2D([], [], color=colour, linewidth=4, alpha=0.35) for colour in colours.values()),
        *(axes.plot([], [], style, color=BLACK)[0] for style in styles.values()),
    ]
    axes.legend(handles, [*chains, *styles], ncols=2, loc='upper center')
    axes.set(xlabel='time since the goal was sent [s]', ylabel='wall [rotor spacings]')
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + _ROOM * (top - bottom))
    return axes


def draw_work(report: FigureReport, axes: Axes, runs: Mapping[str, DrivenChain]) -> Axes:
    """Draw the energy gained by a chain and the work of the torques, for each actuator."""
    for colour, (actuator, run) in zip(COLOURS, runs.items(), strict=False):
        for series, values, style, width in (
            ('energy gained', run.energies, '-', 4.0),
            ('work of the torques', run.works, '--', 1.2),
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
