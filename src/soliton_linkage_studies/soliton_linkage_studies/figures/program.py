# SPDX-License-Identifier: Apache-2.0
"""Draw the figures of the paper and additional figures, with their data and a table.

Each figure is written as PNG and PDF, its data as CSV. The file table.md compares the values of
the paper, of the theory with the corrections in docs/physics.md, and of the simulated chain. If
only some figures are drawn, the rows of the others remain in the table.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from soliton_linkage_studies.figure_report import Comparison, write_table
from soliton_linkage_studies.figures import FIGURES, DrawFigure
from soliton_linkage_studies.program import (
    import_modules,
    run_parallel,
    select_names,
    study_command,
)
from soliton_linkage_studies.settings import Section, load_settings

import_modules('soliton_linkage_studies.figures')


def draw(figure: DrawFigure, section: Section, output: Path, quick: bool) -> list[Comparison]:
    """Draw a figure, save it under the name of its section, and return its rows of the table."""
    report = figure(section, quick)
    report.save(output, section.name)
    return report.comparisons


def _drawn(options: argparse.Namespace) -> str:
    settings = load_settings(options.config)
    settings.check_keys(*sorted(FIGURES))
    names = select_names(list(settings.values), options.only)
    tasks = {
        name: partial(draw, FIGURES[name], settings.section(name), options.output, options.quick)
        for name in names
    }
    options.output.mkdir(parents=True, exist_ok=True)
    lines = run_parallel('figures', tasks, options.workers)
    write_table(lines, options.output / 'table.md', list(settings.values))
    return f'{len(names)} figures and table.md are in {options.output}'


_LEFT = 'finished figures are kept'
main = study_command(_drawn, _LEFT, 'figures', __doc__, 'fewer points', selective=True)
