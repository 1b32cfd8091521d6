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
from soliton_linkage_nodes.bags.rescue.packed_files import PACKED, unpack_file
from soliton_linkage_nodes.bags.storages.registry import STORAGES, storage_of, suffixes
from soliton_linkage_nodes.bags.storages.storage import RescuedFile
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, completed

_ZSTD = b'\x28\xb5\x2f\xfd'
_SHOW_EVERY = 1000
"""Messages from one call of `show` to the next, which costs as much as reading a few."""

Show = Callable[[int], None]


@dataclass
class BagReport:
    """What a bag holds, and what is wrong with it.

    `counts` holds the messages of each topic, `start` and `end` the stamps of the first and the
    last [ns], `damage` a line for each wound. `lost` counts messages that were recorded and
    cannot be read any more, as far as is known.
    """

    path: Path
    storage: str
    files: list[Path]
    counts: Counter[StoredTopic] = field(default_factory=Counter)
    start: int | None = None
    end: int = 0
    damage: list[str] = field(default_factory=list)
    lost: int = 0
    custom_data: dict[str, str] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Messages that can be read."""
        return sum(self.counts.values())


def check_bag(path: Path, show: Show = lambda done: None) -> BagReport:
    """Read a bag to the last byte; raises ValueError where it is none."""
    return _Reading(path, None, False, show).report


def recover_bag(
    path: Path, output: Path, doubtful: bool = False, show: Show = lambda done: None
) -> tuple[BagReport, Path]:
    """Write what is intact of a bag into a new one; return what was found, and the new bag.

    `doubtful` brings back messages whose checksum is wrong, too. Raises ValueError where nothing
    is to be brought back, and OSError where the new bag cannot be written.
    """
    reading = _Reading(path, output, doubtful, show)
    report, writer = reading.report, reading.writer
    if writer is None:
        why = '; '.join(report.damage) or 'it is empty'
        raise ValueError(f'bag {str(path)!r} has nothing that could be brought back: {why}')
    custom = {**report.custom_data, 'recovered_from': str(path)}
    if report.damage:
        custom['damage'] = '; '.join(report.damage)
        custom['lost_in_damage'] = str(report.lost)
    writer.close(custom)
    return report, writer.path


class _Reading:
    """A bag that was read to the last byte, and written into a new one where there is an output.

    The new bag is begun with the first topic: of nothing there is none.
    """

    def __init__(self, path: Path, output: Path | None, doubtful: bool, show: Show) -> None:
        files = _files_of(path)
        self.report = BagReport(path, _storage_of(files[0]), files)
        self.writer: BagWriter | None = None
        self._output = output
        self._show = show
        self._topics: dict[tuple[str, str], StoredTopic] = {}
        information = read_metadata(path) if path.is_dir() else None
        types = _types_in(information)
        for file in files:
            with _opened(file, doubtful) as rescued:
                told = rescued.topics.values()
                self._take(rescued, {topic: self._known(_named(topic, types)) for topic in told})
                self.report.custom_data.update(rescued.custom_data)
                self.report.damage += [f'{file.name}: {damage}' for damage in rescued.damage]
                self.report.lost += rescued.lost
        _compare(self.report, information, path)

    def _known(self, topic: StoredTopic) -> StoredTopic | None:
        """The topic as it is in all files; None where its type is lost."""
        key = (topic.name, topic.type_name)
        if topic.type_name and key not in self._topics:
            self._topics[key] = replace(topic, number=len(self._topics) + 1)
            self.report.counts[self._topics[key]] = 0
            if self._output is not None:
                self.writer = self.writer or BagWriter(self._output, self.report.storage)
                self.writer.add_stored_topic(self._topics[key])
        return self._topics.get(key)

    def _take(
        self, rescued: RescuedFile, topics: Mapping[StoredTopic, StoredTopic | None]
    ) -> None:
        report, nameless = self.report, 0
        for topic, stamp, data in rescued.messages():
            known = topics[topic]
            if known is None:
                nameless += 1
                continue
            if self.writer is not None:
                packed = data.startswith(_ZSTD)
                self.writer.write(known, stamp, zstd.decompress(data) if packed else data)
            report.counts[known] += 1
            report.start = stamp if report.start is None else min(report.start, stamp)
            report.end = max(report.end, stamp)
            if not report.messages % _SHOW_EVERY:
                self._show(report.messages)
        if nameless:
            rescued.complain(f'{nameless} messages are of topics whose types are lost', nameless)


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
    files = [file for file in candidates if file.is_file() and storage_of(_plain(file))]
    if not files:
        raise ValueError(f'bag {str(path)!r} has no {suffixes()} file; give a bag directory')
    return sorted(files, key=_place)


def _place(file: Path) -> tuple[int, str]:
    number = re.search(r'_(\d+)\.', file.name)
    return (int(number[1]) if number else 0, file.name)


def _plain(file: Path) -> Path:
    """Path of a file as it was called before it was packed."""
    return Path(file.stem) if file.suffix == PACKED else file


def _storage_of(file: Path) -> str:
    return storage_of(_plain(file)) or ''


@contextmanager
def _opened(file: Path, doubtful: bool) -> Iterator[RescuedFile]:
    storage = STORAGES[_storage_of(file)]
    if file.suffix != PACKED:
        yield storage.rescue(file, doubtful)
        return
    with TemporaryDirectory(prefix='recover_bag_') as folder:
        plain = Path(folder, file.stem)
        damage = unpack_file(file, plain)
        rescued = storage.rescue(plain, doubtful)
        rescued.damage[:0] = [damage] if damage else []
        yield rescued
