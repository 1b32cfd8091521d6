# SPDX-License-Identifier: Apache-2.0
"""Tables of a sqlite3 file, and nothing in it that would have sqlite3 compute for long."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.guards.files import regular_file

_LEAST_ROW = 4
"""Bytes of the shortest row: a file of n bytes has at most n / 4, whatever its pages say."""
_PATIENCE = 4.0
"""How long sqlite3 may look for a row [s], beside the time that it takes to read the file."""
_SLOWEST_DISK = 20e6
"""What a disk reads at least [B/s]."""
_LOOK_EVERY = 20_000
"""Steps of sqlite3's machine from one look at the clock to the next, some tenths of a ms."""
_LONGEST_SQL = 20_000
"""Characters of a definition of a table; those of bags have 200."""


class Tables:
    """The tables of a sqlite3 file, opened as it is; methods raise sqlite3.Error of damage."""

    def __init__(self, path: Path, largest_value: int) -> None:
        """Open a file; values of more bytes than the largest are left out, as None."""
        path = regular_file(path)
        self._largest = largest_value
        self.size = path.stat().st_size
        self._patience = _PATIENCE + self.size / _SLOWEST_DISK
        self._database = sqlite3.connect(
            f'{path.as_uri()}?immutable=1&mode=ro', uri=True, check_same_thread=False
        )
        self._database.text_factory = lambda text: text.decode(errors='replace')
        if hasattr(self._database, 'setlimit'):  # since Python 3.11
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, largest_value + 4096)
            self._database.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, _LONGEST_SQL)
            self._database.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        self._deadline = 0.0
        self._database.set_progress_handler(self._is_late, _LOOK_EVERY)
        self.pragma('trusted_schema = OFF')
        self.pragma('cell_size_check = ON')

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def pragma(self, text: str) -> list[tuple[Any, ...]]:
        """What a pragma answers."""
        self._deadline = time.monotonic() + self._patience
        return self._database.execute(f'PRAGMA {text}').fetchall()

    def columns(self, table: str) -> list[str]:
        """Names of the columns of a table as they are stored; empty where it is no plain table."""
        self._deadline = time.monotonic() + self._patience
        query = 'SELECT type, rootpage FROM sqlite_master WHERE name = ? LIMIT 2'
        found = self._database.execute(query, (table,)).fetchall()
        if len(found) != 1 or found[0][0] != 'table' or not found[0][1]:
            return []
        told = self.pragma(f'table_xinfo("{table}")')
        computed = any(hidden for *_, hidden in told)
        return [] if computed else [str(name) for _, name, *_ in told]

    def rows(
        self, table: str, columns: Sequence[str], rest: str = '', values: Sequence[object] = ()
    ) -> Iterator[tuple[Any, ...]]:
        """Yield columns of the rows of a table; `rest` is where they begin, end and are ordered.

        Raises sqlite3.Error where it is no plain table or has more rows than the file can hold.
        """
        self._check(table, columns)
        quoted = ['"{}"'.format(name.replace('"', '""')) for name in columns]
        asked = ', '.join(
            f"CASE WHEN typeof({name}) NOT IN ('blob', 'text') OR length({name}) <= "
            f'{self._largest} THEN {name} END'
            for name in quoted
        )
        cursor = self._database.execute(f'SELECT {asked} FROM {table} {rest}', tuple(values))
        for number, row in enumerate(cursor):
            if number > self.size // _LEAST_ROW:
                raise sqlite3.DatabaseError(f'{table} has more rows than fit into the file')
            yield row
            self._deadline = time.monotonic() + self._patience

    def counts(self, table: str, column: str) -> dict[Any, int]:
        """How many rows of a table have each value of a column."""
        self._check(table, [column])
        query = f'SELECT {column}, count(*) FROM {table} GROUP BY {column}'
        return dict(self._database.execute(query))

    def extremes(self, table: str, column: str) -> tuple[Any, Any]:
        """Least and largest value of a column, None where it has none."""
        self._check(table, [column])
        found = [
            self._database.execute(f'SELECT {which}({column}) FROM {table}').fetchone()[0]
            for which in ('min', 'max')
        ]
        return found[0], found[1]

    def _check(self, table: str, columns: Sequence[str]) -> None:
        """Raise an error unless it is a table with such columns; begin to wait for an answer."""
        held = self.columns(table)
        if missing := [name for name in columns if name not in held]:
            raise sqlite3.DatabaseError(f'{table} is no table with {", ".join(missing)}')
        self._deadline = time.monotonic() + self._patience

    def _is_late(self) -> bool:
        return time.monotonic() > self._deadline
