# SPDX-License-Identifier: Apache-2.0
"""Measure walls on a grid of chain parameters; seeds give random deviations of the chains.

Write a table and a picture. After an interruption, the same command continues the sweep. The table
does not depend on interruptions or on the number of workers.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from soliton_linkage_studies.figure_report import save_caption, save_figure
from soliton_linkage_studies.program import study_command
from soliton_linkage_studies.sweep.config import read_sweep_study
from soliton_linkage_studies.sweep.pictures import sweep_caption, sweep_figure
from soliton_linkage_studies.sweep.table import RESUMES, fill_table


def _run(options: argparse.Namespace) -> str:
    study = read_sweep_study(options.config, options.quick)
    folder = options.output or Path('out/sweeps') / study.name
    path, rows = fill_table(study, folder, options.workers, options.scheduler)
    paths = [path]
    figure = sweep_figure(study, rows)
    if figure:
        paths += [folder / f'{study.name}.{kind}' for kind in ('png', 'pdf')]
        for each in paths[1:]:
            save_figure(figure, each)
        save_caption(sweep_caption(study), folder / f'{study.name}.txt')
    failed = sum(bool(row['failure']) for row in rows)
    note = f'; {failed} rows have a failure' if failed else ''
    return f'{study.rows} rows in {", ".join(map(str, paths))}{note}'


_NAMES = 'out/sweeps/NAME_OF_CONFIG', 'phase_diagram'
main = study_command(_run, RESUMES, 'sweep', __doc__, 'a coarser grid', *_NAMES, scheduler=True)
