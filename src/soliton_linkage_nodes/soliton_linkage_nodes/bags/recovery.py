# SPDX-License-Identifier: Apache-2.0
"""Check of bags, and recovery of all intact messages from unfinished or damaged bags."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from soliton_linkage_nodes.bags import guards, metadata
from soliton_linkage_nodes.bags.bag_files import topics_in
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.metadata import MCAP, METADATA_FILE, storage_of
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter, UnfinishedBag
from soliton_linkage_nodes.bags.storages.mcap_recovery import RecoveredMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import RecoveredSqlite
from soliton_linkage_nodes.bags.storages.storage import RecoveredFile
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, completed

_SHOW_EVERY = 1000
"""Number of messages between two calls of the progress function `show` [1]."""

Show = Callable[[int, int], None]
"""Function that shows the progress from the number of read messages and the expected number. The
expected number is 0 if it is unknown."""


def recovered_file(path: Path, storage: str, doubtful: bool, limits: BagLimits) -> RecoveredFile:
    """Open a file for recovery. If `doubtful` is set, wrong checksums of messages are ignored."""
    kind = RecoveredMcap if storage == MCAP else RecoveredSqlite
    return kind(path, doubtful, limits)


@dataclass
class BagReport:
    """Content and damage of a bag.

    `counts` maps the topics to their numbers of messages. `start` and `end` are the first and the
    last receive time [ns]. `notes` describe irregularities that are not damage. `lost` is the
    number of messages that cannot be read. `unverified` is the number of messages without a
    checksum.
    """

    path: Path
    storage: str
    files: list[Path]
    counts: Counter[StoredTopic] = field(default_factory=Counter)
    start: int | None = None
    end: int = 0
    damage: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    distribution: str = ''
    lost: int = 0
    unverified: int = 0
    custom_data: dict[str, str] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Number of readable messages."""
        return sum(self.counts.values())


def check_bag(
    path: Path, show: Show = lambda done, expected: None, limits: BagLimits = DEFAULT_LIMITS
) -> BagReport:
    """Read a whole bag, and return a report. Raises ValueError if the path is not a bag."""
    return _BagScan(path, None, False, show, limits).report


def recover_bag(
    path: Path,
    output: Path,
    doubtful: bool = False,
    show: Show = lambda done, expected: None,
    limits: BagLimits = DEFAULT_LIMITS,
) -> tuple[BagReport, Path]:
    """Write the intact messages of a bag to a new bag, and return a report and the new path.

    If `doubtful` is set, messages with wrong checksums are also recovered. Raises ValueError if
    the bag is damaged and no message is intact. Raises OSError if the new bag cannot be written.
    """
    scan = _BagScan(path, output, doubtful, show, limits)
    report, writer = scan.report, scan.writer
    if report.damage and not report.messages:
        if writer is not None:
            writer.remove_if_empty()
        raise ValueError(
            f'nothing can be recovered from bag {str(path)!r}: {"; ".join(report.damage)}'
        )
    writer = writer or BagWriter(output)
    custom = {**report.custom_data, 'recovered_from': str(path)}
    if report.damage:
        custom['damage'] = '; '.join(report.damage)
        custom['lost_in_damage'] = str(report.lost)
        custom['unverified_messages'] = str(report.unverified)
    writer.close(custom)
    return report, writer.path


class _BagScan:
    """Scan of all files of a bag. It copies the messages to a new bag if `output` is given."""

    def __init__(
        self, path: Path, output: Path | None, doubtful: bool, show: Show, limits: BagLimits
    ) -> None:
        files, rejected = _files_of(path)
        self.report = BagReport(path, storage_of(files[0]) or '', files, damage=rejected)
        self.writer: BagWriter | None = None
        self._output = output
        self._show = show
        self._limits = limits
        self._topics: dict[StoredTopic, StoredTopic] = {}
        self._taken = 0
        information, error = _metadata_of(path)
        types = dict(topics_in(information or {}).keys())
        self._expected = guards.parse_count((information or {}).get('message_count'))
        for file in files:
            with _opened(file, doubtful, limits) as recovered:
                found = recovered.topics.items()
                self._expected = max(self._expected, self._taken + recovered.stated)
                if output is not None:
                    for opcode, body in recovered.records:
                        self._new_bag(output).copy_record(opcode, body)
                known = {key: self._known(_typed(topic, types)) for key, topic in found}
                self._take(recovered, known)
                self.report.custom_data.update(recovered.custom_data)
                self.report.damage += [f'{file.name}: {damage}' for damage in recovered.damage]
                self.report.lost += recovered.lost
                self.report.unverified += recovered.unverified
        _compare(self.report, information)
        self.report.damage += error

    def _new_bag(self, output: Path) -> BagWriter:
        self.writer = self.writer or BagWriter(output)
        return self.writer

    def _known(self, topic: StoredTopic) -> StoredTopic | None:
        key = replace(topic, number=0)
        if not topic.type_is_lost and key not in self._topics:
            self._topics[key] = replace(topic, number=len(self._topics) + 1)
            self.report.counts[self._topics[key]] = 0
            if self._output is not None:
                self._new_bag(self._output).add_stored_topic(self._topics[key])
        return self._topics.get(key)

    def _take(self, recovered: RecoveredFile, topics: Mapping[int, StoredTopic | None]) -> None:
        report, nameless, damaged = self.report, 0, 0
        counts: Counter[int] = Counter()
        for _, (number, sequence, stamp, published, data) in recovered.messages():
            known = topics[number]
            if known is None:
                nameless += 1
                continue
            try:
                plain = guards.decompressed_message(data, self._limits.max_unpacked)
            except ValueError as error:
                damaged, why = damaged + 1, error
                continue
            if self.writer is not None:
                self.writer.write(known, stamp, plain, published, sequence)
            counts[number] += 1
            report.start = stamp if report.start is None else min(report.start, stamp)
            report.end = max(report.end, stamp)
            self._taken += 1
            if not self._taken % _SHOW_EVERY:
                self._show(self._taken, self._expected)
        for number, known in topics.items():
            if known is not None:
                report.counts[known] += counts[number]
        if nameless:
            lost = f'{nameless} messages have topics whose types are lost'
            recovered.report_damage(lost, nameless)
        if damaged:
            recovered.report_damage(f'{damaged} messages cannot be decompressed: {why}', damaged)


