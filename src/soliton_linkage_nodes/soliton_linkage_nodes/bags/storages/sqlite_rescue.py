# SPDX-License-Identifier: Apache-2.0
"""Reads what is intact of a sqlite3 file of a bag that was not finished or is damaged."""

from __future__ import annotations

import mmap
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages.sqlite_pages import Row, SqlitePages
from soliton_linkage_nodes.bags.storages.storage import RescuedFile
from soliton_linkage_nodes.bags.stored_topic import completed

_ENCODINGS = ('ros2msg', 'ros2idl', '')
_JOURNALS = ('-journal', '-wal')


class RescuedSqlite(RescuedFile):
    """The intact messages of a sqlite3 file, and what is known of their topics.

    A copy is opened, for sqlite3 mends what an interrupted transaction left. A file that passes
    its check is read row by row; of any other the pages are read one by one. sqlite3 has no
    checksums: bytes that changed within a message go unnoticed.
    """

    def _learn(self, path: Path) -> None:
        self._folder = TemporaryDirectory(prefix='recover_bag_')
        self._path = self._mended(path)
        self._damaged = 0
        self._seen: set[int] = set()
        complaint = _complaint(self._path)
        self._sound = complaint is None
        if complaint is not None:
            self.complain(f'sqlite3 says: {complaint}')
        self._learn_topics()

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        if self._sound:
            with _opened(self._path) as database:
                query = 'SELECT topic_id, timestamp, data FROM messages ORDER BY id'
                yield from database.execute(query)
            database.close()
            return
        for number, values in self._rows():
            message = _message(values)
            if message is not None and number not in self._seen:
                self._seen.add(number)
                yield message

    def _conclude(self) -> None:
        if self._damaged:
            self.complain(f'{self._damaged} rows cannot be put together')
        gaps = max(self._seen) - len(self._seen) if self._seen else 0
        self.lost += max(self._damaged, gaps)

    def _mended(self, path: Path) -> Path:
        """Return the file, or, where a transaction was interrupted, a copy that sqlite3 mended."""
        journals = [Path(f'{path}{end}') for end in _JOURNALS]
        present = [journal for journal in journals if journal.exists() and journal.stat().st_size]
        if not present:
            return path
        copy = Path(self._folder.name, path.name)
        for source in (path, *present):
            shutil.copyfile(source, copy.with_name(source.name))
        try:
            database = sqlite3.connect(copy)
            try:
                database.execute('PRAGMA journal_mode = DELETE').fetchall()
                database.execute('SELECT count(*) FROM sqlite_master').fetchall()
            finally:
                database.close()
        except sqlite3.Error:
            pass
        return copy

    def _rows(self) -> Iterator[Row]:
        with self._path.open('rb') as file:
            if not file.seek(0, 2):
                return
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                pages = SqlitePages(data)
                yield from pages.rows()
                self._damaged = pages.damaged

    def _learn_topics(self) -> None:
        """Learn of topics from the tables, or from every row that looks as if it told of one."""
        if self._sound:
            rows = list(_small_rows(self._path))
        else:
            rows = [row for row in self._rows() if _message(row[1]) is None]
        definitions: dict[str, tuple[str, str, str]] = {}
        for _, values in rows:
            if len(values) == 5 and _is_definition(values):
                definitions[str(values[1])] = (str(values[2]), str(values[3]), str(values[4]))
            elif len(values) == 3 and isinstance(values[2], str):
                self.custom_data.update(custom_data_of(values[2]))
        for number, values in rows:
            if _is_topic(values):
                _, name, type_name, _, profiles, digest = (*map(_text, values), '', '')[:6]
                encoding, text, known = definitions.get(type_name, ('ros2msg', '', ''))
                self.topics[number] = completed(
                    number, name, type_name, (encoding, text), digest or known, profiles
                )


def _complaint(path: Path) -> str | None:
    """What sqlite3 finds wrong with a file of a bag; None for nothing."""
    size = path.stat().st_size
    try:
        with _opened(path) as database:
            # A last page that is cut would be filled up with zeros.
            ((page,),) = database.execute('PRAGMA page_size')
            ((pages,),) = database.execute('PRAGMA page_count')
            if size != page * pages:
                return f'the file has {size} bytes and should have {page * pages}'
            ((said, *_), *_) = database.execute('PRAGMA quick_check(1)').fetchall()
            database.execute('SELECT topic_id, timestamp, data FROM messages LIMIT 1').fetchall()
            database.execute('SELECT name, type FROM topics').fetchall()
        database.close()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        return ' '.join(str(error).split())
    return None if said == 'ok' else ' '.join(str(said).split())


def _opened(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f'{path.resolve().as_uri()}?immutable=1', uri=True)


def _small_rows(path: Path) -> Iterator[tuple[int, tuple[Any, ...]]]:
    with _opened(path) as database:
        database.text_factory = lambda text: text.decode(errors='replace')
        query = "SELECT name FROM sqlite_master WHERE type = 'table'"
        tables = {name for (name,) in database.execute(query)}
        for table in sorted(tables & {'topics', 'message_definitions', 'metadata'}):
            for row in database.execute(f'SELECT * FROM {table}'):
                yield row[0], row
    database.close()


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
