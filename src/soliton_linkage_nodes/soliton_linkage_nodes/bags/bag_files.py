# SPDX-License-Identifier: Apache-2.0
"""Reader of whole bags, which may consist of several files."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat

from soliton_linkage_nodes.bags.guards import (
    PACKED,
    decompress_file,
    decompressed_message,
    open_file,
    regular_file,
)
from soliton_linkage_nodes.bags.metadata import (
    METADATA_FILE,
    METADATA_VERSION,
    custom_data_in,
    load_metadata,
    storage_of,
)
from soliton_linkage_nodes.bags.storages.mcap_reader import IndexedMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import StoredSqlite
from soliton_linkage_nodes.bags.storages.storage import (
    LimitedReader,
    Messages,
    parse_profiles,
    summary_of,
)
from soliton_linkage_nodes.bags.stored_topic import CDR

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol

_READERS: dict[str, type[IndexedMcap | StoredSqlite]] = {
    'mcap': IndexedMcap,
    'sqlite3': StoredSqlite,
}
_MODES = ('', 'none', 'file', 'message', 'storage')
_MOST_FILES = 10_000
"""Largest accepted number of files of a bag [1]. One file per ten seconds gives 8640 per day."""


class BagFiles(LimitedReader):
    """Reader of a bag directory or of one file of a bag.

    It yields messages in the order of their receive times. MCAP channels with the same topic name,
    type and encoding count as one topic. If the files lack the QoS profiles or the type hash of a
    topic, these are taken from metadata.yaml. The methods raise ValueError if the bag is damaged
    or exceeds the limits.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._mode = ''
        self._readers: list[ReaderProtocol] = []
        self._stack = ExitStack()

    def open(self) -> None:
        """Open all files, and read their topics and the metadata of the bag."""
        if self._path.is_dir():
            information, names, self._mode = _checked_metadata(self._path)
        else:
            packed = self._path.suffix == PACKED
            information, names, self._mode = {}, [self._path.name], 'file' if packed else ''
        folder = self._path if self._path.is_dir() else self._path.parent
        files = [_file_in(folder, name) for name in names]
        for path in self._decompressed(files) if self._mode == 'file' else files:
            storage = storage_of(path) or str(information.get('storage_identifier') or '')
            if storage not in _READERS:
                raise ValueError(f'storage {storage!r} is not one of {", ".join(_READERS)}.')
            reader = _READERS[storage](path)
            reader.limits = self.limits
            reader.open()
            self._stack.callback(reader.close)
            self._readers.append(reader)
        self._merge_topics(topics_in(information))
        filled = [each.metadata for each in self._readers if each.metadata.message_count]
        span = None
        if filled:
            last = max(each.end_time for each in filled) - 1
            span = min(each.start_time for each in filled), last
        zstd = ('zstd', self._mode) if self._mode in ('file', 'message') else (None, None)
        about = str(information.get('ros_distro') or ''), custom_data_in(information) or None
        self.metadata = summary_of(self.connections, span, zstd, *about)

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def messages(
        self, connections: Iterable[Connection], start: int | None = None, stop: int | None = None
    ) -> Messages:
        """Yield the messages of `connections` with receive times in [start, stop) [ns]."""
        wanted = {topic_key(each): each for each in connections}
        together: list[ReaderProtocol] = []
        end = 0
        # Files that overlap in time are read together, all other files one after another.
        for reader in sorted(self._readers, key=lambda each: each.metadata.start_time):
            if together and reader.metadata.start_time >= end:
                yield from self._merged(together, wanted, start, stop)
                together = []
            together.append(reader)
            end = max(end, reader.metadata.end_time)
        yield from self._merged(together, wanted, start, stop)

    def _merged(
        self,
        readers: Sequence[ReaderProtocol],
        wanted: Mapping[tuple[str, str, str], Connection],
        *span: int | None,
    ) -> Messages:
        sources = []
        for reader in readers:
            in_file = [each for each in reader.connections if topic_key(each) in wanted]
            sources += [reader.messages(in_file, *span)] if in_file else []
        in_order = sources[0] if len(sources) == 1 else heapq.merge(*sources, key=itemgetter(1))
        for found, stamp, data in in_order:
            if self._mode == 'message':
                data = decompressed_message(data, self.limits.max_unpacked)
            yield wanted[topic_key(found)], stamp, data

    def _decompressed(self, files: list[Path]) -> Iterator[Path]:
        folder = self._stack.enter_context(TemporaryDirectory(prefix='bag_'))
        for file in files:
            plain = Path(folder, file.stem)
            with open_file(file) as packed:
                damage = decompress_file(packed, plain, self.limits)
            if damage:
                raise ValueError(f'{file.name}: {damage}')
            yield plain

    def _merge_topics(self, listed: Mapping[tuple[str, str], Mapping[str, Any]]) -> None:
        found: dict[tuple[str, str, str], Connection] = {}
        for each in (each for reader in self._readers for each in reader.connections):
            key = topic_key(each)
            known = found.get(key)
            if known is None:
                found[key] = _completed(self, len(found) + 1, each, listed.get(key[:2], {}))
                continue
            defined = known.msgdef.format is not MessageDefinitionFormat.NONE
            found[key] = known._replace(
                msgcount=known.msgcount + each.msgcount,
                msgdef=known.msgdef if defined else each.msgdef,
            )
        self.connections.extend(found.values())


def topic_key(connection: Connection) -> tuple[str, str, str]:
    """Return the name, the type and the encoding of a topic."""
    return connection.topic, connection.msgtype, encoding_of(connection)


def encoding_of(connection: Connection) -> str:
    """Return the encoding of the messages of a topic, such as 'cdr' or 'json'."""
    return str(getattr(connection.ext, 'serialization_format', CDR))


def _file_in(folder: Path, name: str) -> Path:
    path = folder / PurePath(name).name
    if not path.exists():
        raise ValueError(f'its file {path.name!r} is missing.')
    regular_file(path, folder)
    return path


def _completed(
    owner: ReaderProtocol, number: int, each: Connection, listed: Mapping[str, Any]
) -> Connection:
    profiles = listed.get('offered_qos_profiles', [])
    listed_profiles = parse_profiles(profiles if isinstance(profiles, (str, list)) else [])
    own_profiles = getattr(each.ext, 'offered_qos_profiles', [])
    extension = ConnectionExtRosbag2(encoding_of(each), own_profiles or listed_profiles)
    digest = each.digest or str(listed.get('type_description_hash', ''))
    return each._replace(id=number, digest=digest, ext=extension, owner=owner)


def _checked_metadata(path: Path) -> tuple[Mapping[str, Any], list[str], str]:
    try:
        information = load_metadata(path)
    except ValueError as error:
        raise ValueError(f'{METADATA_FILE}: {error}') from error
    version, names = information.get('version'), information.get('relative_file_paths')
    if not isinstance(version, int) or not 1 <= version <= METADATA_VERSION:
        raise ValueError(
            f'metadata.yaml has version {version!r}; versions 1 to {METADATA_VERSION} can be read.'
        )
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
    """Return the metadata of each topic in metadata.yaml, with its name and type as key."""
    entries = information.get('topics_with_message_count')
    topics: dict[tuple[str, str], Mapping[str, Any]] = {}
    for entry in entries if isinstance(entries, list) else []:
        about = entry.get('topic_metadata') if isinstance(entry, dict) else None
        if isinstance(about, dict) and {'name', 'type'} <= about.keys():
            topics[str(about['name']), str(about['type'])] = about
    return topics
