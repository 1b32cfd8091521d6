# SPDX-License-Identifier: Apache-2.0
"""Sweep the parameters of a chain over a grid, with seeds for its deviations: table and picture.

An interrupted sweep goes on with the same command. Its table depends neither on interruptions
nor on the number of workers.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.plates import save_caption, save_figure
from soliton_linkage_studies.program import run_study, study_parser
from soliton_linkage_studies.sweep.captions import sweep_caption
from soliton_linkage_studies.sweep.config import read_sweep_study
from soliton_linkage_studies.sweep.pictures import sweep_figure
from soliton_linkage_studies.sweep.table import Table, Tabulated, read_rows
from soliton_linkage_studies.sweep.workers import Workers, cluster_workers, local_workers

GOES_ON = 'the same command goes on where it was'


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
    return run_study(parser, arguments, _swept, GOES_ON)


def _swept(options: argparse.Namespace) -> str:
    try:
        return _measured(options)
    except ChildProcessError as error:
        raise ChildProcessError(f'a worker ended ({error}); {GOES_ON}') from error


def _measured(options: argparse.Namespace) -> str:
    study = read_sweep_study(options.config, options.quick)
    folder = options.output or Path('out/sweeps') / study.name
    if options.scheduler:
        workers = cluster_workers(options.scheduler)
    else:
        workers = local_workers(options.workers)
    with Table(study, folder) as table:
        missing = table.missing
        if missing:
            with workers as ready:
                fill(study, table, missing, ready)
        table.finish()
    rows = read_rows(table.path)
    paths = [table.path]
    figure = sweep_figure(study, rows)
    if figure:
        paths += [folder / f'{study.name}.{kind}' for kind in ('png', 'pdf')]
        for path in paths[1:]:
            save_figure(figure, path)
        save_caption(sweep_caption(study), folder / f'{study.name}.txt')
    failed = sum(bool(row['failure']) for row in rows)
    remark = f'; {failed} rows hold a failure' if failed else ''
    return f'{study.rows} rows in {", ".join(map(str, paths))}{remark}'


def fill(study: Tabulated, table: Table, missing: list[int], workers: Workers) -> None:
    """Measure the rows that are missing and show how it goes.

    Rates are means since the start, that of the processes included.
    """
    line = ProgressLine(study.name, study.rows)
    begin, done, elapsed, rate = time.monotonic(), 0, 0.0, 0.0
    for cells in workers.measured(study, missing):
        table.append(cells)
        done += len(cells)
        elapsed = max(time.monotonic() - begin, 1e-9)
        rate = done / elapsed
        total = study.rows - len(missing) + done
        line.show(
            total,
            f'{total} of {study.rows} points, {rate:.3g} a second, '
            f'{_spoken((len(missing) - done) / rate)} left',
        )
    line.end(f'{study.name}: {done} points in {elapsed:.1f} s, {rate:.3g} a second')


def _spoken(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes} min {rest} s' if minutes else f'{rest} s'


if __name__ == '__main__':
    sys.exit(main())
