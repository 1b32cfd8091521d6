# SPDX-License-Identifier: Apache-2.0
"""Drive chains by an actuator, a tilt and a controller; show the checked results on one page."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.steering.steering import Outcome
from soliton_linkage_studies import palette
from soliton_linkage_studies.driving.runs import (
    BalancedRun,
    DrivingStudy,
    TiltedRun,
    read_driving_study,
)
from soliton_linkage_studies.figure_report import FigureReport, new_report
from soliton_linkage_studies.figures.actuator import DrivenChain, draw_response, stepped_response
from soliton_linkage_studies.figures.rigid_limit import convergence_order, draw_convergence
from soliton_linkage_studies.moves import MoveKey, MoveRun, move_table, runs_by_key
from soliton_linkage_studies.program import run_parallel, study_command
from soliton_linkage_studies.settings import load_settings
from soliton_linkage_studies.sweep.table import markdown_table

IMBALANCE_LIMIT = 1e-9
"""Largest allowed energy imbalance, divided by the largest energy of the chain [1]. This limit
follows from the integration tolerance."""

_CAPTION = """
Validation of driven chains on one page.

(a) Soft actuator: pressure after a step command (dashed grey), in closed form (blue line) and by
numerical integration (black dots). (b) Energy imbalance of driven chains, divided by their largest
energy, for springs (blue) and rigid bars (red). An imbalance of 0 is drawn as {least:g}. Grey
marks show kicks (triangles), changes of gravity (squares) and torques (pale bars). The dashed line
is the limit, which follows from the integration tolerance. (c) Largest difference of an angle
between chains of springs and a chain of rigid bars, against the spring stiffness (dots). The
dashed line has slope −1 and passes through the last dot.