def _metadata_of(path: Path) -> tuple[Mapping[str, Any] | None, list[str]]:
    if path.is_file():
        return None, []
    if not (path / METADATA_FILE).exists():
        return None, [f'{METADATA_FILE} is missing or cannot be read']
    try:
        return metadata.load_metadata(path), []
    except (OSError, ValueError) as error:
        return None, [f'{METADATA_FILE} cannot be read: {" ".join(str(error).split())}']


def _compare(report: BagReport, information: Mapping[str, Any] | None) -> None:
    if information is None:
        return
    report.custom_data.update(metadata.custom_data_in(information))
    report.distribution = str(information.get('ros_distro') or '')
    stated = guards.parse_count(information.get('message_count'))
    missing = stated - report.messages - report.lost
    listed = information.get('relative_file_paths')
    held = {file.name for file in report.files}
    names = [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
    absent = [f'file {name} is missing' for name in names if Path(name).name not in held]
    if missing > 0 and not absent and _deleted_older(report, information):
        report.notes.append(f'older splits with {missing} messages were deleted when recording')
    elif missing > 0:
        report.damage.append(f'{METADATA_FILE} lists {missing} more messages than the files')
        report.lost += missing
    report.damage += absent


def _deleted_older(report: BagReport, information: Mapping[str, Any]) -> bool:
    """Return whether metadata.yaml counts messages in older files that the recorder deleted."""
    entries = information.get('files')
    described = [each for each in entries if isinstance(each, dict)] if entries else []
    counts = sum(guards.parse_count(each.get('message_count')) for each in described)
    first = min((_position(file)[0] for file in report.files), default=0)
    return first > 0 and counts == report.messages and len(described) == len(report.files)


def _typed(topic: StoredTopic, types: Mapping[str, str]) -> StoredTopic:
    if not topic.type_is_lost or topic.name not in types:
        return topic
    return completed(replace(topic, type_name=types[topic.name], definition=''))


def _files_of(path: Path) -> tuple[list[Path], list[str]]:
    if complaint := metadata.explain_no_bag(path):
        raise ValueError(complaint)
    folder = path if path.is_dir() else None
    files, rejected = [], []
    for file in sorted(path.iterdir()) if folder else [path]:
        if storage_of(file):
            try:
                guards.regular_file(file, folder)
                files.append(file)
            except (OSError, ValueError) as error:
                rejected.append(f'{file.name}: {error}')
    if not files:
        why = '; '.join(rejected) or f'has {METADATA_FILE}, but no file with messages'
        raise ValueError(f'bag {str(path)!r} {why}; give a bag directory')
    return sorted(files, key=_position), rejected


def _position(file: Path) -> tuple[int, str]:
    number = re.search(r'_(\d+)\.', file.name)
    return (int(number[1]) if number else 0, file.name)


@contextmanager
def _opened(file: Path, doubtful: bool, limits: BagLimits) -> Iterator[RecoveredFile]:
    storage = storage_of(file) or ''
    if file.suffix != guards.PACKED:
        yield recovered_file(file, storage, doubtful, limits)
        return
    with TemporaryDirectory(prefix='recover_bag_') as folder:
        plain, damage = guards.decompress_file(file, folder, limits)
        recovered = recovered_file(plain, storage, doubtful, limits)
        recovered.damage[:0] = [damage] if damage else []
        yield recovered


def unfinished_bag(name: Path) -> Path | None:
    """Return the last of the bags `<name>_0`, `<name>_1`, ... if it is unfinished, else None."""
    number = 0
    while (name.parent / f'{name.name}_{number}').exists():
        number += 1
    last = name.parent / f'{name.name}_{number - 1}'
    finished = not number or not last.is_dir() or (last / METADATA_FILE).exists()
    return None if finished else last


def take_over(bag: Path) -> UnfinishedBag | None:
    """Recover an unfinished MCAP bag so that a writer can continue it.

    Returns None if the bag contains no MCAP file or no intact message.
    """
    try:
        with TemporaryDirectory(prefix=f'.{bag.name}_', dir=bag.parent) as folder:
            report, whole = recover_bag(bag, Path(folder, 'whole'))
            if report.storage != MCAP:
                return None
            (recovered,) = whole.glob(f'*{metadata.SUFFIXES[MCAP]}')
            first = bag / f'{bag.name}_0{metadata.SUFFIXES[MCAP]}'
            recovered.replace(first)
    except ValueError:
        return None
    for file in report.files:
        if file != first:
            file.unlink()
    begun = report.end if report.start is None else report.start
    stored = metadata.StoredFile(first.name, report.messages, begun, report.end)
    return UnfinishedBag(bag, stored, report.counts, report.custom_data)
