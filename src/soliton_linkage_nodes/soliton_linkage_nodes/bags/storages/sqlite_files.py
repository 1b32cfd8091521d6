# SPDX-License-Identifier: Apache-2.0
"""Reader of the sqlite3 files of rosbag2, and recovery of damaged sqlite3 files."""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from soliton_linkage_nodes.bags.guards import BagLimits, open_file, regular_file
from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages.storage import Message, RecoveredFile
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, completed

_LEAST_ROW = 4
"""Size of the shortest row of a table [B]. A file of n bytes therefore has at most n / 4 rows."""
_PATIENCE = 4.0
"""Longest search for a row, in addition to the time for reading the whole file [s]."""
_SLOWEST_DISK = 20e6
"""Assumed read rate of a slow disk [B/s]. It determines the time for reading the whole file."""
_CHECK_EVERY = 20_000
"""Number of SQLite instructions between two checks of the time limit [1]. They take less than
1 ms."""
_LONGEST_SQL = 20_000
"""Longest accepted definition of a table [characters]. Definitions in bags have 200 characters."""


class Tables:
    """Read-only tables of a sqlite3 file. Methods raise sqlite3.Error if the file is damaged."""

    def __init__(self, path: Path, largest_value: int, damaged: bool = False) -> None:
        """Open a file. Values of more than `largest_value` bytes are read as None.

        If `damaged` is set, a truncated file can also be opened.
        """
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
        self._database.set_progress_handler(
            lambda: time.monotonic() > self._deadline, _CHECK_EVERY
        )
        self.pragma('trusted_schema = OFF')
        self.pragma('cell_size_check = ON')
        if damaged:
            self.pragma('writable_schema = ON')  # otherwise SQLite rejects a truncated file

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def pragma(self, text: str) -> list[tuple[Any, ...]]:
        """Return the result of a PRAGMA statement of SQLite."""
        self._restart_time_limit()
        return self._database.execute(f'PRAGMA {text}').fetchall()

    def columns(self, table: str) -> list[str]:
        """Return the column names of a table; [] for views and other unusual tables."""
        self._restart_time_limit()
        query = 'SELECT type, rootpage FROM sqlite_master WHERE name = ? LIMIT 2'
        found = self._database.execute(query, (table,)).fetchall()
        if len(found) != 1 or found[0][0] != 'table' or not found[0][1]:
            return []
        listed = self.pragma(f'table_xinfo("{table}")')
        computed = any(hidden for *_, hidden in listed)
        return [] if computed else [str(name) for _, name, *_ in listed]

    def rows(
        self, table: str, columns: Sequence[str], rest: str = '', values: Sequence[object] = ()
    ) -> Iterator[tuple[Any, ...]]:
        """Yield the values of some columns for each row of a table.

        `rest` is the last part of the SELECT statement. `values` replace the placeholders in it.
        """
        self._check(table, columns)
        quoted = ['"{}"'.format(name.replace('"', '""')) for name in columns]
        limited = ', '.join(
            f"CASE WHEN typeof({name}) NOT IN ('blob', 'text') OR length({name}) <= "
            f'{self._largest} THEN {name} END'
            for name in quoted
        )
        cursor = self._database.execute(f'SELECT {limited} FROM {table} {rest}', tuple(values))
        for number, row in enumerate(cursor):
            if number > self.size // _LEAST_ROW:
                raise sqlite3.DatabaseError(f'{table} has more rows than fit into the file')
            yield row
            self._restart_time_limit()

    def counts(self, table: str, column: str) -> dict[Any, int]:
        """Return a mapping from each value in a column to the number of rows with this value."""
        self._check(table, [column])
        query = f'SELECT {column}, count(*) FROM {table} GROUP BY {column}'
        return dict(self._database.execute(query))

    def extremes(self, table: str, column: str) -> tuple[Any, Any]:
        """Return the smallest and the largest value in a column. Without rows, both are None."""
        self._check(table, [column])
        found = [
            self._database.execute(f'SELECT {which}({column}) FROM {table}').fetchone()[0]
            for which in ('min', 'max')
        ]
        return found[0], found[1]

    def topics(self) -> Iterator[tuple[Any, ...]]:
        """Yield the fields of a `StoredTopic` for each topic. Their types are not checked."""
        definitions: dict[Any, tuple[Any, Any]] = {}
        if self.columns('message_definitions'):
            columns = ('topic_type', 'encoding', 'encoded_message_definition')
            for name, encoding, text in self.rows('message_definitions', columns):
                definitions.setdefault(name, (encoding, text))
        held = self.columns('topics')
        later = [n for n in ('offered_qos_profiles', 'type_description_hash') if n in held]
        rows = self.rows('topics', (*_TOPIC, *later), 'ORDER BY id')
        for number, name, kind, serialization, *more in rows:
            profiles, digest = (*more, '', '')[:2]
            encoding, text = definitions.get(kind, ('', ''))
            yield number, name, kind, text, encoding, digest, profiles, serialization

    def _check(self, table: str, columns: Sequence[str]) -> None:
        held = self.columns(table)
        if missing := [name for name in columns if name not in held]:
            raise sqlite3.DatabaseError(f'{table} is not a table with {", ".join(missing)}')
        self._restart_time_limit()

    def _restart_time_limit(self) -> None:
        self._deadline = time.monotonic() + self._patience


