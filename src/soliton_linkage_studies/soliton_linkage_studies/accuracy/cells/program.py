# SPDX-License-Identifier: Apache-2.0
"""Fills the table of the cells, goes on with one that was interrupted, and draws it."""

from __future__ import annotations

import time
from pathlib import Path

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.accuracy.cells.comparison import check_comparable, worse_cells
from soliton_linkage_studies.accuracy.cells.pictures import draw_cells, write_cells
from soliton_linkage_studies.accuracy.cells.study import CellStudy
from soliton_linkage_studies.sweep.table import Table, read_rows
from soliton_linkage_studies.sweep.workers import local_workers


def run_cells(study: CellStudy, folder: Path, workers: int, against: Path | None) -> str:
    """Measure the cells that are missing in a folder; returns the last words."""
    earlier = read_rows(against) if against else []
    if against:
        check_comparable(study, earlier)
    print(f'cells: seed {study.seed}, in {folder}')
    with Table(study, folder) as table:
        _fill(study, table, workers)
        table.finish()
    rows = read_rows(table.path)
    write_cells(rows, folder / 'table.md')
    draw_cells(rows, study.seed, study.frames).save(folder, 'normalised_errors')
    said = f'{len(rows)} cells of seed {study.seed} are in {folder}'
    return said if not against else '\n'.join([said, *worse_cells(rows, earlier)])


def _fill(study: CellStudy, table: Table, workers: int) -> None:
    missing = table.missing
    if not missing:
        return
    line = ProgressLine(study.name, study.rows)
    begin, done = time.monotonic(), 0
    with local_workers(min(workers, len(missing))) as ready:
        line.show(study.rows - len(missing), f'{study.rows - len(missing)} of {study.rows}')
        for cells in ready.measured(study, missing):
            table.append(cells)
            done += len(cells)
            left = (time.monotonic() - begin) * (len(missing) / done - 1)
            total = study.rows - len(missing) + done
            line.show(total, f'{total} of {study.rows} cells, {left:.0f} s left')
    line.end(f'{study.name}: {done} cells in {time.monotonic() - begin:.0f} s')
