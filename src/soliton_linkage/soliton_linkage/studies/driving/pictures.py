# SPDX-License-Identifier: Apache-2.0
"""The page that shows how a chain is driven: actuator, energy balance, bars, tilt and moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage.studies.actuators import DrivenChain
from soliton_linkage.studies.bars import draw_convergence
from soliton_linkage.studies.driving.runs import BalancedRun, TiltedRun
from soliton_linkage.studies.moves.runs import MoveRun
from soliton_linkage.studies.palette import BLACK, COLOURS, GREY
from soliton_linkage.studies.plates import Plate

IMBALANCE_LIMIT = 1e-9
"""Of the energy balance, over the largest energy: what the tolerance of a run leaves [1]."""

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


def blank_page() -> tuple[Plate, dict[str, Axes]]:
    """Return a page, and its axes by the name of the panel."""
    plate = Plate(Figure(figsize=_A4, layout='constrained'))
    panels = plate.figure.subplot_mosaic(_LAYOUT)
    return plate, panels


def entitle(panels: Mapping[str, Axes]) -> None:
    """Write the title of each panel, and make its letters fit the page."""
    for name, axes in panels.items():
        axes.set_title(_TITLES.get(name, ''), loc='left', fontsize='medium')
        axes.set_title('', loc='center')
        axes.tick_params(labelsize='small')
        legend = axes.get_legend()
        for text in legend.get_texts() if legend else ():
            text.set_fontsize('small')


def draw_balance(plate: Plate, axes: Axes, runs: Mapping[str, BalancedRun]) -> Axes:
    """Imbalance over time for each mechanics, and when there was what; 0 is drawn as 1e-17."""
    for colour, (mechanics, run) in zip(COLOURS, runs.items(), strict=False):
        shown = np.maximum(run.imbalances, _LEAST)
        axes.semilogy(run.times, shown, '.', color=colour, markersize=3, label=mechanics)
        plate.note('b', mechanics, (_TIME, 'imbalance [1]'), run.times, run.imbalances)
    run = next(iter(runs.values()))
    for marker, instants, label in (('v', run.kicks, 'kick'), ('s', run.turns, 'gravity turns')):
        places = np.full(len(instants), 4 * IMBALANCE_LIMIT)
        axes.plot(instants, places, marker, color=GREY, markersize=4, label=label)
    axes.fill_between(
        run.times,
        2 * IMBALANCE_LIMIT,
        8 * IMBALANCE_LIMIT,
        where=run.pushed.tolist(),
        color='0.85',
        zorder=0,
        label='torques',
    )
    axes.axhline(IMBALANCE_LIMIT, color=BLACK, linestyle='--', linewidth=0.8, label='limit')
    axes.set(xlabel=_TIME, ylabel='|imbalance| / largest energy', ylim=(1e-20, 2e-8))
    axes.legend(ncols=3, loc='lower center', columnspacing=1.0, handlelength=1.2)
    return axes


def draw_stiffness(
    plate: Plate, axes: Axes, stiffnesses: Sequence[float], apart: Sequence[float], order: float
) -> Axes:
    """Largest distance of angles from those of bars against stiffness, and a line of order 1."""
    draw_convergence(axes, stiffnesses, apart, f'springs from bars: order {order:.3f}')
    axes.set(xlabel='stiffness $k_e$ [N/m]')
    names = ('stiffness [N/m]', 'largest distance of an angle [rad]')
    plate.note('c', 'springs from bars', names, stiffnesses, apart)
    return axes


def draw_tilt(plate: Plate, above: Axes, axes: Axes, runs: Mapping[str, TiltedRun]) -> Axes:
    """Tilt over time, and beneath it the place of the wall for each mechanics."""
    for colour, (mechanics, run) in zip(COLOURS, runs.items(), strict=False):
        axes.plot(run.times, run.places, color=colour, linewidth=1.2, label=mechanics)
        plate.note('d', mechanics, (_TIME, 'place [rotor spacings]'), run.times, run.places)
    run = next(iter(runs.values()))
    above.step(run.times, run.tilts, where='post', color=BLACK)
    plate.note('d', 'tilt', (_TIME, 'tilt [rad]'), run.times, run.tilts)
    above.sharex(axes)
    above.tick_params(labelbottom=False)
    above.set(ylabel='tilt [rad]')
    axes.set(xlabel=_TIME, ylabel='wall [rotor spacings]')
    axes.legend()
    return axes


def draw_moves(plate: Plate, axes: Axes, runs: Mapping[tuple[str, str], MoveRun]) -> Axes:
    """Place of each wall over time, wide and pale, and its reference as a line in it."""
    chains = list(dict.fromkeys(name for name, _ in runs))
    styles = dict(zip(dict.fromkeys(title for _, title in runs), ('--', ':', '-.'), strict=False))
    for (name, title), run in runs.items():
        colour = COLOURS[chains.index(name) % len(COLOURS)]
        axes.plot(run.times, run.places, color=colour, linewidth=4, alpha=0.35)
        axes.plot(run.times, run.aims, styles.get(title, '-'), color=colour, linewidth=1.2)
        for series, values in (('place', run.places), ('reference trajectory', run.aims)):
            names = (_TIME, 'place [rotor spacings]')
            plate.note('e', f'{name}, {title}: {series}', names, run.times, values)
    handles = [
        *(
            Line2D([], [], color=COLOURS[number % len(COLOURS)], linewidth=4, alpha=0.35)
            for number in range(len(chains))
        ),
        *(axes.plot([], [], style, color=BLACK)[0] for style in styles.values()),
    ]
    axes.legend(handles, [*chains, *styles], ncols=2, loc='upper center')
    axes.set(xlabel='time since the goal was given [s]', ylabel='wall [rotor spacings]')
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + _ROOM * (top - bottom))
    return axes


def draw_work(plate: Plate, axes: Axes, runs: Mapping[str, DrivenChain]) -> Axes:
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
            plate.note('f', label, (_TIME, 'energy [J]'), run.times, values)
    axes.set(xlabel=_TIME, ylabel='energy [mJ]')
    axes.legend()
    return axes
