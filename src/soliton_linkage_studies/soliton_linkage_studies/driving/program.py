# SPDX-License-Identifier: Apache-2.0
"""Drive chains with all actuators, tilts and moves, and validate the results on one page.

Write the page as PNG and PDF, its data as CSV, and a table as Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.steering.steering import Outcome
from soliton_linkage_studies.driving.pictures import (
    IMBALANCE_LIMIT,
    blank_page,
    draw_balance,
    draw_moves,
    draw_stiffness,
    draw_tilt,
    draw_work,
    entitle,
)
from soliton_linkage_studies.driving.runs import DrivingStudy, Results, read_driving_study
from soliton_linkage_studies.figure_report import FigureReport
from soliton_linkage_studies.figures.actuator import draw_response, stepped_response
from soliton_linkage_studies.figures.rigid_limit import convergence_order
from soliton_linkage_studies.moves import table_lines
from soliton_linkage_studies.program import run_parallel, run_study, study_parser
from soliton_linkage_studies.settings import load_settings


@dataclass(frozen=True)
class Finding:
    """Measured number and its allowed range, including the bounds."""

    panel: str
    quantity: str
    lowest: float
    highest: float
    measured: float

    @property
    def holds(self) -> bool:
        """Whether the measured number lies in its range."""
        return self.lowest <= self.measured <= self.highest


def page(study: DrivingStudy, results: Results) -> tuple[FigureReport, list[Finding]]:
    """Return the page of results, and its measured numbers with their allowed ranges."""
    report, panels = blank_page()
    response = stepped_response(PneumaticActuator(), study.step)
    draw_response(report, panels['a'], response)
    draw_balance(report, panels['b'], results.balances)
    stiffnesses = [task.chain.stiffness for task in study.stiffnesses]
    order = convergence_order(stiffnesses, results.apart)
    draw_stiffness(report, panels['c'], stiffnesses, results.apart, order)
    draw_tilt(report, panels['t'], panels['d'], results.tilts)
    chains = {name: tasks[0].chain for (name, _), tasks in study.moves.items()}
    moves = {key: runs[0] for key, runs in results.moves.items()}
    draw_moves(report, panels['e'], chains, moves)
    draw_work(report, panels['f'], results.works)
    entitle(panels)
    highest = float(study.step.values.max())
    findings = [
        Finding(
            'a',
            'deviation of the closed form from numerical integration / pressure',
            0,
            1e-6,
            response.distance / highest,
        ),
        *_balance_findings(results),
        Finding('c', 'order of the deviation of springs from bars in 1/k_e', 0.9, 1.1, order),
        *_tilt_findings(study, results),
        *_move_findings(results),
        *_work_findings(results),
    ]
    return report, findings


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """Return the lines of the table in Markdown."""
    return [
        '| panel | quantity | measured | allowed range | holds |',
        '| --- | --- | --- | --- | --- |',
        *(
            f'| {found.panel} | {found.quantity} | {found.measured:.3g} '
            f'| {found.lowest:g} to {found.highest:g} | {"yes" if found.holds else "no"} |'
            for found in findings
        ),
    ]


def _balance_findings(results: Results) -> list[Finding]:
    title = 'largest error of the energy balance / largest energy'
    return [
        Finding('b', f'{title}, {name}', 0, IMBALANCE_LIMIT, float(run.imbalances.max()))
        for name, run in results.balances.items()
    ]


def _tilt_findings(study: DrivingStudy, results: Results) -> list[Finding]:
    """Return the largest distance of the wall from the lower end after each tilt."""
    findings = []
    for name, run in results.tilts.items():
        task = study.tilts[name]
        last = task.chain.number_of_rotors - 1
        lower = [last if tilt > 0 else 0 for tilt in task.tilts]
        left = run.places.reshape(len(task.tilts), -1)[:, -1]
        farthest = float(np.abs(left - lower).max())
        title = f'distance of the wall from the lower end [rotor spacings], {name}'
        findings.append(Finding('d', title, 0, 2, farthest))
    return findings


def _move_findings(results: Results) -> list[Finding]:
    """Return the largest error of all moves of a chain, NaN if a move did not reach its goal."""
    findings = []
    for (name, title), runs in results.moves.items():
        reached = all(run.outcome is Outcome.REACHED for run in runs)
        error = max(run.error for run in runs) if reached else np.nan
        quantity = f'distance of the wall from its goal [rotor spacings], {name}, {title}'
        findings.append(Finding('e', quantity, 0, 0.1, float(error)))
    return findings


def _work_findings(results: Results) -> list[Finding]:
    title = '(work − energy gain) / energy gain'
    return [
        Finding('f', f'{title}, {name}', 0, 1e-9, abs(float(run.works[-1] / run.energies[-1] - 1)))
        for name, run in results.works.items()
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the page of a settings file; return 1 on failure, 130 on Ctrl-C."""
    parser = study_parser('driving', __doc__, 'fewer runs')
    return run_study(parser, arguments, _driven, 'no new files are written')


def _driven(options: argparse.Namespace) -> str:
    study = read_driving_study(load_settings(options.config), options.quick)
    options.output.mkdir(parents=True, exist_ok=True)
    results = Results.of(run_parallel('driving', study.tasks, options.workers))
    report, findings = page(study, results)
    report.save(options.output, 'driving')
    table = '\n'.join([*finding_lines(findings), '', *table_lines(results.moves)]) + '\n'
    (options.output / 'table.md').write_text(table, encoding='utf-8')
    return f'{table}\npage and table are in {options.output}'


if __name__ == '__main__':
    sys.exit(main())
