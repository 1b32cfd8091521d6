# SPDX-License-Identifier: Apache-2.0
"""Move walls by motors with non-reciprocal coupling; compare the wall velocities with theory."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from soliton_linkage.dynamics.initial_states import with_pair
from soliton_linkage.linkage.chain import Chain, displacement
from soliton_linkage_studies import palette
from soliton_linkage_studies.active.runs import (
    ActiveRun,
    ActiveTask,
    WallDrive,
    follow_charge,
    motorised,
    moving,
    outcome,
    stability_limit,
    terminal_velocity,
    wall_drive,
    wall_sites,
)
from soliton_linkage_studies.drawing import show_leans
from soliton_linkage_studies.figure_report import FigureReport, new_report, save_page
from soliton_linkage_studies.program import run_parallel, study_command
from soliton_linkage_studies.settings import Section, load_settings, setting

_CAPTION = """
Walls in chains whose motors put a torque κ (q_n − q_(n+1)) on both rotors of each bond.

(a) Terminal velocity of kinks (filled marks) and anti-kinks (open marks) against κ / c, where c is
the linear damping. Lines are the theory: κ / c times a ratio of two sums along the orbit of the
wall. Error bars show standard errors and are smaller than most marks. Fast walls are slower than
the theory, because they radiate phonons. The lines of anti-kinks are dotted where an anti-kink at
rest is pinned; the simulated ones start in motion. (b) Displacement u of each rotor over time, for
a kink ahead of an anti-kink: orange if u < 0, white if u = 0, purple if u > 0. Both walls move
towards the last rotor. The black line is the track of the kink. The slopes of the dashed green
lines are the velocities of the theory. (c) The same for a kink behind an anti-kink. They meet and
annihilate. Between the two pale lines that remain, the staggered angles are near π − θ̄, with the
same displacement as θ̄.

