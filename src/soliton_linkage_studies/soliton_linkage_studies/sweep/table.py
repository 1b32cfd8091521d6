# SPDX-License-Identifier: Apache-2.0
"""The table of a sweep, which survives any interruption.

Rows are appended as they come to a part file, next to a copy of the configuration; when all are
there they are sorted into the table, which takes its name in one step.
"""

from __future__ import annotations

import csv
import fcntl
import hashlib
import io
import os
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Protocol

import yaml

from soliton_linkage.progress import ProgressLine
from soliton_linkage_studies.workers import Pool, Rows, cluster, local_processes, measure_rows

RESUMES = 'the same command goes on where it was'

_CONFIGURATION = 'configuration.yaml'


class Tabulated(Rows, Protocol):
    """A study whose rows are measured one by one, such as a sweep."""

    @property
    def name(self) -> str:
        """Name of the table."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, the number of the row first."""

    @property
    def rows(self) -> int:
        """Number of rows."""

    def described(self) -> dict[str, Any]:
        """Return everything that the rows depend on, in the types of YAML."""


class Table:
    """Rows of a sweep in a folder, open for more; a context manager.

    Raises ValueError where the folder is of another configuration, or another sweep is writing.
    """

    def __init__(self, study: Tabulated, folder: Path) -> None:
        """Open the table of a sweep, with the rows that are there already."""
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._part.close()

    @property
    def missing(self) -> list[int]:
        """Numbers of the rows that are not there yet."""
        return [row for row in range(self._study.rows) if row not in self._lines]

    def append(self, cells: Sequence[Sequence[str]]) -> None:
        """Add rows, each once, as they come."""
        lines = {int(row[0]): _line(row) for row in cells}
        self._part.write(''.join(lines.values()))
        self._part.flush()
        self._lines |= lines

    def finish(self) -> None:
        """Write the table with its rows in order, when all are there, and drop the part file."""
        ordered = [_line(self._study.columns)]
        ordered += [self._lines[row] for row in range(self._study.rows)]
        _write(self.path, ''.join(ordered))
        Path(self._part.name).unlink(missing_ok=True)

    def _lock(self, folder: Path) -> None:
        try:
            fcntl.flock(self._part, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(
                f'{folder} is being written by another sweep; wait for it, or give another '
                '--output'
            ) from None

    def _configure(self, folder: Path) -> None:
        """Compare the configuration with that of the rows in the folder, or write it down."""
        copy = folder / _CONFIGURATION
        if not copy.exists():
            _write(copy, yaml.safe_dump(self._study.described(), sort_keys=False))
            return
        earlier: Any = yaml.safe_load(copy.read_text(encoding='utf-8'))
        asked = self._study.described()
        for key, value in asked.items():
            if not isinstance(earlier, dict) or earlier.get(key) != value:
                raise ValueError(
                    f'{folder} holds rows of another configuration, which differs in {key}; give '
                    f'another --output, or delete {folder} to start anew'
                )

    def _read(self) -> dict[int, str]:
        """Rows of the table or of the part file, by number, as lines.

        A last line that was cut off is dropped from the file too, so that the next row does
        not continue it.
        """
        if self.path.exists():
            return _by_number(self.path.read_text(encoding='utf-8').splitlines(True)[1:])
        self._part.seek(0)
        text = self._part.read()
        whole = text[: text.rfind('\n') + 1]
        if whole != text:
            self._part.seek(0)
            self._part.truncate(len(whole.encode()))
        return _by_number(whole.splitlines(True))


def fill_table(
    study: Tabulated, folder: Path, workers: int, scheduler: str = ''
) -> tuple[Path, list[dict[str, str]]]:
    """Measure the rows that a table lacks, here or on a Dask cluster; return its path and rows.

    Raises ChildProcessError if a worker ends early; the rows so far are kept.
    """
    with Table(study, folder) as table:
        missing = table.missing
        if missing:
            count = min(workers, len(missing))
            try:
                with cluster(scheduler) if scheduler else local_processes(count) as pool:
                    _fill(study, table, missing, pool)
            except ChildProcessError as error:
                raise ChildProcessError(f'a worker ended ({error}); {RESUMES}') from error
        table.finish()
    return table.path, read_rows(table.path)


def _fill(study: Tabulated, table: Table, missing: list[int], pool: Pool) -> None:
    """Measure missing rows and show progress; rates include the start of the processes."""
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
        said = f'{total + done} of {study.rows} rows, {done / elapsed:.3g} a second, {left} left'
        line.show(total + done, said)
    line.end(f'{study.name}: {done} rows in {elapsed:.1f} s, {done / elapsed:.3g} a second')


def read_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table as text, by the name of the column."""
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def fingerprint(package: ModuleType) -> str:
    """Return a hash of the sources of a package, for a table whose rows depend on them."""
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


def _by_number(lines: list[str]) -> dict[int, str]:
    return {int(line.split(',', 1)[0]): line for line in lines}


def _line(cells: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator='\n').writerow(cells)
    return text.getvalue()


def _write(path: Path, text: str) -> None:
    """Write a file so that its name never stands for a part of it."""
    passing = path.with_name(f'{path.name}.new')
    with passing.open('w', encoding='utf-8', newline='') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    passing.replace(path)
