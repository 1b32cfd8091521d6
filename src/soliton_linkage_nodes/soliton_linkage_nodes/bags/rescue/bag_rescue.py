# SPDX-License-Identifier: Apache-2.0
"""Bags that were not finished or are damaged: what is intact of them, and a new bag of that."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from backports import zstd

from soliton_linkage_nodes.bags.metadata import read_metadata
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.rescue.mcap_rescue import RescuedMcap
from soliton_linkage_nodes.bags.rescue.rescued import RescuedFile, completed
from soliton_linkage_nodes.bags.rescue.sqlite_rescue import RescuedSqlite
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_SUFFIXES = {'.mcap': 'mcap', '.db3': 'sqlite3'}
_ZSTD = b'\x28\xb5\x2f\xfd'
_STEP = 2**20
_SHOW_EVERY = 1000

Show = Callable[[int], None]


@dataclass
class BagReport:
    """What a bag holds, and what is wrong with it."""

    path: Path
    storage: str
    files: list[Path]
    counts: Counter[StoredTopic] = field(default_factory=Counter)
    start: int | None = None
    end: int = 0
    damage: list[str] = field(default_factory=list)
    lost: int = 0
    """Messages that were recorded and cannot be read any more, as far as is known."""
    custom_data: dict[str, str] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Messages that can be read."""
        return sum(self.counts.values())


def check_bag(path: Path, show: Show = lambda done: None) -> BagReport:
    """Read a bag to the last byte; raises ValueError where it is none."""
    return _read(path, _NoWriter(), False, show)


def recover_bag(
    path: Path, output: Path, doubtful: bool = False, show: Show = lambda done: None
) -> tuple[BagReport, Path]:
    """Write what is intact of a bag into a new one; return what was found, and the new bag.

    `doubtful` brings back messages whose checksum is wrong, too. Raises ValueError where nothing
    is to be brought back, and OSError where the new bag cannot be written.
    """
    writer = _LateWriter(output, _storage_of(_files_of(path)))
    report = _read(path, writer, doubtful, show)
    if not report.counts:
        why = '; '.join(report.damage) or 'it is empty'
        raise ValueError(f'bag {str(path)!r} has nothing that could be brought back: {why}')
    custom = {**report.custom_data, 'recovered_from': str(path)}
    if report.damage:
        custom['damage'] = '; '.join(report.damage)
    return report, writer.close(custom)


class _NoWriter:
    """Takes messages and keeps nothing."""

    def begin(self, topic: StoredTopic) -> None:
        """Take a topic."""

    def write(self, topic: StoredTopic, stamp: int, serialized: bytes) -> None:
        """Take a message."""


class _LateWriter(_NoWriter):
    """Writes a bag that is created with its first topic."""

    def __init__(self, name: Path, storage: str) -> None:
        """Create nothing yet."""
        self._name = name
        self._storage = storage
        self._writer: BagWriter | None = None
        self._stored: dict[StoredTopic, StoredTopic] = {}

    def begin(self, topic: StoredTopic) -> None:
        """Begin to store a topic."""
        if self._writer is None:
            self._writer = BagWriter(self._name, self._storage)
        self._stored[topic] = self._writer.add_stored_topic(topic)

    def write(self, topic: StoredTopic, stamp: int, serialized: bytes) -> None:
        """Store a message."""
        if self._writer is not None:
            self._writer.write(self._stored[topic], stamp, serialized)

    def close(self, custom_data: Mapping[str, str]) -> Path:
        """Finish the bag and return its path."""
        if self._writer is None:
            raise ValueError(f'bag {str(self._name)!r} was never begun')
        self._writer.close(custom_data)
        return self._writer.path


def _read(path: Path, writer: _NoWriter, doubtful: bool, show: Show) -> BagReport:
    files = _files_of(path)
    report = BagReport(path, _storage_of(files), files)
    information = read_metadata(path) if path.is_dir() else None
    types = _types_in(information)
    known: dict[tuple[str, str], StoredTopic] = {}
    for file in files:
        with _opened(file, doubtful) as rescued:
            mine: dict[StoredTopic, StoredTopic] = {}
            for topic in rescued.topics:
                named = _named(topic, types)
                key = (named.name, named.type_name)
                if named.type_name and key not in known:
                    known[key] = replace(named, number=len(known) + 1)
                    report.counts[known[key]] = 0
                    writer.begin(known[key])
                if key in known:
                    mine[topic] = known[key]
            _take(report, rescued, mine, writer, show)
            report.custom_data.update(rescued.custom_data)
            _note(report, file, rescued)
    _compare(report, information, path)
    return report


