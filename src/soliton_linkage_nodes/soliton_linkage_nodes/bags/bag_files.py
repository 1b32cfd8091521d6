# SPDX-License-Identifier: Apache-2.0
"""Reader of bags. A bag may consist of several files."""

from __future__ import annotations

import heapq
import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from operator import itemgetter
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

from soliton_linkage_nodes.bags import guards, metadata
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.storages.mcap_reader import IndexedMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import StoredSqlite
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_File: TypeAlias = IndexedMcap | StoredSqlite
_Received: TypeAlias = tuple[StoredTopic, int, bytes]
_READERS: dict[str, type[_File]] = {'mcap': IndexedMcap, 'sqlite3': StoredSqlite}
_MODES = ('', 'none', 'file', 'message', 'storage')
_MOST_FILES = 10_000
"""Largest accepted number of files of a bag [1]. One file every 10 s gives 8640 files per day."""


class BagReader:
    """Reader of a bag directory or of one file of a bag.

    `topics` lists the topics. MCAP channels with the same topic name, type and encoding are one
    topic. If the files lack the QoS profiles or the type hash of a topic, metadata.yaml supplies
    them. `counts` maps the topics to their numbers of messages. All messages were received in the
    interval [`start_time`, `end_time`) [ns].
    """

    def __init__(self, path: Path, limits: BagLimits) -> None:
        """Open the bag.

        If the bag is damaged or exceeds `limits`, this raises errors of many types, for example
        ValueError, OSError and sqlite3.Error. `open_bag` converts all of them to ValueError.
        """
        self.path = path
        self._limits = limits
        self._files: list[_File] = []
        with ExitStack() as self._stack:
            self._open()
            self._stack = self._stack.pop_all()

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    @property
    def message_count(self) -> int:
        """Total number of messages of all topics."""
        return sum(self.counts.values())

    def messages(
        self, topics: Collection[StoredTopic], start: int | None = None, stop: int | None = None
    ) -> Iterator[_Received]:
        """Yield topic, receive time [ns] and bytes of each message in the interval [start, stop).

        The messages are in the order of their receive times. Raises ValueError if the bag is
        damaged.
        """
        try:
            yield from self._messages({each.key: each for each in topics}, start, stop)
        except Exception as error:  # sqlite3 and the decompressors raise many types of errors
            raise ValueError(
                f'bag {str(self.path)!r} is damaged: {one_line(error).rstrip(".")}. '
                f'Recover the intact messages with: recover_bag {self.path}'
            ) from error

    def _open(self) -> None:
        if self.path.is_dir():
            folder, (information, names, self._mode) = self.path, _checked_metadata(self.path)
        else:
            packed = self.path.suffix == guards.PACKED
            folder, information, names = self.path.parent, {}, [self.path.name]
            self._mode = 'file' if packed else ''
        files = [_file_in(folder, name) for name in names]
        for path in self._decompressed(files) if self._mode == 'file' else files:
            storage = metadata.storage_of(path) or str(information.get('storage_identifier') or '')
            if storage not in _READERS:
                raise ValueError(f'storage {storage!r} is not one of {", ".join(_READERS)}.')
            self._files.append(_READERS[storage](path, self._limits))
            self._stack.callback(self._files[-1].close)
        self.topics, self.counts = self._merged_topics(topics_in(information))
        spans = [each.span for each in self._files if each.span]
        self.start_time = min((start for start, _ in spans), default=0)
        self.end_time = max((end + 1 for _, end in spans), default=0)
        self.custom_data = metadata.custom_data_in(information)

    def _messages(
        self, wanted: Mapping[tuple[str, str, str], StoredTopic], *span: int | None
    ) -> Iterator[_Received]:
        together: list[_File] = []
        last = -1
        spanned = [(*each.span, each) for each in self._files if each.span]
        # Merge files that overlap in time. Read all other files one after another.
        for start, end, file in sorted(spanned, key=itemgetter(0)):
            if start > last:
                yield from self._in_order(together, wanted, *span)
                together = []
            together.append(file)
            last = max(last, end)
        yield from self._in_order(together, wanted, *span)

    def _in_order(
        self,
        files: Sequence[_File],
        wanted: Mapping[tuple[str, str, str], StoredTopic],
        *span: int | None,
    ) -> Iterator[_Received]:
        sources = []
        for file in files:
            known = {n: wanted[each.key] for n, each in file.topics.items() if each.key in wanted}
            sources += [self._of_file(file, known, *span)] if known else []
        yield from sources[0] if len(sources) == 1 else heapq.merge(*sources, key=itemgetter(1))

    def _of_file(
        self, file: _File, topics: Mapping[int, StoredTopic], *span: int | None
    ) -> Iterator[_Received]:
        for number, _, stamp, _, data in file.messages(topics, *span):
            if self._mode == 'message':
                data = guards.decompressed_message(data, self._limits.max_unpacked)
            yield topics[number], stamp, data

    def _decompressed(self, files: list[Path]) -> Iterator[Path]:
        folder = self._stack.enter_context(TemporaryDirectory(prefix='bag_'))
        for file in files:
            plain, damage = guards.decompress_file(file, folder, self._limits)
            if damage:
                raise ValueError(f'{file.name}: {damage}')
            yield plain

    def _merged_topics(
        self, listed: Mapping[tuple[str, str], Mapping[str, Any]]
    ) -> tuple[list[StoredTopic], Counter[StoredTopic]]:
        found: dict[tuple[str, str, str], StoredTopic] = {}
        counts: Counter[tuple[str, str, str]] = Counter()
        for file in self._files:
            for number, each in file.topics.items():
                known = found.get(each.key)
                if known is None:
                    about = listed.get(each.key[:2], {})
                    found[each.key] = _completed(each, len(found) + 1, about)
                elif not known.definition:
                    definition, kind = each.definition, each.definition_format
                    found[each.key] = replace(known, definition=definition, definition_format=kind)
                counts[each.key] += file.counts[number]
        return list(found.values()), Counter({found[key]: n for key, n in counts.items()})