_MOST_SELECTED = 500
"""Number of requested topics above which the rows of all topics are read [1]."""
_TOPIC = ('id', 'name', 'type', 'serialization_format')
_MESSAGE = ('topic_id', 'timestamp', 'data')


class StoredSqlite:
    """Reader of the messages of a sqlite3 file in the order of their receive times.

    `topics`, `counts` and `span` have the same meaning as in `IndexedMcap`. The methods raise
    ValueError or sqlite3.Error if the file is damaged.
    """

    def __init__(self, path: Path, limits: BagLimits) -> None:
        """Read the topics and the first and the last receive time."""
        self._limits = limits
        with ExitStack() as stack:
            folder = stack.enter_context(TemporaryDirectory(prefix='bag_'))
            path = _with_journal(path, Path(folder))
            tables = Tables(path, limits.max_unpacked)
            self._tables = stack.enter_context(closing(tables))
            self.counts = Counter(tables.counts('messages', 'topic_id'))
            self.topics = dict(map(_checked_topic, tables.topics()))
            self.span = tables.extremes('messages', 'timestamp') if self.counts else None
            for stamp in self.span or ():
                if not isinstance(stamp, int):
                    text = str(stamp)[:40]
                    raise ValueError(f'a message has the stamp {text}, not a time in ns')
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def messages(
        self, topics: Collection[int], start: int | None, stop: int | None
    ) -> Iterator[Message]:
        """Yield the messages with these topic numbers and a receive time in [start, stop) [ns]."""
        numbers = list(topics) if len(topics) <= _MOST_SELECTED else []
        bounds = {'timestamp >= ?': start, 'timestamp < ?': stop}
        given = {clause: bound for clause, bound in bounds.items() if bound is not None}
        chosen = [f'topic_id IN ({", ".join("?" for _ in numbers)})'] if numbers else []
        where = f'WHERE {" AND ".join([*chosen, *given])}' if chosen or given else ''
        order, values = f'{where} ORDER BY timestamp', [*numbers, *given.values()]
        rows = self._tables.rows('messages', _MESSAGE, order, values)
        for number, stamp, data in rows:
            if not (isinstance(stamp, int) and isinstance(data, bytes)):
                raise ValueError(
                    'a message has no stamp or no bytes, or more bytes than max_unpacked = '
                    f'{self._limits.max_unpacked}'
                )
            if number in topics:
                yield Message(number, 0, stamp, stamp, data)


def _checked_topic(fields: Sequence[Any]) -> tuple[int, StoredTopic]:
    number, *texts = fields
    if not isinstance(number, int) or not all(isinstance(each, str) for each in texts):
        raise ValueError('its table of topics is damaged')
    return number, StoredTopic(number, *texts)