def _take(
    report: BagReport,
    rescued: RescuedFile,
    topics: Mapping[StoredTopic, StoredTopic],
    writer: _NoWriter,
    show: Show,
) -> None:
    nameless = 0
    for topic, stamp, data in rescued.messages():
        mine = topics.get(topic)
        if mine is None:
            nameless += 1
            continue
        serialized = zstd.decompress(data) if data.startswith(_ZSTD) else data
        writer.write(mine, stamp, serialized)
        report.counts[mine] += 1
        report.start = stamp if report.start is None else min(report.start, stamp)
        report.end = max(report.end, stamp)
        if not report.messages % _SHOW_EVERY:
            show(report.messages)
    if nameless:
        rescued.findings.damage.append(f'{nameless} messages are of topics whose types are lost')
        rescued.findings.lost += nameless


def _note(report: BagReport, file: Path, rescued: RescuedFile) -> None:
    report.damage += [f'{file.name}: {damage}' for damage in rescued.findings.damage]
    report.lost += rescued.findings.lost


def _compare(report: BagReport, information: Mapping[str, Any] | None, path: Path) -> None:
    """Compare what was found with what metadata.yaml says."""
    if path.is_file():
        return
    if information is None:
        report.damage.append('metadata.yaml is missing or cannot be read')
        return
    custom = information.get('custom_data')
    if isinstance(custom, dict):
        report.custom_data.update({str(key): str(value) for key, value in custom.items()})
    stated = information.get('message_count')
    if isinstance(stated, int) and stated > report.messages + report.lost:
        missing = stated - report.messages - report.lost
        report.damage.append(f'{missing} more messages are in metadata.yaml than in the files')
        report.lost += missing
    listed = information.get('relative_file_paths')
    for name in listed if isinstance(listed, list) else []:
        if Path(str(name)).name not in {file.name for file in report.files}:
            report.damage.append(f'file {name} is missing')


def _named(topic: StoredTopic, types: Mapping[str, str]) -> StoredTopic:
    """A topic whose type, if it was lost with its definition, is that which metadata.yaml has."""
    if topic.type_name or topic.name not in types:
        return topic
    return completed(
        topic.number, topic.name, types[topic.name], None, topic.digest, topic.profiles
    )


def _types_in(information: Mapping[str, Any] | None) -> dict[str, str]:
    try:
        entries = (information or {})['topics_with_message_count']
        told = [entry['topic_metadata'] for entry in entries]
        return {str(topic['name']): str(topic['type']) for topic in told}
    except (KeyError, TypeError):
        return {}


def _files_of(path: Path) -> list[Path]:
    """Files of a bag in the order in which they were recorded."""
    if not path.exists():
        raise ValueError(f'bag {str(path)!r} does not exist; give the path of a bag directory')
    candidates = [path] if path.is_file() else list(path.iterdir())
    files = [file for file in candidates if file.is_file() and _kind_of(file) in _SUFFIXES]
    if not files:
        raise ValueError(f'bag {str(path)!r} has no .mcap or .db3 file; give a bag directory')
    return sorted(files, key=_place)


def _place(file: Path) -> tuple[int, str]:
    number = re.search(r'_(\d+)\.', file.name)
    return (int(number[1]) if number else 0, file.name)


def _kind_of(file: Path) -> str:
    return Path(file.stem).suffix if file.suffix == '.zstd' else file.suffix


def _storage_of(files: list[Path]) -> str:
    return _SUFFIXES[_kind_of(files[0])]


@contextmanager
def _opened(file: Path, doubtful: bool) -> Iterator[RescuedFile]:
    with TemporaryDirectory(prefix='recover_bag_') as folder:
        plain = file
        if file.suffix == '.zstd':
            plain = Path(folder, file.stem)
            damage = _unpack(file, plain)
        rescued = _read_file(plain, doubtful)
        if file.suffix == '.zstd' and damage:
            rescued.findings.damage.insert(0, damage)
        yield rescued


def _read_file(file: Path, doubtful: bool) -> RescuedFile:
    return RescuedMcap(file, doubtful) if file.suffix == '.mcap' else RescuedSqlite(file)


def _unpack(file: Path, plain: Path) -> str | None:
    """Unpack a file as far as it can be; return what is wrong with it."""
    unpacker = zstd.ZstdDecompressor()
    with file.open('rb') as packed, plain.open('wb') as out:
        try:
            while piece := packed.read(_STEP):
                while piece:
                    unpacker = zstd.ZstdDecompressor() if unpacker.eof else unpacker
                    out.write(unpacker.decompress(piece))
                    piece = unpacker.unused_data if unpacker.eof else b''
        except zstd.ZstdError as error:
            return f'its compression is damaged: {error}'
    return None if unpacker.eof else 'its compression is cut short'
