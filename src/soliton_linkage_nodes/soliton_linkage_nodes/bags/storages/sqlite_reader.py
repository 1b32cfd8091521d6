# SPDX-License-Identifier: Apache-2.0
"""Reads a whole sqlite3 file of a bag, of any layout that rosbag2 has had."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Generator
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection

from soliton_linkage_nodes.bags.guards.tables import Tables
from soliton_linkage_nodes.bags.storages.connections import (
    LAST_STAMP,
    LimitedReader,
    connection,
    summary_of,
)

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
                    counts.get(number, 0),
                    serialization,
                    profiles,
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
