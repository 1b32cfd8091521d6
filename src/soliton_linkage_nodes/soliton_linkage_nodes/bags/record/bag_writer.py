# SPDX-License-Identifier: Apache-2.0
"""Writer of bags in the layout of rosbag2. A bag stays readable if the writer is killed."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.qos import QoSProfile

from soliton_linkage_nodes.bags import metadata
from soliton_linkage_nodes.bags.metadata import StoredFile
from soliton_linkage_nodes.bags.storages.mcap_records import CUSTOM_DATA, Bytes
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, profiles_text, type_definition
from soliton_linkage_nodes.runtime.stamps import SECOND

COMPRESSIONS = ('none', 'zstd')
_CUSTOM_DATA_INTERVAL = 1.0
"""Shortest time between two writes of the custom data [s]. Each write lengthens the file."""
_RESERVE = 'space_for_the_index'
_RESERVE_BYTES = 2**20
"""Disk space that is reserved for the index [B], sufficient for 10,000 chunks."""


@dataclass(frozen=True)
class UnfinishedBag:
    """Bag that another recorder has not finished, for example because it was killed.

    `counts` maps the topics to their numbers of messages.
    """

    path: Path
    file: StoredFile
    counts: Mapping[StoredTopic, int]
    custom_data: Mapping[str, str]


class BagWriter:
    """Writer of a bag in a directory named `<name>_<first free number>`.

    Only one thread may use the writer. At intervals of `flush_interval` [s], the writer passes the
    new messages to the operating system, so that they are not lost if the process is killed.
    At intervals of `sync_interval` [s], it synchronises the file to the disk; 0 means never. A
    reserve file is removed after a failed write, so that the index fits on a full disk. The
    methods raise OSError if the bag cannot be written.
    """

    def __init__(
        self,
        name: Path,
        compression: str = 'none',
        largest_file: int = 0,
        longest_file: float = 0.0,
        flush_interval: float = 0.1,
        sync_interval: float = 0.0,
        begun: UnfinishedBag | None = None,
    ) -> None:
        """Create a bag, or continue the unfinished bag `begun`.

        The writer begins a new file when the present file reaches the size `largest_file` [B] or
        the duration `longest_file` [s]. The value 0 means no limit.
        """
        if compression not in COMPRESSIONS:
            known = ' or '.join(COMPRESSIONS)
            raise ValueError(f'compression {compression!r} is unknown; use {known}')
        self.path = name
        self.topics: list[StoredTopic] = []
        self._known: dict[tuple[str, str], StoredTopic] = {}
        self.finished = False
        self._is_continued = begun is not None
        self.gap_description = ''
        """Log text about the missing time in a continued bag; '' for a new bag."""
        self._is_open = False
        self._begun: int | None = None
        self._codec = '' if compression == 'none' else compression
        self._flush_interval = flush_interval
        self._sync_interval = sync_interval
        self._largest_file = largest_file
        self._longest_file = round(longest_file * SECOND)
        self._files: list[StoredFile] = []
        self._counts: Counter[int] = Counter()
        self._custom_data: dict[str, str] = {}
        self._written_custom_data: dict[str, str] = {}
        self._flushed_at = self._synced_at = time.monotonic()
        self._custom_data_at = self._flushed_at - _CUSTOM_DATA_INTERVAL
        with self._naming_the_bag():
            self.path = _first_free(name) if begun is None else begun.path
            self.path.mkdir(parents=True, exist_ok=begun is not None)
            try:
                (self.path / _RESERVE).write_bytes(bytes(_RESERVE_BYTES))
                if begun is not None:
                    self._continue(begun)
                self._open_file()
            except BaseException:
                self.remove_if_empty()
                raise

    @property
    def messages(self) -> int:
        """Number of messages stored so far."""
        # list() copies the values in one step. Another thread may add a topic at the same time.
        return sum(list(self._counts.values())) + sum(list(self._file.counts.values()))

    @property
    def files(self) -> int:
        """Number of files of the bag, including the present file."""
        return len(self._files) + 1

    def add_topic(self, topic: str, type_name: str, *profiles: QoSProfile) -> StoredTopic:
        """Add a topic with its QoS profiles. Raises ValueError if its type is not installed."""
        known = self._known.get((topic, type_name))
        if known is not None:
            return known
        definition, digest = type_definition(type_name)
        text = profiles_text(profiles)
        stored = StoredTopic(0, topic, type_name, definition, 'ros2msg', digest, text)
        added = self.add_stored_topic(stored)
        self.flush()
        return added

    def add_stored_topic(self, topic: StoredTopic) -> StoredTopic:
        """Add a topic from another bag.

        Returns a copy of the topic with a new `StoredTopic.number`, its channel id in this bag.
        """
        stored = replace(topic, number=len(self.topics) + 1)
        self._remember(stored)
        with self._naming_the_bag():
            self._file.add_topic(stored)
        return stored

    def write(
        self,
        topic: StoredTopic,
        stamp: int,
        serialized: bytes,
        published: int | None = None,
        sequence: int = 0,
    ) -> None:
        """Store a serialized message with its receive time `stamp` [ns].

        `published` is its publish time [ns]. If it is None, the receive time is stored instead.
        `sequence` is the sequence number from the publisher, or 0 if it is unknown.
        """
        with self._naming_the_bag():
            self._split_if_full(stamp)
            self._file.write(topic.number, stamp, serialized, published, sequence)
        self.flush_if_due()

    def copy_record(self, opcode: int, body: Bytes) -> None:
        """Copy an MCAP record, for example an attachment, from another file without changes."""
        with self._naming_the_bag():
            self._file.copy_record(opcode, body)

    def flush_if_due(self) -> None:
        """Flush, synchronise and write custom data, each only if its interval has elapsed."""
        now = time.monotonic()
        with self._naming_the_bag():
            if now - self._flushed_at >= self._flush_interval:
                self._flushed_at = now
                self._file.flush()
            if 0 < self._sync_interval <= now - self._synced_at:
                self._sync_file()
            if now - self._custom_data_at >= _CUSTOM_DATA_INTERVAL:
                self._write_custom_data()

    def flush(self) -> None:
        """Pass all messages that are still in memory to the operating system."""
        with self._naming_the_bag():
            self._file.flush()

    def checkpoint(self) -> None:
        """Flush and write the custom data. Unless `sync_interval` is 0, synchronise to disk."""
        with self._naming_the_bag():
            self._file.flush()
            self._write_custom_data()
            if self._sync_interval:
                self._sync_file()

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Set custom data of the bag. It is written at most once per second, and at the end."""
        self._custom_data.update(custom_data)

    def add_gap(self, start: int, end: int) -> None:
        """Add an interval without recording, from `start` to `end` [ns], to the custom data."""
        gaps = [*metadata.gaps_in(self._custom_data), (start, end)]
        self._custom_data[metadata.GAPS] = json.dumps(gaps)

    def split(self) -> None:
        """Finish the present file, and continue in a new file."""
        with self._naming_the_bag():
            self._split()

    def close(self, custom_data: Mapping[str, str] | None = None) -> None:
        """Add custom data and finish the bag."""
        self.set_custom_data(custom_data or {})
        with self._naming_the_bag():
            self._close_file()
            self._finish()
            (self.path / _RESERVE).unlink()

    def finish_after_error(self) -> None:
        """Finish the bag after a failed write. The bag contains the messages of earlier writes."""
        try:
            (self.path / _RESERVE).unlink(missing_ok=True)
            if self._is_open:
                self._file.discard()
                self._close_file()
            self._finish()
        except OSError:
            if self._is_open:
                self._file.abandon()

    def remove_if_empty(self) -> None:
        """Remove the bag if it has no messages. A continued bag is never removed."""
        if self._is_continued or (self._is_open and self.messages):
            return
        ours = (f'{self.path.name}_', metadata.METADATA_FILE, _RESERVE)
        with suppress(OSError):
            for path in list(self.path.iterdir()):
                if path.name.startswith(ours):
                    path.unlink()
            self.path.rmdir()

    def _remember(self, topic: StoredTopic) -> None:
        self.topics.append(topic)
        self._known[topic.name, topic.type_name] = topic

    def _continue(self, begun: UnfinishedBag) -> None:
        for topic in sorted(begun.counts, key=lambda topic: topic.number):
            self._remember(topic)
        self._counts.update({topic.number: n for topic, n in begun.counts.items()})
        self._files.append(begun.file)
        now = time.time_ns()
        missing = (now - begun.file.end) / SECOND
        self.gap_description = f', a continued bag; the last {missing:.1f} s are missing'
        self._custom_data = dict(begun.custom_data)
        self.add_gap(begun.file.end, now)

    def _split_if_full(self, stamp: int) -> None:
        if self._begun is None:
            self._begun = stamp
        elif (
            0 < self._longest_file <= stamp - self._begun
            or 0 < self._largest_file <= self._file.size
        ):
            self._split()
            self._begun = stamp

    def _split(self) -> None:
        self._close_file()
        self._is_open = False
        self._begun = None
        self._written_custom_data = {}
        self._open_file()

    def _finish(self) -> None:
        metadata.write_metadata(self.path, self._information([]))
        self._sync_folder()
        self.finished = True

    def _write_custom_data(self) -> None:
        if self._custom_data != self._written_custom_data:
            self._custom_data_at = time.monotonic()
            self._written_custom_data = dict(self._custom_data)
            self._file.add_metadata(CUSTOM_DATA, self._written_custom_data)

    def _sync_file(self) -> None:
        self._synced_at = time.monotonic()
        _sync(self.path / self._file_name())

    def _sync_folder(self) -> None:
        for folder in (self.path, self.path.parent) if self._sync_interval else ():
            _sync(folder)

    def _file_name(self) -> str:
        return f'{self.path.name}_{len(self._files)}{metadata.SUFFIXES[metadata.MCAP]}'

    def _open_file(self) -> None:
        self._file = McapWriter(self.path / self._file_name(), self._codec)
        self._is_open = True
        self._sync_folder()
        for topic in self.topics:
            self._file.add_topic(topic)

    def _close_file(self) -> None:
        self._file.flush()
        start, end = self._file.span or (time.time_ns(),) * 2
        stored = StoredFile(self._file_name(), sum(self._file.counts.values()), start, end)
        self._file.close(metadata.as_text(self._information([stored])))
        if self._sync_interval:
            _sync(self.path / self._file_name())
        self._counts.update(self._file.counts)
        self._file.counts = Counter()
        self._files.append(stored)

    def _information(self, last: Sequence[StoredFile]) -> dict[str, object]:
        counts = {
            topic: self._counts[topic.number] + self._file.counts[topic.number]
            for topic in self.topics
        }
        return metadata.bag_information(counts, [*self._files, *last], self._custom_data)

    @contextmanager
    def _naming_the_bag(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OSError(
                f'bag {str(self.path)!r} cannot be written: {error}; choose another output'
            ) from error


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fdatasync(descriptor)
    finally:
        os.close(descriptor)


def _first_free(name: Path) -> Path:
    number = 0
    while (path := name.parent / f'{name.name}_{number}').exists():
        number += 1
    return path
