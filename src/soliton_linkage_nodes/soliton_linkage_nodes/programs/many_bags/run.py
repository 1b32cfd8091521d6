# SPDX-License-Identifier: Apache-2.0
"""Fill the table of many bags, on all cores or on a Dask cluster, whatever happens to workers."""

from __future__ import annotations

import sys

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.programs.many_bags.study import ManyBags
from soliton_linkage_studies.sweep.table import Table, read_rows
from soliton_linkage_studies.sweep.workers import Workers, cluster_workers, local_workers


def analyse_many(study: ManyBags, workers: int, scheduler: str | None = None) -> int:
    """Analyse the bags that are not in the table yet; return how many could not be.

    Where a process has ended, others go on with what is left, as long as there is progress.
    """
    with Table(study, study.folder) as table:
        while missing := table.missing:
            ready = cluster_workers(scheduler) if scheduler else local_workers(workers)
            try:
                with ready as pool:
                    _fill(study, table, pool)
            except ChildProcessError as error:
                if table.missing == missing:
                    raise
                print(f'analyse_bag: {error}; others go on', file=sys.stderr)
        table.finish()
    failed = [row for row in read_rows(table.path) if row['failure']]
    for row in failed:
        print(f'{row["bag"]}: {row["failure"]}', file=sys.stderr)
    print(f'{study.rows - len(failed)} of {study.rows} bags in {table.path}')
    return len(failed)


def _fill(study: ManyBags, table: Table, workers: Workers) -> None:
    line = ProgressLine('analysing', study.rows)
    for cells in workers.measured(study, table.missing):
        table.append(cells)
        done = study.rows - len(table.missing)
        line.show(done, f'{done} of {study.rows} bags')
    line.clear()
