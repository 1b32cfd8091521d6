# SPDX-License-Identifier: Apache-2.0
"""Reads what is intact of a sqlite3 file of a bag that was not finished or is damaged."""

from __future__ import annotations

import mmap
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from soliton_linkage_nodes.bags.guards.files import open_file
from soliton_linkage_nodes.bags.guards.tables import Tables
from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages import sqlite_checksums
from soliton_linkage_nodes.bags.storages.sqlite_checksums import Checksums, checksum
from soliton_linkage_nodes.bags.storages.sqlite_pages import Row, SqlitePages
from soliton_linkage_nodes.bags.storages.storage import RescuedFile
from soliton_linkage_nodes.bags.stored_topic import completed

_ENCODINGS = ('ros2msg', 'ros2idl', '')
_JOURNALS = ('-journal', '-wal')
_MESSAGE = ('id', 'topic_id', 'timestamp', 'data')
_LEAST_MESSAGE = 8
"""Bytes of the shortest row of a message: what says of more that is missing is wrong itself."""


class RescuedSqlite(RescuedFile):
    """The intact messages of a sqlite3 file, and what is known of their topics.

    A copy is opened, for sqlite3 mends what an interrupted transaction left. A file that passes
    its check is read row by row; of any other the pages are read one by one. A message counts if
    its checksum is right, or `doubtful` messages are wanted; what other writers have recorded has
    none, and bytes that changed within a message go unnoticed there.
    """

    def _learn(self, path: Path) -> None:
        self._folder = TemporaryDirectory(prefix='recover_bag_')
        self._path = self._mended(path)
        self._damaged = 0
        self._altered = 0
        self._seen: set[int] = set()
        self._last = 0
        complaint = _complaint(self._path)
        self._sound = complaint is None
        if complaint is not None:
            self.complain(f'sqlite3 says: {complaint}')
        self._learn_topics()
        self._damaged = 0

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        rows = self._stored_rows() if self._sound else self._rows()
        try:
            for number, values in rows:
                message = _message(values)
                if message is None:
                    self._damaged += self._sound
                elif number not in self._seen and self._is_right(number, message):
                    self._last = max(self._last, number)
                    if not self._sound:
                        self._seen.add(number)
                    yield message
        except sqlite3.Error as error:
            self.complain(f'sqlite3 says: {" ".join(str(error).split())}')

    def _is_right(self, number: int, message: tuple[int, int, bytes]) -> bool:
        if len(message[2]) > self._limits.most_unpacked:
            self._damaged += 1
            return False
        recorded = self._checksums.of(number)
        if recorded is None:
            self.unverified += 1
            return True
        right = checksum(number, *message) == recorded
        self._altered += not right
        return right or self._doubtful

    def _conclude(self) -> None:
        if self._damaged:
            self.complain(f'{self._damaged} rows cannot be put together')
        if self._altered:
            done = 'brought back' if self._doubtful else 'left out'
            self.complain(f'{self._altered} messages have a wrong checksum: {done}')
        most = self._path.stat().st_size // _LEAST_MESSAGE
        if self._sound:
            missing = self._checksums.last - (self._read - self.unverified)
        else:
            missing = max(self._checksums.last, self._last) - self._read
        gaps = missing if 0 <= missing <= most else 0
        left_out = 0 if self._doubtful else self._altered
        self.lost += max(self._damaged + left_out, gaps)

    def _mended(self, path: Path) -> Path:
        """Return the file, or, where a transaction was interrupted, a copy that sqlite3 mended."""
        journals = [Path(f'{path}{end}') for end in _JOURNALS]
        present = [each for each in journals if each.is_file() and each.stat().st_size]
        if not present:
            return path
        copy = Path(self._folder.name, path.name)
        for source in (path, *present):
            with (
                open_file(source, path.parent) as held,
                Path(self._folder.name, source.name).open('wb') as out,
            ):
                shutil.copyfileobj(held, out)
                if source != path:
                    # A journal may end in the name of another file, which sqlite3 then deletes.
                    out.write(bytes(_LEAST_MESSAGE))
        try:
            with closing(sqlite3.connect(copy)) as database:
                database.execute('PRAGMA journal_mode = DELETE').fetchall()
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
        except sqlite3.Error:
            pass
        return copy

    def _stored_rows(self) -> Iterator[Row]:
        with closing(Tables(self._path, self._limits.most_unpacked)) as tables:
            for number, *values in tables.rows('messages', _MESSAGE, 'ORDER BY id'):
                yield (number, (None, *values)) if isinstance(number, int) else (0, ())

    def _rows(self) -> Iterator[Row]:
        with self._path.open('rb') as file:
            if not file.seek(0, 2):
                return
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                pages = SqlitePages(data)
                yield from pages.rows()
                self._damaged += pages.damaged

    def _learn_topics(self) -> None:
        """Learn of topics from the tables, or from every row that looks as if it told of one."""
        told: Iterable[Row]
        if self._sound:
            told = _small_rows(self._path, self._limits.most_unpacked)
        else:
            told = (row for row in self._rows() if _message(row[1]) is None)
        definitions: dict[str, tuple[str, str, str]] = {}
        named: dict[int, tuple[Any, ...]] = {}
        checksums: list[tuple[int, Any]] = []
        for number, values in told:
            if len(values) == 2:
                checksums.append((number, values[1]))
            elif len(values) == 5 and _is_definition(values):
                definitions[str(values[1])] = (str(values[2]), str(values[3]), str(values[4]))
            elif len(values) == 3 and isinstance(values[2], str):
                self.custom_data.update(custom_data_of(values[2]))
            elif _is_topic(values):
                named.setdefault(number, values)
        self._checksums = Checksums(checksums)
        for number, values in named.items():
            _, name, type_name, _, profiles, digest = (*map(_text, values), '', '')[:6]
            encoding, text, known = definitions.get(type_name, ('ros2msg', '', ''))
            self.topics[number] = completed(
                number, name, type_name, (encoding, text), digest or known, profiles
            )


