# SPDX-License-Identifier: Apache-2.0
"""A sqlite3 file of rosbag2's layout that is committed often, so that a kill costs little."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import yaml

from soliton_linkage_nodes.bags.metadata import METADATA_VERSION
from soliton_linkage_nodes.bags.storages.sqlite_checksums import SCHEMA as CHECKSUMS
from soliton_linkage_nodes.bags.storages.sqlite_checksums import TABLE as CHECKSUM_TABLE
from soliton_linkage_nodes.bags.storages.sqlite_checksums import packed_checksums
from soliton_linkage_nodes.bags.storages.storage import FileWriter
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_MOST_ROWS_BYTES = 2**20
"""Size of messages that are inserted at one go [B]: each insertion costs a call of sqlite3."""
_ROW_BYTES = 40
"""About what a row takes beside its message: its numbers, stamp, lengths and its index [B]."""
_TOPICS_AGAIN = 'soliton_linkage_topics'
_SCHEMA = """
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(
  id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL, metadata TEXT NOT NULL
);
CREATE TABLE topics(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL
);
CREATE TABLE message_definitions(
  id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
  encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL
);
CREATE TABLE messages(
  id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL,
  data BLOB NOT NULL
);
CREATE TABLE {again}(
  id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
  type_description_hash TEXT NOT NULL
);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);
INSERT INTO schema(schema_version, ros_distro) VALUES (4, 'jazzy');
"""


class SqliteWriter(FileWriter):
    """Writes one file, by one transaction from one flush to the next.

    Transactions keep a rollback journal: at every instant the file is a bag, or becomes one when
    it is opened, and a disk that is full leaves the last transaction out. Two tables beside those
    of rosbag2 hold checksums of the messages, and the topics once more, on other pages.
    """

    def __init__(self, path: Path) -> None:
        """Create the file."""
        super().__init__()
        self._types: set[str] = set()
        self._untold = False
        self._inserted = 0
        self._committed = 0
        self._bytes = 0
        self._rows: list[tuple[int, int, bytes]] = []
        self._rows_bytes = 0
        self._pending: Counter[int] = Counter()
        self._whole_span: tuple[int, int] | None = None
        with _as_os_error():
            self._database = sqlite3.connect(path, isolation_level=None)
            try:
                self._database.execute('PRAGMA journal_mode = TRUNCATE')
                self._database.execute('PRAGMA synchronous = NORMAL')
                self._database.executescript(_SCHEMA.format(again=_TOPICS_AGAIN) + CHECKSUMS)
                self._database.execute('BEGIN')
            except sqlite3.Error:
                self._database.close()
                raise

    @property
    def size(self) -> int:
        """About how many bytes the file takes."""
        return self._bytes + self._rows_bytes

    def add_topic(self, topic: StoredTopic) -> None:
        """Begin to store a topic."""
        with _as_os_error():
            if topic.type_name not in self._types:
                self._types.add(topic.type_name)
                self._database.execute(
                    'INSERT INTO message_definitions (topic_type, encoding, '
                    'encoded_message_definition, type_description_hash) VALUES (?, ?, ?, ?)',
                    (topic.type_name, topic.definition_format, topic.definition, topic.digest),
                )
            told = (
                topic.number,
                topic.name,
                topic.type_name,
                topic.serialization,
                topic.profiles,
                topic.digest,
            )
            for table in ('topics', _TOPICS_AGAIN):
                self._database.execute(f'INSERT INTO {table} VALUES (?, ?, ?, ?, ?, ?)', told)
            self.counts[topic.number] = 0
            self._untold = True

    def write(self, number: int, stamp: int, serialized: bytes) -> None:
        """Store a message of a topic."""
        self._rows.append((number, stamp, serialized))
        self._rows_bytes += len(serialized) + _ROW_BYTES
        self.counts[number] += 1
        if self._rows_bytes > _MOST_ROWS_BYTES:
            with _as_os_error():
                self._insert()

    def flush(self) -> None:
        """Commit all messages: the system keeps them if this process is killed."""
        if self._rows or self._pending or self._untold:
            with _as_os_error():
                self._commit()

    def discard(self) -> None:
        """Forget what the disk refused."""
        with _as_os_error():
            if self._database.in_transaction:
                self._database.execute('ROLLBACK')
            self._database.execute('BEGIN')
        self._pending.update(number for number, _, _ in self._rows)
        self._rows.clear()
        self.counts.subtract(self._pending)
        self._pending.clear()
        self._inserted = self._committed
        self.span = self._whole_span

    def note(self, texts: Mapping[str, str]) -> None:
        """Keep texts, in place of those before."""
        self._put_metadata(yaml.safe_dump({'custom_data': dict(texts)}))

    def close(self, metadata: str) -> None:
        """Commit what is left and the bag's metadata, and end the file."""
        self._put_metadata(metadata)
        with _as_os_error():
            self._database.execute('COMMIT')
            # The emptied journal goes.
            self._database.execute('PRAGMA journal_mode = DELETE')
        self._database.close()

    def abandon(self) -> None:
        """End the file as it was committed last."""
        self._database.close()

    def _put_metadata(self, metadata: str) -> None:
        with _as_os_error():
            self._database.execute(
                'INSERT OR REPLACE INTO metadata VALUES (1, ?, ?)', (METADATA_VERSION, metadata)
            )
            self._commit()

    def _insert(self) -> None:
        first = self._inserted + 1
        self._database.executemany(
            'INSERT INTO messages VALUES (?, ?, ?, ?)',
            ((first + n, *row) for n, row in enumerate(self._rows)),
        )
        self._database.execute(
            f'INSERT INTO {CHECKSUM_TABLE} VALUES (?, ?)',
            (first, packed_checksums(first, self._rows)),
        )
        self._inserted += len(self._rows)
        self._widen([stamp for _, stamp, _ in self._rows])
        self._pending.update(number for number, _, _ in self._rows)
        self._bytes += self._rows_bytes
        self._rows.clear()
        self._rows_bytes = 0

    def _commit(self) -> None:
        if self._rows:
            self._insert()
        self._database.execute('COMMIT')
        self._database.execute('BEGIN')
        self._pending.clear()
        self._untold = False
        self._committed = self._inserted
        self._whole_span = self.span


@contextmanager
def _as_os_error() -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(str(error)) from error
