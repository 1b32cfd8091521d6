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

from soliton_linkage_nodes.bags.guards import (
    DEFAULT_LIMITS,
    PACKED,
    BagLimits,
    count_in,
    open_file,
    regular_file,
    unpack_file,
    unpacked_message,
)
from soliton_linkage_nodes.bags.metadata import (
    MCAP,
    METADATA_FILE,
    SUFFIXES,
    StoredFile,
    custom_data_in,
    load_metadata,
    storage_of,
)
from soliton_linkage_nodes.bags.record.bag_writer import BagBegun, BagWriter
from soliton_linkage_nodes.bags.storages.mcap_rescue import RescuedMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import RescuedSqlite
from soliton_linkage_nodes.bags.storages.storage import RescuedFile
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, completed

_SHOW_EVERY = 1000
"""Messages from one call of `show` to the next, which costs as much as reading a few."""

Show = Callable[[int], None]


def rescued_file(path: Path, storage: str, doubtful: bool, limits: BagLimits) -> RescuedFile:
    """Read as much as possible of a file; `doubtful` keeps messages with a wrong checksum."""
    kind = RescuedMcap if storage == MCAP else RescuedSqlite
    return kind(path, doubtful, limits)


@dataclass
class BagReport:
    """What a bag holds, and what is wrong with it.

    `counts` holds the messages of each topic, `start` and `end` the stamps of the first and the
    last [ns], `damage` a line for each wound. `lost` counts messages that were recorded and
    cannot be read any more, as far as is known, `unverified` those that can and have no checksum.
    """

    path: Path
    storage: str
    files: list[Path]
    counts: Counter[StoredTopic] = field(default_factory=Counter)
    start: int | None = None
    end: int = 0
    damage: list[str] = field(default_factory=list)
    lost: int = 0
    unverified: int = 0
    custom_data: dict[str, str] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Messages that can be read."""
        return sum(self.counts.values())


def check_bag(
    path: Path, show: Show = lambda done: None, limits: BagLimits = DEFAULT_LIMITS
) -> BagReport:
    """Read a bag to the last byte; raises ValueError where it is none."""
    return _Reading(path, None, False, show, limits).report


def recover_bag(
    path: Path,
    output: Path,
    doubtful: bool = False,
    show: Show = lambda done: None,
    limits: BagLimits = DEFAULT_LIMITS,
) -> tuple[BagReport, Path]:
    """Write what is intact of a bag into a new one; return what was found, and the new bag.

    `doubtful` brings back messages whose checksum is wrong, too. What asks for more than the
    limits stays out. Raises ValueError where nothing is to be brought back, and OSError where the
    new bag cannot be written.
    """
    reading = _Reading(path, output, doubtful, show, limits)
    report, writer = reading.report, reading.writer
    if writer is None:
        why = '; '.join(report.damage) or 'it is empty'
        raise ValueError(f'bag {str(path)!r} has nothing that could be brought back: {why}')
    custom = {**report.custom_data, 'recovered_from': str(path)}
    if report.damage:
        custom['damage'] = '; '.join(report.damage)
        custom['lost_in_damage'] = str(report.lost)
        custom['unverified_messages'] = str(report.unverified)
    writer.close(custom)
    return report, writer.path


class _Reading:
    """A bag that was read to the last byte, and written into a new one where there is an output.

    The new bag is begun with the first topic: of nothing there is none.
    """

    def __init__(
        self, path: Path, output: Path | None, doubtful: bool, show: Show, limits: BagLimits
    ) -> None:
        files, refused = _files_of(path)
        self.report = BagReport(path, _storage_of(files[0]), files, damage=refused)
        self.writer: BagWriter | None = None
        self._output = output
        self._show = show
        self._limits = limits
        self._topics: dict[tuple[str, str], StoredTopic] = {}
        self._taken = 0
        information, complaint = _told_by(path)
        types = _types_in(information)
        for file in files:
            with _opened(file, doubtful, limits) as rescued:
                told = rescued.topics.values()
                self._take(rescued, {topic: self._known(_named(topic, types)) for topic in told})
                self.report.custom_data.update(rescued.custom_data)
                self.report.damage += [f'{file.name}: {damage}' for damage in rescued.damage]
                self.report.lost += rescued.lost
                self.report.unverified += rescued.unverified
        _compare(self.report, information)
        self.report.damage += complaint

    def _known(self, topic: StoredTopic) -> StoredTopic | None:
        """The topic as it is in all files; None where its type is lost."""
        key = (topic.name, topic.type_name)
        if topic.type_name and key not in self._topics:
            self._topics[key] = replace(topic, number=len(self._topics) + 1)
            self.report.counts[self._topics[key]] = 0
            if self._output is not None:
                self.writer = self.writer or BagWriter(self._output)
                self.writer.add_stored_topic(self._topics[key])
        return self._topics.get(key)

    def _take(
        self, rescued: RescuedFile, topics: Mapping[StoredTopic, StoredTopic | None]
    ) -> None:
        report, nameless, damaged = self.report, 0, 0
        for topic, stamp, data in rescued.messages():
            known = topics[topic]
            if known is None:
                nameless += 1
                continue
            try:
                plain = unpacked_message(data, self._limits.most_unpacked)
            except ValueError as error:
                damaged, why = damaged + 1, error
                continue
            if self.writer is not None:
                self.writer.write(known, stamp, plain)
            report.counts[known] += 1
            report.start = stamp if report.start is None else min(report.start, stamp)
            report.end = max(report.end, stamp)
            self._taken += 1
            if not self._taken % _SHOW_EVERY:
                self._show(self._taken)
        if nameless:
            rescued.complain(f'{nameless} messages are of topics whose types are lost', nameless)
        if damaged:
            rescued.complain(f'{damaged} messages cannot be unpacked: {why}', damaged)


def _told_by(path: Path) -> tuple[Mapping[str, Any] | None, list[str]]:
    """What metadata.yaml of a bag says, and what is wrong with it."""
    if path.is_file():
        return None, []
    if not (path / METADATA_FILE).exists():
        return None, [f'{METADATA_FILE} is missing or cannot be read']
    try:
        return load_metadata(path), []
    except (OSError, ValueError) as error:
        return None, [f'{METADATA_FILE} cannot be read: {" ".join(str(error).split())}']


def _compare(report: BagReport, information: Mapping[str, Any] | None) -> None:
    """Compare what was found with what metadata.yaml says."""
    if information is None:
        return
    report.custom_data.update(custom_data_in(information))
    stated = count_in(information.get('message_count'))
    if stated > report.messages + report.lost:
        missing = stated - report.messages - report.lost
        report.damage.append(f'{missing} more messages are in metadata.yaml than in the files')
        report.lost += missing
    listed = information.get('relative_file_paths')
    held = {file.name for file in report.files}
    for name in listed if isinstance(listed, list) else []:
        if isinstance(name, str) and Path(name).name not in held:
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


def _files_of(path: Path) -> tuple[list[Path], list[str]]:
    """Files of a bag in the order in which they were recorded, and why others are left out."""
    if not path.exists():
        raise ValueError(f'bag {str(path)!r} does not exist; give the path of a bag directory')
    folder = path if path.is_dir() else None
    candidates = sorted(path.iterdir()) if folder else [path]
    files, refused = [], []
    for file in candidates:
        if storage_of(_plain(file)):
            try:
                regular_file(file, folder)
                files.append(file)
            except (OSError, ValueError) as error:
                refused.append(f'{file.name}: {error}')
    if not files:
        why = '; '.join(refused) or f'has no {" or ".join(SUFFIXES.values())} file'
        raise ValueError(f'bag {str(path)!r} {why}; give a bag directory')
    return sorted(files, key=_place), refused


def _place(file: Path) -> tuple[int, str]:
    number = re.search(r'_(\d+)\.', file.name)
    return (int(number[1]) if number else 0, file.name)


def _plain(file: Path) -> Path:
    """Path of a file as it was called before it was packed."""
    return Path(file.stem) if file.suffix == PACKED else file


def _storage_of(file: Path) -> str:
    return storage_of(_plain(file)) or ''


@contextmanager
def _opened(file: Path, doubtful: bool, limits: BagLimits) -> Iterator[RescuedFile]:
    storage = _storage_of(file)
    if file.suffix != PACKED:
        yield rescued_file(file, storage, doubtful, limits)
        return
    with TemporaryDirectory(prefix='recover_bag_') as folder:
        plain = Path(folder, file.stem)
        with open_file(file) as packed:
            damage = unpack_file(packed, plain, limits)
        rescued = rescued_file(plain, storage, doubtful, limits)
        rescued.damage[:0] = [damage] if damage else []
        yield rescued


def unfinished_bag(name: Path) -> Path | None:
    """The last of the bags `<name>_0`, `<name>_1`, ..., where its recorder has not finished it."""
    number = 0
    while (name.parent / f'{name.name}_{number}').exists():
        number += 1
    last = name.parent / f'{name.name}_{number - 1}'
    finished = not number or not last.is_dir() or (last / METADATA_FILE).exists()
    return None if finished else last


def take_over(bag: Path) -> BagBegun | None:
    """Put what is intact of a bag into its first file; None where nothing is, or it is no MCAP.

    Raises OSError where that cannot be written; the bag is then as it was.
    """
    try:
        with TemporaryDirectory(prefix=f'.{bag.name}_', dir=bag.parent) as folder:
            report, whole = recover_bag(bag, Path(folder, 'whole'))
            if report.storage != MCAP:
                return None
            (recovered,) = whole.glob(f'*{SUFFIXES[MCAP]}')
            first = bag / f'{bag.name}_0{SUFFIXES[MCAP]}'
            recovered.replace(first)
    except ValueError:
        return None
    for file in report.files:
        if file != first:
            file.unlink()
    begun = report.end if report.start is None else report.start
    stored = StoredFile(first.name, report.messages, begun, report.end)
    return BagBegun(bag, stored, report.counts, report.custom_data)
