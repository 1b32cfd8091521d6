# SPDX-License-Identifier: Apache-2.0
"""Sweep the parameters of a chain over a grid, with seeds for its deviations: table and picture.

An interrupted sweep goes on with the same command. Its table depends neither on interruptions
nor on the number of workers.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from soliton_linkage_studies.figure_report import save_caption, save_figure
from soliton_linkage_studies.program import run_study, study_parser
from soliton_linkage_studies.sweep.config import read_sweep_study
from soliton_linkage_studies.sweep.pictures import sweep_caption, sweep_figure
from soliton_linkage_studies.sweep.table import RESUMES, fill_table


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sweep; return 0, 1 where something is wrong, or 130 after Ctrl-C or SIGTERM."""
    parser = study_parser(
        'sweep',
        __doc__,
        'a thinner grid',
        'out/sweeps/NAME OF CONFIG',
        config='phase_diagram',
        scheduler=True,
    )
    return run_study(parser, arguments, _swept, RESUMES)


def _swept(options: argparse.Namespace) -> str:
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
    remark = f'; {failed} rows hold a failure' if failed else ''
    return f'{study.rows} rows in {", ".join(map(str, paths))}{remark}'


if __name__ == '__main__':
    sys.exit(main())