def one_line(error: Exception) -> str:
    """Return the text of an error without line breaks."""
    return ' '.join(str(error).split()) or type(error).__name__


def _file_in(folder: Path, name: str) -> Path:
    path = folder / PurePath(name).name
    if not path.exists():
        raise ValueError(f'its file {path.name!r} is missing.')
    guards.regular_file(path, folder)
    return path


def _completed(topic: StoredTopic, number: int, listed: Mapping[str, Any]) -> StoredTopic:
    profiles = listed.get('offered_qos_profiles', '')
    # Write JSON, because every JSON text is YAML and because writing YAML takes longer.
    text = profiles if isinstance(profiles, str) else json.dumps(profiles, default=str)
    digest = topic.digest or str(listed.get('type_description_hash', ''))
    return replace(topic, number=number, digest=digest, profiles=topic.profiles or text)


def _checked_metadata(path: Path) -> tuple[Mapping[str, Any], list[str], str]:
    try:
        information = metadata.load_metadata(path)
    except ValueError as error:
        raise ValueError(f'{metadata.METADATA_FILE}: {error}') from error
    version, names = information.get('version'), information.get('relative_file_paths')
    if not isinstance(version, int) or not 1 <= version <= metadata.METADATA_VERSION:
        known = f'versions 1 to {metadata.METADATA_VERSION}'
        raise ValueError(f'metadata.yaml has version {version!r}; {known} can be read.')
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError('metadata.yaml lists no files.')
    if len(names) > _MOST_FILES:
        raise ValueError(f'metadata.yaml lists {len(names)} files; the limit is {_MOST_FILES}.')
    mode = str(information.get('compression_mode') or '').lower()
    if mode not in _MODES or (
        mode in _MODES[2:4] and information.get('compression_format') != 'zstd'
    ):
        raise ValueError(f'compression {mode!r} is not zstd; only zstd can be read.')
    return information, list(dict.fromkeys(names)), mode


def topics_in(information: Mapping[str, Any]) -> dict[tuple[str, str], Mapping[str, Any]]:
    """Return the metadata of the topics in metadata.yaml. The keys are topic name and type."""
    entries = information.get('topics_with_message_count')
    topics: dict[tuple[str, str], Mapping[str, Any]] = {}
    for entry in entries if isinstance(entries, list) else []:
        about = entry.get('topic_metadata') if isinstance(entry, dict) else None
        if isinstance(about, dict) and {'name', 'type'} <= about.keys():
            topics[str(about['name']), str(about['type'])] = about
    return topics
