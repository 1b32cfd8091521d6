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
from soliton_linkage_nodes.bags.rescue.rescued import Findings, RescuedMessage, completed
from soliton_linkage_nodes.bags.rescue.sqlite_pages import Row, SqlitePages
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_ENCODINGS = ('ros2msg', 'ros2idl', '')
_JOURNALS = ('-journal', '-wal')


class RescuedSqlite:
    """The intact messages of a sqlite3 file, and what is known of their topics.

    A copy is opened, for sqlite3 mends what an interrupted transaction left. A file that passes
    its check is read row by row; of any other the pages are read one by one. sqlite3 has no
    checksums: bytes that changed within a message go unnoticed.
    """

    def __init__(self, path: Path) -> None:
        """Look through the file."""
        self.findings = Findings()
        self.custom_data: dict[str, str] = {}
        self._topics: dict[int, StoredTopic] = {}
        self._folder = TemporaryDirectory(prefix='recover_bag_')
        self._path = self._mended(path)
        self._damaged = 0
        complaint = _complaint(self._path)
        self._sound = complaint is None
        if complaint is not None:
            self.findings.damage.append(f'sqlite3 says: {complaint}')
        self._learn()
        self.topics = list(self._topics.values())

    def messages(self) -> Iterator[RescuedMessage]:
        """Yield the intact messages; `findings` is complete after the last."""
        seen: set[int] = set()
        unknown = 0
        for number, values in self._message_rows():
            topic = self._topics.get(values[1])
            if not self._sound:
                if number in seen:
                    continue
                seen.add(number)
            if topic is None:
                unknown += 1
                continue
            self.findings.messages += 1
            yield topic, values[2], values[3]
        if unknown:
            self.findings.damage.append(f'{unknown} messages are of topics whose names are lost')
        if self._damaged:
            self.findings.damage.append(f'{self._damaged} rows cannot be put together')
        if seen:
            self._damaged = max(self._damaged, max(seen) - len(seen))
        self.findings.lost = unknown + self._damaged

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

    def _message_rows(self) -> Iterator[tuple[int, tuple[Any, ...]]]:
        if self._sound:
            with _opened(self._path) as database:
                query = 'SELECT id, topic_id, timestamp, data FROM messages ORDER BY id'
                for row in database.execute(query):
                    yield row[0], row
            database.close()
            return
        for number, values in self._rows():
            if _is_message(values):
                yield number, values

    def _learn(self) -> None:
        """Learn of topics from the tables, or from every row that looks as if it told of one."""
        if self._sound:
            rows = list(_small_rows(self._path))
        else:
            rows = [row for row in self._rows() if not _is_message(row[1])]
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
                self._topics[number] = completed(
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


def _is_message(values: tuple[Any, ...]) -> bool:
    return (
        len(values) == 4
        and isinstance(values[1], int)
        and isinstance(values[2], int)
        and isinstance(values[3], bytes)
    )


def _is_definition(values: tuple[Any, ...]) -> bool:
    return values[2] in _ENCODINGS and '/' in str(values[1]) and str(values[1])[0] != '/'


def _is_topic(values: tuple[Any, ...]) -> bool:
    named = len(values) in (4, 5, 6) and isinstance(values[1], str) and isinstance(values[2], str)
    return named and values[1].startswith('/') and '/' in values[2]


def _text(value: Any) -> str:
    return '' if value is None else str(value)