def _complaint(path: Path) -> str | None:
    """What sqlite3 finds wrong with a file of a bag; None for nothing."""
    size = path.stat().st_size
    try:
        with closing(Tables(path, size)) as tables:
            # A last page that is cut would be filled up with zeros.
            ((page,),) = tables.pragma('page_size')
            ((pages,),) = tables.pragma('page_count')
            if size != page * pages:
                return f'the file has {size} bytes and should have {page * pages}'
            ((said, *_), *_) = tables.pragma('quick_check(1)')
            for table, columns in (('messages', _MESSAGE), ('topics', ('name', 'type'))):
                if not set(columns) <= set(tables.columns(table)):
                    return f'{table} is no table with {", ".join(columns)}'
    except (sqlite3.Error, UnicodeDecodeError, ValueError) as error:
        return ' '.join(str(error).split())
    return None if said == 'ok' else ' '.join(str(said).split())


def _small_rows(path: Path, largest: int) -> Iterator[Row]:
    with closing(Tables(path, largest)) as tables:
        for table in ('topics', 'message_definitions', 'metadata', sqlite_checksums.TABLE):
            columns = tables.columns(table)
            for row in tables.rows(table, columns) if columns else ():
                if isinstance(row[0], int):
                    yield row[0], row


def _message(values: tuple[Any, ...]) -> tuple[int, int, bytes] | None:
    """Topic number, stamp [ns] and bytes in a row that looks as if it were a message's."""
    match values:
        case (_, int(topic), int(stamp), bytes(data)):
            return topic, stamp, data
    return None


def _is_definition(values: tuple[Any, ...]) -> bool:
    return values[2] in _ENCODINGS and '/' in str(values[1]) and str(values[1])[0] != '/'


def _is_topic(values: tuple[Any, ...]) -> bool:
    named = len(values) in (4, 5, 6) and isinstance(values[1], str) and isinstance(values[2], str)
    return named and values[1].startswith('/') and '/' in values[2]


def _text(value: Any) -> str:
    return '' if value is None else str(value)
