# SPDX-License-Identifier: Apache-2.0
"""Table of a sweep that can be interrupted and continued.

Each finished row is appended to a part file, beside a copy of the configuration. When all rows are
finished, they are sorted and written to the table file.
"""

from __future__ import annotations

import csv
import fcntl
import hashlib
import io
import os
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import yaml

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.workers import Pool, Rows, cluster, local_processes, measure_rows

RESUMES = 'the same command continues the measurement'

_CONFIGURATION = 'configuration.yaml'


class Tabulated(Rows, Protocol):
    """Study whose results form a table with one independent measurement per row."""

    @property
    def name(self) -> str:
        """Name of the study; the table file is this name with the suffix .csv."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; the first column is the row number."""

    @property
    def rows(self) -> int:
        """Number of rows."""

    def described(self) -> dict[str, Any]:
        """Return all data that determine the rows, as types that YAML can store."""


class Table:
    """Context manager of a table in a folder, to which rows are appended.

    Raises ValueError if the folder contains rows of another configuration, or if another program
    writes to the folder.
    """

    def __init__(self, study: Tabulated, folder: Path) -> None:
        self.path = folder / f'{study.name}.csv'
        self._study = study
        folder.mkdir(parents=True, exist_ok=True)
        self._part = (folder / f'{self.path.name}.part').open('a+', encoding='utf-8', newline='')
        try:
            self._lock(folder)
            self._configure(folder)
            self._lines = self._read()
        except BaseException:
            self._part.close()
            raise

    def __enter__(self) -> Table:
        return self

    def __exit__(self, *_: object) -> None:
        self._part.close()

    @property
    def missing(self) -> list[int]:
        """Numbers of the rows that are not yet measured."""
        return [row for row in range(self._study.rows) if row not in self._lines]

    def append(self, cells: Sequence[Sequence[str]]) -> None:
        """Append rows in any order; each row may be appended only once."""
        lines = {int(row[0]): _line(row) for row in cells}
        self._part.write(''.join(lines.values()))
        self._part.flush()
        self._lines |= lines

    def finish(self) -> None:
        """Write the complete table in row order and delete the part file."""
        ordered = [_line(self._study.columns)]
        ordered += [self._lines[row] for row in range(self._study.rows)]
        _write(self.path, ''.join(ordered))
        Path(self._part.name).unlink(missing_ok=True)

    def _lock(self, folder: Path) -> None:
        try:
            fcntl.flock(self._part, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f'another program is writing to {folder}; wait until it ends, or give another '
                '--output'
            ) from None

    def _configure(self, folder: Path) -> None:
        copy = folder / _CONFIGURATION
        if not copy.exists():
            _write(copy, yaml.safe_dump(self._study.described(), sort_keys=False))
            return
        earlier: Any = yaml.safe_load(copy.read_text(encoding='utf-8'))
        asked = self._study.described()
        for key, value in asked.items():
            if not isinstance(earlier, dict) or earlier.get(key) != value:
                raise ValueError(
                    f'{folder} contains rows of another configuration, which differs in {key}; '
                    f'give another --output, or delete {folder} to restart'
                )

    def _read(self) -> dict[int, str]:
        """Return the existing lines by row number; remove the last line if it is incomplete."""
        if self.path.exists():
            lines = self.path.read_text(encoding='utf-8').splitlines(True)[1:]
        else:
            self._part.seek(0)
            text = self._part.read()
            whole = text[: text.rfind('\n') + 1]
            if whole != text:
                self._part.seek(0)
                self._part.truncate(len(whole.encode()))
            lines = whole.splitlines(True)
        return {int(line.split(',', 1)[0]): line for line in lines}


def fill_table(
    study: Tabulated, folder: Path, workers: int, scheduler: str | None = None
) -> tuple[Path, list[dict[str, str]]]:
    """Measure the missing rows of a table; return its path and all its rows.

    The rows are measured by local processes, or on a Dask cluster if its address `scheduler` is
    given. If a worker ends unexpectedly, new processes measure the missing rows. Raises
    ChildProcessError if they do not finish a row either; finished rows remain in the part file.
    """
    with Table(study, folder) as table:
        while missing := table.missing:
            count = min(workers, len(missing))
            try:
                with cluster(scheduler) if scheduler else local_processes(count) as pool:
                    _fill(study, table, missing, pool)
            except ChildProcessError as error:
                if table.missing == missing:
                    raise ChildProcessError(f'a worker ended ({error}); {RESUMES}') from error
                print(f'{study.name}: {error}; new processes continue', file=sys.stderr)
        table.finish()
    return table.path, read_rows(table.path)


def _fill(study: Tabulated, table: Table, missing: list[int], pool: Pool) -> None:
    line = ProgressLine(study.name, study.rows)
    begin, done, elapsed = time.monotonic(), 0, 0.0
    total = study.rows - len(missing)
    line.show(total, f'{total} of {study.rows}')
    for cells in measure_rows(pool, study, missing):
        table.append(cells)
        done += len(cells)
        elapsed = max(time.monotonic() - begin, 1e-9)
        minutes, seconds = divmod(round(elapsed * (len(missing) - done) / done), 60)
        left = f'{minutes} min {seconds} s' if minutes else f'{seconds} s'
        status = f'{total + done} of {study.rows} rows, {done / elapsed:.3g} a second, {left} left'
        line.show(total + done, status)
    line.end(f'{study.name}: {done} rows in {elapsed:.1f} s, {done / elapsed:.3g} a second')


def read_rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table; each row maps a column name to its text."""
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def fingerprint(package: ModuleType) -> str:
    """Return a hash of all Python files of a package."""
    found = hashlib.sha256()
    for folder in package.__path__:
        for path in sorted(Path(folder).rglob('*.py')):
            found.update(path.read_bytes())
    return found.hexdigest()[:16]


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    lines = (f'| {" | ".join(row)} |' for row in (titles, *rows))
    header = next(lines)
    return '\n'.join([header, '|' + ' --- |' * len(titles), *lines]) + '\n'


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerow(cells)
    return text.getvalue()


def _write(path: Path, text: str) -> None:
    temporary = path.with_name(f'{path.name}.new')
    with temporary.open('w', encoding='utf-8', newline='') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