(d) Wall position in chains of springs (blue) and rigid bars (red) that are tilted back and forth
under gravity. The panel above shows the tilt (black), positive if the last rotor is lower.
(e) Positions of walls that a controller moves to their goals (wide pale lines, one colour for each
class of chain), and their reference trajectories (thin lines). Dashed: ideal chains. Dotted:
chains with noise, damping and disorder. (f) Energy gained by a chain (wide pale lines) and work of
the torques (thin dashed lines), for an actuator below saturation (blue) and a saturated one (red).
"""
_LAYOUT = 3 * 'ab;' + 'ct;' + 2 * 'cd;' + 2 * 'ef;' + 'ef'
"""Arrangement of the panels, row by row; panel t, above panel d, shows the tilt."""
_TITLES = {
    'a': 'a  Soft actuator: a step up and down',
    'b': 'b  Energy balance of driven chains',
    'c': 'c  Convergence of stiff springs to bars',
    't': 'd  Wall in a chain that is tilted back and forth',
    'e': 'e  Wall positions (wide) and reference trajectories (thin)',
    'f': 'f  Work of a pressure on the chain',
}
_LEAST = 1e-17
"""Smaller imbalances are drawn at this value [1], which is below all rounding errors."""
_TIME = 'time [s]'


def entitle(panels: Mapping[str, Axes]) -> None:
    """Set the title and the font sizes of each panel."""
    for name, axes in panels.items():
        axes.set_title(_TITLES.get(name, ''), loc='left', fontsize='medium')
        axes.set_title('', loc='center')
        axes.tick_params(labelsize='small')
        legend = axes.get_legend()
        for text in legend.get_texts() if legend else ():
            text.set_fontsize('small')


def draw_balance(report: FigureReport, axes: Axes, runs: Mapping[str, BalancedRun]) -> None:
    """Draw the energy imbalance of springs and bars; mark kicks, torques and turns of gravity."""
    for mechanics, run in runs.items():
        colour = palette.MECHANICS_COLOURS[mechanics]
        shown = np.maximum(run.imbalances, _LEAST)
        axes.semilogy(run.times, shown, '.', color=colour, markersize=3, label=mechanics)
        report.add_points('b', mechanics, (_TIME, 'imbalance [1]'), run.times, run.imbalances)
    run = next(iter(runs.values()))
    for marker, instants, label in (('v', run.kicks, 'kick'), ('s', run.turns, 'gravity turns')):
        positions = np.full(len(instants), 4 * IMBALANCE_LIMIT)
        axes.plot(instants, positions, marker, color=palette.GREY, markersize=4, label=label)
    axes.fill_between(
        run.times,
        2 * IMBALANCE_LIMIT,
        8 * IMBALANCE_LIMIT,
        where=run.pushed.tolist(),
        color=palette.PALE,
        zorder=0,
        label='torques',
    )
    axes.axhline(
        IMBALANCE_LIMIT, color=palette.BLACK, linestyle='--', linewidth=0.8, label='limit'
    )
    axes.set(xlabel=_TIME, ylabel='|imbalance| / largest energy [1]', ylim=(1e-20, 2e-8))
    axes.legend(ncols=3, loc='lower center', columnspacing=1.0, handlelength=1.2)


def draw_tilt(
    report: FigureReport, above: Axes, axes: Axes, runs: Mapping[str, TiltedRun]
) -> None:
    """Draw the tilt over time in the panel `above`, and the wall positions in the panel `axes`."""
    for mechanics, run in runs.items():
        colour = palette.MECHANICS_COLOURS[mechanics]
        axes.plot(run.times, run.positions, color=colour, linewidth=1.2, label=mechanics)
        report.add_points(
            'd', mechanics, (_TIME, 'position [rotor spacings]'), run.times, run.positions
        )
    run = next(iter(runs.values()))
    above.step(run.times, run.tilts, where='post', color=palette.BLACK)
    report.add_points('d', 'tilt', (_TIME, 'tilt [rad]'), run.times, run.tilts)
    above.sharex(axes)
    above.tick_params(labelbottom=False)
    above.set(ylabel='tilt [rad]')
    axes.set(xlabel=_TIME, ylabel='wall [rotor spacings]')
    axes.legend()


def draw_moves(
    report: FigureReport, axes: Axes, chains: Mapping[str, Chain], runs: Mapping[MoveKey, MoveRun]
) -> None:
    """Draw the position and the reference trajectory of each wall over time."""
    colours = dict(zip(chains, palette.chain_colours(list(chains.values())), strict=True))
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
        *(axes.plot([], [], style, color=palette.BLACK)[0] for style in styles.values()),
    ]
    axes.legend(handles, [*chains, *styles], ncols=2, loc='upper center')
    axes.set(xlabel='time since the goal was sent [s]', ylabel='wall [rotor spacings]')
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + 0.25 * (top - bottom))


def draw_work(report: FigureReport, axes: Axes, runs: Mapping[str, DrivenChain]) -> None:
    """Draw the energy that a chain gains and the work of the torques, for each actuator."""
    for colour, (actuator, run) in zip(palette.COLOURS, runs.items(), strict=False):
        for series, values, style, width, alpha in (
            ('energy gained', run.energies, '-', 4.0, 0.35),
            ('work of the torques', run.works, '--', 1.2, 1.0),
        ):
            label = f'{series}, {actuator}'
            (line,) = axes.plot(run.times, 1e3 * values, style, color=colour, label=label)
            line.set(linewidth=width, alpha=alpha)
            report.add_points('f', label, (_TIME, 'energy [J]'), run.times, values)
    axes.set(xlabel=_TIME, ylabel='energy [mJ]')
    axes.legend()


@dataclass(frozen=True)
class Finding:
    """Measured number and the limits of its allowed range."""

    panel: str
    quantity: str
    lowest: float
    highest: float
    measured: float

    @property
    def holds(self) -> bool:
        """Whether the measured number lies in its range."""
        return self.lowest <= self.measured <= self.highest


def page(
    study: DrivingStudy, runs: Mapping[tuple[str, Any], Any]
) -> tuple[FigureReport, list[Finding]]:
    """Return the page of results, and the measured numbers with their allowed ranges."""
    balances, tilts, works = (
        {key: run for (panel, key), run in runs.items() if panel == wanted} for wanted in 'bdf'
    )
    apart = [runs['c', number] for number in range(len(study.stiffnesses))]
    moves = moves_of(runs)
    report = new_report(_CAPTION.format(least=_LEAST), 8.27, 11.69)
    panels = report.figure.subplot_mosaic(_LAYOUT)
    response = stepped_response(PneumaticActuator(), study.step)
    draw_response(report, panels['a'], response)
    draw_balance(report, panels['b'], balances)
    stiffnesses = [task.chain.stiffness for task in study.stiffnesses]
    order = convergence_order(stiffnesses, apart)
    draw_convergence(panels['c'], stiffnesses, apart, f'springs, order {order:.3f}')
    panels['c'].set(xlabel='stiffness $k_e$ [N/m]')
    names = ('stiffness [N/m]', 'largest deviation of an angle [rad]')
    report.add_points('c', 'springs from bars', names, stiffnesses, apart)
    draw_tilt(report, panels['t'], panels['d'], tilts)
    chains = {name: tasks[0].chain for (name, _), tasks in study.moves.items()}
    draw_moves(report, panels['e'], chains, {key: each[0] for key, each in moves.items()})
    draw_work(report, panels['f'], works)
    entitle(panels)
    highest = float(study.step.values.max())
    closed = 'deviation of the closed form from numerical integration / pressure'
    findings = [Finding('a', closed, 0, 1e-6, response.distance / highest)]
    for name, run in balances.items():
        title = f'largest error of the energy balance / largest energy, {name}'
        findings.append(Finding('b', title, 0, IMBALANCE_LIMIT, float(run.imbalances.max())))
    title = 'order of the deviation of springs from bars in 1/k_e'
    findings.append(Finding('c', title, 0.9, 1.1, order))
    findings += _tilt_findings(study, tilts)
    for key, ended in moves.items():
        reached = all(run.outcome is Outcome.REACHED for run in ended)
        error = max(run.error for run in ended) if reached else np.nan
        title = f'distance of the wall from its goal [rotor spacings], {", ".join(key)}'
        findings.append(Finding('e', title, 0, 0.1, float(error)))
    for name, run in works.items():
        missing = abs(float(run.works[-1] / run.energies[-1] - 1))
        findings.append(
            Finding('f', f'(work − energy gain) / energy gain, {name}', 0, 1e-9, missing)
        )
    return report, findings


def moves_of(runs: Mapping[tuple[str, Any], Any]) -> dict[MoveKey, list[MoveRun]]:
    """Select the moves from all runs; return them grouped by chain and condition."""
    return runs_by_key({key: run for (panel, key), run in runs.items() if panel == 'e'})


def finding_table(findings: Sequence[Finding]) -> str:
    """Return a Markdown table with all findings."""
    rows = []
    for found in findings:
        allowed = f'{found.lowest:g} to {found.highest:g}'
        holds = 'yes' if found.holds else 'no'
        rows.append([found.panel, found.quantity, f'{found.measured:.3g}', allowed, holds])
    return markdown_table(('panel', 'quantity', 'measured', 'allowed range', 'holds'), rows)


def _tilt_findings(study: DrivingStudy, tilts: Mapping[str, TiltedRun]) -> list[Finding]:
    findings = []
    for name, run in tilts.items():
        task = study.tilts[name]
        last = task.chain.number_of_rotors - 1
        lower = [last if tilt > 0 else 0 for tilt in task.tilts]
        left = run.positions.reshape(len(task.tilts), -1)[:, -1]
        farthest = float(np.abs(left - lower).max())
        title = f'distance of the wall from the lower end [rotor spacings], {name}'
        findings.append(Finding('d', title, 0, 2, farthest))
    return findings


def _driven(options: argparse.Namespace) -> str:
    study = read_driving_study(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    runs = run_parallel('driving', study.tasks, options.workers)
    report, findings = page(study, runs)
    report.save(options.output, 'driving')
    table = f'{finding_table(findings)}\n{move_table(moves_of(runs))}'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    return f'{table}\npage and table are in {options.output}'


main = study_command(_driven, 'no new files are written', 'driving', __doc__, 'fewer runs')