(d) Fate of an anti-kink of the first chain with fixed ends, against κ / c and the decay rate c /
(M r²): it runs (sky blue dots), is pinned (crosses), breaks up (red triangles) or vanishes (black
squares). Below the solid line a resting anti-kink is pinned. To the right of the dashed line,
waves grow in an infinite uniform chain. (e) Power of the motors (blue) and of the damping (red),
for a kink that starts at rest. The dashed green line is the theory c v² Σ t² at the terminal
velocity v. (f) Site of a kink that starts against the motors and turns back. The slope of the
dashed green line is the velocity of the theory.
"""
_TITLES = {
    'a': 'a  Terminal velocity',
    'b': 'b  Kink ahead of an anti-kink',
    'c': 'c  Kink behind an anti-kink',
    'd': 'd  Fate of an anti-kink',
    'e': 'e  Power balance of a kink from rest',
    'f': 'f  Kink that starts against the motors',
}
_OUTCOME_MARKS = {
    'runs': ('o', palette.SKY),
    'is pinned': ('x', palette.DARK),
    'breaks up': ('^', palette.RED),
    'vanishes': ('s', palette.BLACK),
}
_RATIO = 'κ / c [1/s]'
_VELOCITY = 'velocity [rotors/s]'
_TIME = 'time [s]'
_SITE = 'site [rotor spacings]'
_FRAMES = 600
"""Number of frames of each simulation [1]."""
_LONGEST = 60.0
"""Longest duration of a simulation [s]; slow walls would need more time to cross the chain."""

Drives = dict[tuple[str, int], WallDrive]
"""Effect of the motors on a wall, by chain name and charge."""
Runs = Mapping[tuple[Any, ...], ActiveRun]
"""Runs by the key of their task: the panel name and the parameter values."""


@dataclass(frozen=True)
class ActiveStudy:
    """Chains and parameter values that a settings file specifies."""

    chains: dict[str, Chain]
    diagram_ratios: tuple[float, ...]
    diagram_decays: tuple[float, ...]
    ratios: tuple[float, ...] = setting('coupling κ / damping c in panel a', '1/s', 0.01, 1e3)
    decay: float = setting('decay rate c / (M r^2), except in panel d', '1/s', 1e-3, 1e3)
    pair_ratio: float = setting('κ / c in panels b, c, e and f', '1/s', 0.01, 1e3)

    @staticmethod
    def read(settings: Section, quick: bool) -> ActiveStudy:
        """Read the settings. Raises ValueError if they are invalid."""
        diagram = settings.section('diagram')
        diagram.check_keys('ratios', 'decays')
        ranges = ('ratios', 0.01, 1e3), ('decays', 1e-3, 1e3)
        every = slice(None, None, 3 if quick else 1)
        ratios, decays = (diagram.numbers(*each)[every] for each in ranges)
        values = settings.values_of(ActiveStudy, 'chains', 'diagram')
        study = ActiveStudy(settings.chains(), ratios, decays, **values)
        return replace(study, ratios=study.ratios[every])

    @property
    def drives(self) -> Drives:
        """Effect of the motors by chain name and charge.

        Anti-kinks for which `wall_drive` raises an error are omitted.
        """
        found: Drives = {}
        for name, chain in self.chains.items():
            for charge in (1, -1):
                try:
                    found[name, charge] = wall_drive(chain, charge)
                except ArithmeticError:
                    continue
        return found

    def tasks(self, drives: Drives) -> dict[tuple[Any, ...], ActiveTask]:
        """Return all tasks. A key consists of the panel name and the parameter values."""
        tasks: dict[tuple[Any, ...], ActiveTask] = {}
        for ((name, charge), drive), ratio in product(drives.items(), self.ratios):
            task = self._sent(self.chains[name], self.decay, ratio, charge, drive.ratio)
            tasks['a', name, charge, ratio] = task
        first = next(iter(self.chains))
        chain = self.chains[first]
        for ratio, decay in product(self.diagram_ratios, self.diagram_decays):
            tasks['d', ratio, decay] = self._sent(chain, decay, ratio, -1, drives[first, -1].ratio)
        active = motorised(chain, self.decay, self.pair_ratio)
        velocity = self.pair_ratio * drives[first, 1].ratio
        rotors = chain.number_of_rotors
        rest = np.zeros(rotors)
        duration = 0.75 * rotors / velocity
        for panel, kink, anti_kink in (('b', 24.0, 12.5), ('c', 12.0, 16.5)):
            angles = with_pair(chain, kink, anti_kink).angles
            tasks[panel,] = ActiveTask(active, angles, rest, duration, duration / _FRAMES, 1)
        angles, _ = moving(chain, 10.0, 1, 0.0)
        tasks['e',] = ActiveTask(active, angles, rest, duration, duration / _FRAMES, 1)
        angles, rates = moving(chain, 0.75 * rotors, 1, -4 * velocity)
        tasks['f',] = ActiveTask(active, angles, rates, duration, duration / _FRAMES, 1)
        return tasks

    @staticmethod
    def _sent(chain: Chain, decay: float, ratio: float, charge: int, drive: float) -> ActiveTask:
        active, velocity = motorised(chain, decay, ratio), ratio * drive
        angles, rates = moving(chain, 10.5, charge, velocity)
        duration = min(_LONGEST, 0.8 * chain.number_of_rotors / velocity)
        period = duration / _FRAMES
        return ActiveTask(active, angles, rates, duration, period, charge, fixed=charge < 0)


def page(study: ActiveStudy, drives: Drives, runs: Runs) -> FigureReport:
    """Return the figure of the study, with its data and a table of simulation and theory."""
    report = new_report(_CAPTION, 11.0, 10.5)
    panels = report.figure.subplot_mosaic('ad;bc;ef')
    _draw_velocities(report, panels['a'], drives, runs)
    first = next(iter(study.chains))
    for panel in 'bc':
        _draw_pair(report, panel, panels[panel], runs[panel,])
    for panel, charge in (('b', 1), ('b', -1), ('f', 1)):
        drive = drives[first, charge]
        _compare_track(report, panels[panel], panel, charge, runs[panel,], drive)
    _draw_diagram(report, panels['d'], study, drives, runs)
    _draw_power(report, panels['e'], drives[first, 1], runs['e',])
    run = runs['f',]
    panels['f'].plot(run.recording.times, run.sites, color=palette.BLUE)
    report.add_points('f', 'kink', (_TIME, _SITE), run.recording.times, run.sites)
    panels['f'].set(xlabel=_TIME, ylabel=_SITE)
    largest = max(each.imbalance for key, each in runs.items() if key[0] != 'd')
    report.add_comparison(
        'largest imbalance of energy and work, without panel d', '', 'closed balance', largest, 0.0
    )
    for name, axes in panels.items():
        axes.set_title(_TITLES[name], loc='left', fontsize='medium')
    return report


def _draw_velocities(report: FigureReport, axes: Axes, drives: Drives, runs: Runs) -> None:
    names = list(dict.fromkeys(name for name, _ in drives))
    for (name, charge), drive in drives.items():
        kind = 'kink' if charge > 0 else 'anti-kink'
        colour = palette.COLOURS[names.index(name)]
        found = {key[3]: run for key, run in runs.items() if key[:3] == ('a', name, charge)}
        ratios = np.array(list(found))
        measured = np.array([terminal_velocity(run) for run in found.values()])
        theory = [drive.velocity(run.chain) for run in found.values()]
        face = colour if charge > 0 else 'none'
        series = f'{name}, {kind}'
        look: Any = {'fmt': 'o', 'color': colour, 'markerfacecolor': face, 'markersize': 5}
        axes.errorbar(ratios, *measured.T, label=series, **look)
        onset = drive.pinning / next(iter(found.values())).chain.damping
        bend = float(np.clip(onset, ratios[0], ratios[-1]))
        for ends, line in (((ratios[0], bend), ':'), ((bend, ratios[-1]), '--')):
            style = '-' if charge > 0 else line
            axes.plot(ends, np.array(ends) * drive.ratio, style, color=colour)
        kinds = zip(('measured', 'standard error', 'theory'), (*measured.T, theory), strict=True)
        for kind, values in kinds:
            report.add_points('a', f'{series}: {kind}', (_RATIO, _VELOCITY), ratios, values)
        for ratio, expected, (velocity, _) in zip(ratios, theory, measured, strict=True):
            report.add_comparison(
                f'{_VELOCITY}, {series}, κ / c = {ratio:g} / s',
                f'2 κ / c = {2 * ratio:g} (wide walls)',
                'κ <g> / (c Σ t²)' if ratio > onset else f'pinned, or {expected:.5g} in motion',
                float(velocity),
                expected if ratio > onset else math.nan,
            )
    axes.set(xlabel=_RATIO, ylabel=_VELOCITY)
    axes.legend(fontsize='x-small')


def _compare_track(
    report: FigureReport, axes: Axes, panel: str, charge: int, run: ActiveRun, drive: WallDrive
) -> None:
    found = [wall_sites(run.chain, angles) for angles in run.recording.angles]
    track, velocity = follow_charge(found, charge), drive.velocity(run.chain)
    tracked = np.flatnonzero(np.isfinite(track))
    times, sites = (each[tracked[len(tracked) // 2 :]] for each in (run.recording.times, track))
    line = sites.mean() + velocity * (times - times.mean())
    kind, names = 'kink' if charge > 0 else 'anti-kink', (_TIME, _SITE)
    axes.plot(times, line, '--', color=palette.GREEN, linewidth=2, zorder=3)
    report.add_points(panel, f'{kind}: theory', names, times, line)
    report.add_comparison(
        f'{_VELOCITY}, {kind} of panel {panel}',
        '',
        'κ <g> / (c Σ t²)',
        float(np.polyfit(times, sites, 1)[0]),
        velocity,
    )


def _draw_pair(report: FigureReport, panel: str, axes: Axes, run: ActiveRun) -> None:
    chain, times = run.chain, run.recording.times
    extent = 0.0, float(times[-1]), -0.5, chain.number_of_rotors - 0.5
    show_leans(axes, chain, displacement(chain, run.recording.angles).T, extent)
    axes.plot(times, run.sites, color=palette.BLACK, linewidth=0.8)
    report.add_points(panel, 'kink', (_TIME, _SITE), times, run.sites)
    axes.set(xlabel=_TIME, ylabel='rotor n [1]')


def _draw_diagram(
    report: FigureReport, axes: Axes, study: ActiveStudy, drives: Drives, runs: Runs
) -> None:
    outcomes = {key[1:]: outcome(run) for key, run in runs.items() if key[0] == 'd'}
    for name, (marker, colour) in _OUTCOME_MARKS.items():
        points = np.array([key for key, found in outcomes.items() if found == name])
        if len(points):
            axes.plot(*points.T, marker, color=colour, linestyle='', label=name)
            report.add_points('d', name, (_RATIO, 'decay rate [1/s]'), *points.T)
    first, chain = next(iter(study.chains.items()))
    decays = np.geomspace(min(study.diagram_decays), max(study.diagram_decays), 50)
    pinned = drives[first, -1].pinning / (decays * chain.moment_of_inertia)
    axes.plot(pinned, decays, color=palette.BLACK, linewidth=1)
    axes.axvline(stability_limit(chain), color=palette.BLACK, linestyle='--', linewidth=1)
    axes.set(xscale='log', yscale='log', xlabel=_RATIO, ylabel='decay rate c / (M r²) [1/s]')
    spread = 1.3
    axes.set_xlim(min(study.diagram_ratios) / spread, spread * max(study.diagram_ratios))
    axes.set_xticks(study.diagram_ratios, [f'{each:g}' for each in study.diagram_ratios])
    axes.set_yticks(study.diagram_decays, [f'{each:g}' for each in study.diagram_decays])
    axes.minorticks_off()
    axes.legend(fontsize='x-small', ncols=4, loc='lower right', bbox_to_anchor=(1.0, 1.0))


def _draw_power(report: FigureReport, axes: Axes, drive: WallDrive, run: ActiveRun) -> None:
    chain, times = run.chain, run.recording.times
    end = len(times) * 3 // 4
    for name, colour, power in (
        ('motors', palette.BLUE, run.injected),
        ('damping', palette.RED, run.dissipated),
    ):
        axes.plot(times, 1e3 * power, color=colour, label=name)
        report.add_points('e', name, (_TIME, 'power [W]'), times, power)
    expected = chain.damping * drive.velocity(chain) ** 2 * drive.squares
    axes.axhline(1e3 * expected, color=palette.GREEN, linestyle='--', linewidth=1)
    axes.set(xlabel=_TIME, ylabel='power [mW]')
    axes.legend(fontsize='x-small')
    report.add_comparison(
        'terminal power of the damping [W]', '', 'c v² Σ t²', float(run.dissipated[end]), expected
    )
    report.add_comparison(
        'ratio of the powers of motors and damping at the end',
        '',
        'balance',
        float(run.injected[end] / run.dissipated[end]),
        1.0,
    )


def _active(options: argparse.Namespace) -> str:
    study = ActiveStudy.read(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    drives = study.drives
    runs = run_parallel('active', study.tasks(drives), options.workers)
    return save_page(page(study, drives, runs), options.output, 'active')


main = study_command(_active, 'no new files are written', 'active', __doc__, 'fewer runs')