class RecoveredSqlite(RecoveredFile):
    """Recovery of the messages of a sqlite3 file, row by row until SQLite reports an error.

    A sqlite3 file has no checksums. Therefore changed bytes in a message are not detected.
    """

    def _scan(self, path: Path) -> None:
        self._folder = TemporaryDirectory(prefix='recover_bag_')
        self._path = self._readable(path)
        error = _find_error(self._path)
        if error is not None:
            self.report_damage(f'sqlite3 reports: {error}')
        try:
            with closing(self._tables()) as tables:
                self._read_topics(tables)
        except (sqlite3.Error, ValueError) as damage:
            self._report_error(damage)

    def _messages(self) -> Iterator[Message]:
        invalid = 0
        try:
            with closing(self._tables()) as tables:
                for row in tables.rows('messages', _MESSAGE, 'ORDER BY id'):
                    match row:
                        case (int(topic), int(stamp), bytes(data)):
                            self.unverified += 1
                            yield Message(topic, 0, stamp, stamp, data)
                        case _:
                            invalid += 1
        except (sqlite3.Error, ValueError) as error:
            self._report_error(error)
        if invalid:
            self.report_damage(f'{invalid} rows are not messages', invalid)

    def _tables(self) -> Tables:
        return Tables(self._path, self._limits.max_unpacked, damaged=True)

    def _report_error(self, error: Exception) -> None:
        line = f'sqlite3 reports: {" ".join(str(error).split())}'
        if line not in self.damage:
            self.report_damage(line)

    def _readable(self, path: Path) -> Path:
        excess = _bytes_after_last_page(path)
        if excess:
            # SQLite would read the missing bytes of a truncated page as zeros.
            self.report_damage(f'the last {excess} bytes are not a whole page')
        return _with_journal(path, Path(self._folder.name), excess)

    def _read_topics(self, tables: Tables) -> None:
        if 'metadata' in tables.columns('metadata'):
            for (text,) in tables.rows('metadata', ('metadata',)):
                self.custom_data.update(custom_data_of(_text(text)))
        for number, *fields in tables.topics():
            if isinstance(number, int):
                texts: list[Any] = [_text(each) for each in fields]
                topic = StoredTopic(number, *texts)
                encoding = topic.definition_format or 'ros2msg'
                self.topics[number] = completed(replace(topic, definition_format=encoding))


def _with_journal(path: Path, folder: Path, excess: int = 0) -> Path:
    """Return the path of a file that SQLite can open without its journal.

    `excess` is the number of bytes after the last complete page of the file. If there is neither a
    journal nor an excess byte, the result is `path` itself. Otherwise it is the path of a copy in
    `folder`. The copy contains the changes in the journal and lacks the excess bytes.
    """
    journals = [Path(f'{path}{end}') for end in ('-journal', '-wal')]
    present = [each for each in journals if each.is_file() and each.stat().st_size]
    if not (present or excess):
        return path
    copy = folder / path.name
    for source in (path, *present):
        with open_file(source, path.parent) as held, (folder / source.name).open('wb') as out:
            shutil.copyfileobj(held, out)
            if source.name.endswith('-journal'):
                # Clear the last bytes of the journal. If they contained the name of another file,
                # SQLite would delete that file.
                out.write(bytes(8))
            elif source == path and excess:
                out.truncate(out.tell() - excess)
    try:
        with closing(sqlite3.connect(copy)) as database:
            database.execute('PRAGMA journal_mode = DELETE').fetchall()
            database.execute('SELECT count(*) FROM sqlite_master').fetchall()
    except sqlite3.Error:
        pass
    return copy


def _bytes_after_last_page(path: Path) -> int:
    with open_file(path) as file:
        page = int.from_bytes(file.read(18)[16:], 'big')
        return file.seek(0, 2) % (2**16 if page == 1 else page) if page else 0


def _find_error(path: Path) -> str | None:
    size = path.stat().st_size
    try:
        with closing(Tables(path, size)) as tables:
            # Check the size first, because SQLite would fill up a truncated last page with zeros.
            ((page,),) = tables.pragma('page_size')
            ((pages,),) = tables.pragma('page_count')
            if size != page * pages:
                return f'the file has {size} bytes instead of {page * pages}'
            ((result, *_), *_) = tables.pragma('quick_check(1)')
            for table, columns in (('messages', _MESSAGE), ('topics', _TOPIC[:3])):
                if not set(columns) <= set(tables.columns(table)):
                    return f'{table} is not a table with {", ".join(columns)}'
    except (sqlite3.Error, UnicodeDecodeError, ValueError) as error:
        return ' '.join(str(error).split())
    return None if result == 'ok' else ' '.join(str(result).split())


def _text(value: Any) -> str:
    return '' if value is None else str(value)
