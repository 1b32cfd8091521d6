# SPDX-License-Identifier: Apache-2.0
"""Sweep the parameters of a chain over a grid, with seeds for its deviations: table and picture.

An interrupted sweep goes on with the same command. Its table depends neither on interruptions
nor on the number of workers.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from contextlib import AbstractContextManager
from pathlib import Path

from soliton_linkage.studies.progress import ProgressLine
from soliton_linkage.studies.sweep.config import SweepStudy, read_study
from soliton_linkage.studies.sweep.pictures import draw_sweep
from soliton_linkage.studies.sweep.table import Table, read_rows
from soliton_linkage.studies.sweep.workers import Workers, cluster_workers, local_workers
from soliton_linkage.studies.workers import process_count

_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run a sweep; returns 0, 1 where something is wrong, or 130 after Ctrl-C or SIGTERM."""
    options = _parsed(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        study = read_study(options.config, options.quick)
        folder = options.output or Path('out/sweeps') / study.name
        if options.scheduler:
            workers = cluster_workers(options.scheduler)
        else:
            workers = local_workers(options.workers)
        _run(study, folder, workers)
    except KeyboardInterrupt:
        print('\ninterrupted; the same command goes on where it was', file=sys.stderr)
        return _INTERRUPTED
    except ChildProcessError as error:
        print(f'sweep: a worker ended ({error}); the same command goes on', file=sys.stderr)
        return 1
    except (ValueError, OSError) as error:
        print(f'sweep: {error}', file=sys.stderr)
        return 1
    return 0


def _run(study: SweepStudy, folder: Path, workers: AbstractContextManager[Workers]) -> None:
    with Table(study, folder) as table:
        missing = table.missing
        if missing:
            with workers as ready:
                _fill(study, table, missing, ready)
        table.finish()
    rows = read_rows(table.path)
    pictures = draw_sweep(study, rows, folder)
    failed = sum(bool(row['failure']) for row in rows)
    names = ', '.join(str(path) for path in (table.path, *pictures))
    remark = f'; {failed} rows hold a failure' if failed else ''
    print(f'{study.rows} rows in {names}{remark}')


def _fill(study: SweepStudy, table: Table, missing: list[int], workers: Workers) -> None:
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


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='sweep', description=__doc__)
    parser.add_argument('config', type=Path, help='YAML file, such as those in config/studies')
    parser.add_argument(
        '--output', type=Path, help='folder for table and picture [out/sweeps/<name of config>]'
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--workers',
        type=process_count,
        default=os.cpu_count() or 1,
        help='processes on this machine [one a core]',
    )
    where.add_argument('--scheduler', help='address of a Dask cluster, tcp://host:8786')
    parser.add_argument('--quick', action='store_true', help='thin the grid to a first look')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
