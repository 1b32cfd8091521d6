# SPDX-License-Identifier: Apache-2.0
"""Bags of rosbag2's layout that survive the end of their writer, whatever ends it."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.qos import QoSProfile

from soliton_linkage_nodes.bags.guards import load_json
from soliton_linkage_nodes.bags.metadata import (
    MCAP,
    METADATA_FILE,
    SUFFIXES,
    StoredFile,
    as_text,
    bag_information,
    write_metadata,
)
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, profiles_text, type_definition
from soliton_linkage_nodes.runtime.stamps import SECOND

COMPRESSIONS = ('none', 'zstd')
_NOTE_INTERVAL = 1.0
"""How often changed texts are put into the file, which in mcap keeps every version [s]."""
_GAPS = 'gaps'
_RESERVE = 'space_for_the_index'
_RESERVE_BYTES = 2**20
"""Room for the index of a day's mcap file, which takes some 100 bytes a chunk [B]."""


@dataclass(frozen=True)
class BagBegun:
    """What a bag holds that another has begun: one file, topics with counts, and texts."""

    path: Path
    file: StoredFile
    counts: Mapping[StoredTopic, int]
    custom_data: Mapping[str, str]


class BagWriter:
    """A bag that is being written, in a directory named `<name>_<first free number>`.

    Its files are called after the directory, `<directory>_0`, `<directory>_1`, ... Ten times
    a second, or when `tick` is called after that time, what was written is handed to the system,
    which keeps it if the process is killed. Where the disk is full, a file of 1 MiB that was kept
    free makes room for the index. Every `sync_interval` [s], unless that is 0, the disk is made to
    take it, so that a loss of power costs no more.

    It may be used from one thread only. Its methods raise OSError where the
    bag cannot be written.
    """

    def __init__(
        self,
        name: Path,
        compression: str = 'none',
        largest_file: int = 0,
        longest_file: float = 0.0,
        flush_interval: float = 0.1,
        sync_interval: float = 0.0,
        begun: BagBegun | None = None,
    ) -> None:
        """Create the directory; a new file is begun after so many bytes or seconds, if any.

        A bag that another has begun is gone on with in a new file.
        """
        if compression not in COMPRESSIONS:
            known = ' or '.join(COMPRESSIONS)
            raise ValueError(f'compression {compression!r} is not known; use {known}')
        self.path = name
        self.topics: list[StoredTopic] = []
        self._known: dict[tuple[str, str], StoredTopic] = {}
        self.finished = False
        self._of_another = begun is not None
        self.gap = ''
        """What is to be said of a bag that is gone on with."""
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
        self._noted: dict[str, str] = {}
        self._flushed_at = self._synced_at = time.monotonic()
        self._noted_at = self._flushed_at - _NOTE_INTERVAL
        with self._complaining():
            self.path = _first_free(name) if begun is None else begun.path
            self.path.mkdir(parents=True, exist_ok=begun is not None)
            try:
                (self.path / _RESERVE).write_bytes(bytes(_RESERVE_BYTES))
                if begun is not None:
                    self._take_over(begun)
                self._file = self._open_file()
                self._is_open = True
                for topic in self.topics:
                    self._file.add_topic(topic)
                self._sync_folder()
            except BaseException:
                self.leave_nothing()
                raise

    @property
    def messages(self) -> int:
        """Messages stored so far."""
        # Other threads may ask while a topic is added: the lists are made at one go.
        return sum(list(self._counts.values())) + sum(list(self._file.counts.values()))

    @property
    def files(self) -> int:
        """Files begun so far."""
        return len(self._files) + 1

    def add_topic(self, topic: str, type_name: str, *profiles: QoSProfile) -> StoredTopic:
        """Begin to store a topic, with the qualities of service that its publishers offer.

        Raises ValueError where the definition of its type is not to be had.
        """
        definition, digest = type_definition(type_name)
        text = profiles_text(profiles)
        stored = StoredTopic(0, topic, type_name, definition, 'ros2msg', digest, text)
        added = self.add_stored_topic(stored)
        self.flush()
        return added

    def add_stored_topic(self, topic: StoredTopic) -> StoredTopic:
        """Begin to store a topic that is told whole; return it with its number in this bag."""
        known = self._known.get((topic.name, topic.type_name))
        if known is not None:
            return known
        stored = replace(topic, number=len(self.topics) + 1)
        self._keep(stored)
        with self._complaining():
            self._file.add_topic(stored)
        return stored

    def write(self, topic: StoredTopic, stamp: int, serialized: bytes) -> None:
        """Store a serialized message that was received at a time since the epoch [ns]."""
        self.write_all([(topic, stamp, serialized)])

    def write_all(self, messages: Iterable[tuple[StoredTopic, int, bytes]]) -> None:
        """Store serialized messages, each with its topic and when it was received [ns]."""
        with self._complaining():
            for topic, stamp, serialized in messages:
                if self._begun is None:
                    self._begun = stamp
                elif self._is_full(stamp - self._begun):
                    self._split()
                    self._begun = stamp
                self._file.write(topic.number, stamp, serialized)
        self.tick()

    def tick(self) -> None:
        """Hand what was written to the system, if the last time was not just now."""
        now = time.monotonic()
        with self._complaining():
            if now - self._flushed_at >= self._flush_interval:
                self._flushed_at = now
                self._file.flush()
            if 0 < self._sync_interval <= now - self._synced_at:
                self._sync_file()
            if now - self._noted_at >= _NOTE_INTERVAL:
                self._note()

    def flush(self) -> None:
        """Hand what was written to the system now."""
        with self._complaining():
            self._file.flush()

    def keep(self) -> None:
        """Hand all over, texts too, and have the disk take it, if it ever is made to."""
        with self._complaining():
            self._file.flush()
            self._note()
            if self._sync_interval:
                self._sync_file()

    def note(self, custom_data: Mapping[str, str]) -> None:
        """Keep texts in the bag's metadata, also if the bag is never closed."""
        self._custom_data.update(custom_data)

    def split(self) -> None:
        """Go on in a new file."""
        with self._complaining():
            self._split()

    def close(self, custom_data: Mapping[str, str] | None = None) -> None:
        """Finish the bag, with texts that are kept in its metadata."""
        self.note(custom_data or {})
        with self._complaining():
            self._close_file()
            self._finish()
            (self.path / _RESERVE).unlink()

    def rescue(self) -> None:
        """Finish a bag that could not be written, with what the disk took, as far as it goes."""
        try:
            (self.path / _RESERVE).unlink(missing_ok=True)
            if self._is_open:
                self._file.discard()
                self._close_file()
            self._finish()
        except OSError:
            if self._is_open:
                self._file.abandon()

    def leave_nothing(self) -> None:
        """Remove a bag of its own that has no message, be it finished or not even begun."""
        if self._of_another or (self._is_open and self.messages):
            return
        ours = (f'{self.path.name}_', METADATA_FILE, _RESERVE)
        with suppress(OSError):
            for path in list(self.path.iterdir()):
                if path.name.startswith(ours):
                    path.unlink()
            self.path.rmdir()

    def _keep(self, topic: StoredTopic) -> None:
        self.topics.append(topic)
        self._known[topic.name, topic.type_name] = topic

    def _take_over(self, begun: BagBegun) -> None:
        """Have what was recorded before, and say from when to when [ns] nothing was."""
        for topic in sorted(begun.counts, key=lambda topic: topic.number):
            self._keep(topic)
        self._counts.update({topic.number: n for topic, n in begun.counts.items()})
        self._files.append(begun.file)
        missing = (time.time_ns() - begun.file.end) / SECOND
        self.gap = f', which was begun before: {missing:.1f} s up to now are missing'
        told = load_json(begun.custom_data.get(_GAPS, '[]'))
        gaps = [*(told if isinstance(told, list) else []), [begun.file.end, time.time_ns()]]
        self._custom_data = {**begun.custom_data, _GAPS: json.dumps(gaps)}

    def _split(self) -> None:
        self._close_file()
        self._is_open = False
        self._file = self._open_file()
        self._begun = None
        self._is_open = True
        self._sync_folder()
        for topic in self.topics:
            self._file.add_topic(topic)
        self._noted = {}

    def _finish(self) -> None:
        write_metadata(self.path, self._information([]))
        self._sync_folder()
        self.finished = True

    def _note(self) -> None:
        if self._custom_data != self._noted:
            self._noted_at = time.monotonic()
            self._noted = dict(self._custom_data)
            self._file.note(self._noted)

    def _sync_file(self) -> None:
        self._synced_at = time.monotonic()
        _sync(self.path / self._file_name())

    def _sync_folder(self) -> None:
        """Have the disk take the names of the files."""
        for folder in (self.path, self.path.parent) if self._sync_interval else ():
            _sync(folder)

    def _is_full(self, span: int) -> bool:
        return 0 < self._longest_file <= span or 0 < self._largest_file <= self._file.size

    def _file_name(self) -> str:
        return f'{self.path.name}_{len(self._files)}{SUFFIXES[MCAP]}'

    def _open_file(self) -> McapWriter:
        return McapWriter(self.path / self._file_name(), self._codec)

    def _close_file(self) -> None:
        self._file.flush()
        start, end = self._file.span or (time.time_ns(),) * 2
        stored = StoredFile(self._file_name(), sum(self._file.counts.values()), start, end)
        self._file.close(as_text(self._information([stored])))
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
        files = [*self._files, *last]
        return bag_information(MCAP, counts, files, self._custom_data)

    @contextmanager
    def _complaining(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OSError(
                f'bag {str(self.path)!r} cannot be written: {error}; choose another output'
            ) from error


def _sync(path: Path) -> None:
    """Have the disk take what was written to a file, or what a folder holds."""
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
