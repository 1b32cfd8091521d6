# SPDX-License-Identifier: Apache-2.0
"""Reads sqlite3 files of rosbag2, whole and damaged ones, by their tables alone."""

from __future__ import annotations

import shutil
import sqlite3
import time
from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.interfaces import Connection

from soliton_linkage_nodes.bags.guards import open_file, regular_file
from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages.storage import (
    LAST_STAMP,
    LimitedReader,
    RescuedFile,
    connection,
    summary_of,
)
from soliton_linkage_nodes.bags.stored_topic import completed

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

    def __init__(self, path: Path, largest_value: int, damaged: bool = False) -> None:
        """Open a file; values of more bytes than the largest are left out, as None.

        A `damaged` file may have fewer pages than its header states.
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
        self._database.set_progress_handler(self._is_late, _LOOK_EVERY)
        self.pragma('trusted_schema = OFF')
        self.pragma('cell_size_check = ON')
        if damaged:
            self.pragma('writable_schema = ON')  # SQLite opens a file that was cut with this alone

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


_MOST_ASKED = 500
"""Topics that sqlite3 is asked for by number; of more it is asked for all."""
_TOPIC = ('id', 'name', 'type', 'serialization_format')
_LATER = ('offered_qos_profiles', 'type_description_hash')
_DEFINITION = ('topic_type', 'encoding', 'encoded_message_definition')


class StoredSqlite(LimitedReader):
    """The messages of a sqlite3 file in the order of their receipt.

    Methods raise ValueError or sqlite3.Error where the file is damaged.
    """

    def __init__(self, path: Path) -> None:
        """Look for nothing yet."""
        super().__init__()
        self._path = path
        self._tables: Tables | None = None

    def open(self) -> None:
        """Learn which topics there are."""
        self._tables = Tables(self._path, self.limits.most_unpacked)
        try:
            self._learn(self._tables)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the file."""
        if self._tables is not None:
            self._tables.close()

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield topic, stamp [ns] and bytes, from a stamp on and before another."""
        if self._tables is None:
            raise sqlite3.ProgrammingError('it is not open')
        wanted = {each.id: each for each in connections}
        numbers = list(wanted) if len(wanted) <= _MOST_ASKED else []
        clauses = [f'topic_id IN ({", ".join("?" for _ in numbers)})'] if numbers else []
        values: list[Any] = [*numbers]
        for clause, bound in (('timestamp >= ?', start), ('timestamp < ?', stop)):
            if bound is not None:
                clauses.append(clause)
                values.append(bound)
        where = f'WHERE {" AND ".join(clauses)}' if clauses else ''
        rows = self._tables.rows(
            'messages',
            ('topic_id', 'timestamp', 'data'),
            f'{where} ORDER BY timestamp',
            values,
        )
        for number, stamp, data in rows:
            if not (isinstance(stamp, int) and isinstance(data, bytes)):
                raise ValueError(
                    'a message is no bytes with a stamp, or has more than most_unpacked = '
                    f'{self.limits.most_unpacked} of them'
                )
            if number in wanted:
                yield wanted[number], stamp, data

    def _learn(self, tables: Tables) -> None:
        definitions: dict[str, tuple[str, str]] = {}
        if tables.columns('message_definitions'):
            for name, encoding, text in tables.rows('message_definitions', _DEFINITION):
                definitions.setdefault(name, (encoding, text))
        counts = tables.counts('messages', 'topic_id')
        held = tables.columns('topics')
        columns = (*_TOPIC, *(name for name in _LATER if name in held))
        for number, name, type_name, serialization, *later in tables.rows(
            'topics', columns, 'ORDER BY id'
        ):
            profiles, digest = (*later, '', '')[:2]
            definition = definitions.get(type_name, ('', ''))
            texts = (name, type_name, serialization, profiles, digest, *definition)
            if not isinstance(number, int) or not all(isinstance(each, str) for each in texts):
                raise ValueError('its table of topics is damaged')
            self.connections.append(
                connection(
                    self,
                    number,
                    name,
                    type_name,
                    definition,
                    digest,
                    count=counts.get(number, 0),
                    serialization=serialization,
                    profiles=profiles,
                )
            )
        first, last = tables.extremes('messages', 'timestamp')
        span = None
        if counts:
            span = (_stamp(first), _stamp(last))
        self.metadata = summary_of(self.connections, span)


def _stamp(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value <= LAST_STAMP:
        raise ValueError(f'a message has the stamp {str(value)[:40]}, which is no time in ns')
    return value


_JOURNALS = ('-journal', '-wal')
_MESSAGE = ('topic_id', 'timestamp', 'data')


class RescuedSqlite(RescuedFile):
    """The messages of a sqlite3 file, row by row until SQLite reports an error.

    A copy is opened if a transaction was interrupted, because SQLite completes it. rosbag2 stores
    no checksums: bytes that changed within a message go unnoticed, and every message counts as
    unverified.
    """

    def _learn(self, path: Path) -> None:
        self._folder = TemporaryDirectory(prefix='recover_bag_')
        self._path = self._mended(path)
        self._damaged = 0
        complaint = _complaint(self._path)
        if complaint is not None:
            self.complain(f'sqlite3 says: {complaint}')
        try:
            with closing(self._tables()) as tables:
                self._learn_topics(tables)
        except (sqlite3.Error, ValueError) as error:
            self._note_error(error)

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        try:
            with closing(self._tables()) as tables:
                for row in tables.rows('messages', _MESSAGE, 'ORDER BY id'):
                    match row:
                        case (int(topic), int(stamp), bytes(data)):
                            self.unverified += 1
                            yield topic, stamp, data
                        case _:
                            self._damaged += 1
        except (sqlite3.Error, ValueError) as error:
            self._note_error(error)

    def _conclude(self) -> None:
        if self._damaged:
            self.complain(f'{self._damaged} rows are no messages', self._damaged)

    def _tables(self) -> Tables:
        return Tables(self._path, self._limits.most_unpacked, damaged=True)

    def _note_error(self, error: Exception) -> None:
        said = f'sqlite3 says: {" ".join(str(error).split())}'
        if said not in self.damage:
            self.complain(said)

    def _mended(self, path: Path) -> Path:
        """Return the file, or a copy: of its whole pages, after an interrupted transaction."""
        journals = [Path(f'{path}{end}') for end in _JOURNALS]
        present = [each for each in journals if each.is_file() and each.stat().st_size]
        excess = _excess(path)
        if excess:
            # SQLite would read the rest of a page that is cut as zeros.
            self.complain(f'the last {excess} bytes are not a whole page')
        elif not present:
            return path
        copy = Path(self._folder.name, path.name)
        for source in (path, *present):
            with (
                open_file(source, path.parent) as held,
                Path(self._folder.name, source.name).open('wb') as out,
            ):
                shutil.copyfileobj(held, out)
                if source != path:
                    # A journal may end in the name of another file, which SQLite then deletes.
                    out.write(bytes(8))
                elif excess:
                    out.truncate(out.tell() - excess)
        try:
            with closing(sqlite3.connect(copy)) as database:
                database.execute('PRAGMA journal_mode = DELETE').fetchall()
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
        except sqlite3.Error:
            pass
        return copy

    def _learn_topics(self, tables: Tables) -> None:
        definitions: dict[str, tuple[str, str]] = {}
        if tables.columns('message_definitions'):
            for name, encoding, text in tables.rows('message_definitions', _DEFINITION):
                definitions[str(name)] = (str(encoding), str(text))
        if 'metadata' in tables.columns('metadata'):
            for (text,) in tables.rows('metadata', ('metadata',)):
                self.custom_data.update(custom_data_of(_text(text)))
        held = tables.columns('topics')
        later = [n for n in ('offered_qos_profiles', 'type_description_hash') if n in held]
        for number, name, type_name, *more in tables.rows('topics', (*_TOPIC[:3], *later)):
            if isinstance(number, int):
                profiles, digest = (*map(_text, more), '', '')[:2]
                definition = definitions.get(_text(type_name), ('ros2msg', ''))
                self.topics[number] = completed(
                    number, _text(name), _text(type_name), definition, digest, profiles
                )


def _excess(path: Path) -> int:
    """Return the number of bytes after the last whole page of a file."""
    with open_file(path) as file:
        page = int.from_bytes(file.read(18)[16:], 'big')
        return file.seek(0, 2) % (2**16 if page == 1 else page) if page else 0


def _complaint(path: Path) -> str | None:
    """Return what SQLite finds wrong with a file of a bag; None for nothing."""
    size = path.stat().st_size
    try:
        with closing(Tables(path, size)) as tables:
            # SQLite would fill up a last page that is cut with zeros.
            ((page,),) = tables.pragma('page_size')
            ((pages,),) = tables.pragma('page_count')
            if size != page * pages:
                return f'the file has {size} bytes and should have {page * pages}'
            ((said, *_), *_) = tables.pragma('quick_check(1)')
            for table, columns in (('messages', _MESSAGE), ('topics', _TOPIC[:3])):
                if not set(columns) <= set(tables.columns(table)):
                    return f'{table} is no table with {", ".join(columns)}'
    except (sqlite3.Error, UnicodeDecodeError, ValueError) as error:
        return ' '.join(str(error).split())
    return None if said == 'ok' else ' '.join(str(said).split())


def _text(value: Any) -> str:
    return '' if value is None else str(value)
