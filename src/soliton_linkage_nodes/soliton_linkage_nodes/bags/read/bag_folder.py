# SPDX-License-Identifier: Apache-2.0
"""A bag as a folder: metadata.yaml says which files it is made of, and how they were packed."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat

from soliton_linkage_nodes.bags.guards import (
    open_file,
    regular_file,
    unpack_file,
    unpacked_message,
)
from soliton_linkage_nodes.bags.metadata import (
    METADATA_FILE,
    METADATA_VERSION,
    custom_data_in,
    load_metadata,
)
from soliton_linkage_nodes.bags.storages.mcap_reader import IndexedMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import StoredSqlite
from soliton_linkage_nodes.bags.storages.storage import LimitedReader, qualities, summary_of

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol

READERS: dict[str, type[IndexedMcap | StoredSqlite]] = {
    'mcap': IndexedMcap,
    'sqlite3': StoredSqlite,
}
_MODES = ('', 'none', 'file', 'message', 'storage')
_MOST_FILES = 10_000
"""Files of a bag: a day in pieces of ten seconds."""


@dataclass(frozen=True)
class _Told:
    """What metadata.yaml says, as far as it is needed."""

    names: list[str]
    storage: str
    mode: str
    topics: dict[tuple[str, str], Mapping[str, Any]]
    distribution: str
    custom: dict[str, str]


class BagFolder(LimitedReader):
    """The messages of the files of a bag, one file after the other.

    Topics are told by the files; metadata.yaml adds what older layouts keep only there. Methods
    raise ValueError where the bag is damaged or asks for more than the limits.
    """

    def __init__(self, path: Path) -> None:
        """Look for nothing yet."""
        super().__init__()
        self._path = path
        self._mode = ''
        self._readers: list[ReaderProtocol] = []
        self._stack = ExitStack()

    def open(self) -> None:
        """Open all files."""
        told = _told_in(self._path)
        self._mode = told.mode
        files = [self._file(name) for name in told.names]
        for path in self._unpacked(files) if told.mode == 'file' else files:
            reader = READERS[told.storage](path)
            reader.limits = self.limits
            reader.open()
            self._stack.callback(reader.close)
            self._readers.append(reader)
        self._merge(told.topics)
        filled = [each.metadata for each in self._readers if each.metadata.message_count]
        span = None
        if filled:
            last = max(each.end_time for each in filled) - 1
            span = min(each.start_time for each in filled), last
        packed = ('zstd', told.mode) if told.mode in ('file', 'message') else (None, None)
        self.metadata = summary_of(
            self.connections, span, packed, told.distribution, told.custom or None
        )

    def close(self) -> None:
        """Let go of the files."""
        self._stack.close()

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield topic, stamp [ns] and bytes, from a stamp on and before another."""
        wanted = {(each.topic, each.msgtype): each for each in connections}
        for reader in self._readers:
            theirs = [each for each in reader.connections if (each.topic, each.msgtype) in wanted]
            if not theirs:
                continue
            for theirs_own, stamp, data in reader.messages(theirs, start, stop):
                if self._mode == 'message':
                    data = unpacked_message(data, self.limits.most_unpacked)
                yield wanted[theirs_own.topic, theirs_own.msgtype], stamp, data

    def _file(self, name: str) -> Path:
        path = self._path / PurePath(name).name
        if not path.exists():
            raise ValueError(f'its file {path.name!r} is missing.')
        regular_file(path, self._path)
        return path

    def _unpacked(self, files: list[Path]) -> Iterator[Path]:
        folder = self._stack.enter_context(TemporaryDirectory(prefix='bag_'))
        for file in files:
            plain = Path(folder, file.stem)
            with open_file(file, self._path) as packed:
                damage = unpack_file(packed, plain, self.limits)
            if damage:
                raise ValueError(f'{file.name}: {damage}')
            yield plain

    def _merge(self, told: Mapping[tuple[str, str], Mapping[str, Any]]) -> None:
        """Make one list of the topics of all files."""
        found: dict[tuple[str, str], Connection] = {}
        for reader in self._readers:
            for each in reader.connections:
                key = (each.topic, each.msgtype)
                known = found.get(key)
                if known is None:
                    found[key] = _completed(self, len(found) + 1, each, told.get(key, {}))
                    continue
                defined = known.msgdef.format is not MessageDefinitionFormat.NONE
                found[key] = known._replace(
                    msgcount=known.msgcount + each.msgcount,
                    msgdef=known.msgdef if defined else each.msgdef,
                )
        self.connections.extend(found.values())


def _completed(
    owner: ReaderProtocol, number: int, each: Connection, told: Mapping[str, Any]
) -> Connection:
    """A topic of a file with what metadata.yaml says of it, where the file says nothing."""
    own = each.ext
    if not isinstance(own, ConnectionExtRosbag2) or own.serialization_format != 'cdr':
        raise ValueError(f'{each.topic} is not serialized as cdr, which alone is read.')
    profiles = told.get('offered_qos_profiles', [])
    told_profiles = qualities(profiles if isinstance(profiles, (str, list)) else [])
    extension = ConnectionExtRosbag2('cdr', own.offered_qos_profiles or told_profiles)
    digest = each.digest or str(told.get('type_description_hash', ''))
    return each._replace(id=number, digest=digest, ext=extension, owner=owner)


def _told_in(path: Path) -> _Told:
    try:
        information = load_metadata(path)
    except ValueError as error:
        raise ValueError(f'{METADATA_FILE}: {error}') from error
    version, names = information.get('version'), information.get('relative_file_paths')
    if not isinstance(version, int) or not 1 <= version <= METADATA_VERSION:
        raise ValueError(
            f'metadata.yaml is of version {version!r}; 1 to {METADATA_VERSION} are read.'
        )
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError('metadata.yaml names no files.')
    if len(names) > _MOST_FILES:
        raise ValueError(f'metadata.yaml names {len(names)} files, more than {_MOST_FILES}.')
    storage = str(information.get('storage_identifier'))
    if storage not in READERS:
        raise ValueError(f'storage {storage!r} is not one of {", ".join(READERS)}.')
    mode = str(information.get('compression_mode') or '').lower()
    if mode not in _MODES or (
        mode in _MODES[2:4] and information.get('compression_format') != 'zstd'
    ):
        raise ValueError(f'compression {mode!r} is not of zstd, which alone is read.')
    return _Told(
        list(dict.fromkeys(names)),
        storage,
        mode,
        _topics_in(information),
        str(information.get('ros_distro') or ''),
        custom_data_in(information),
    )


def _topics_in(information: Mapping[str, Any]) -> dict[tuple[str, str], Mapping[str, Any]]:
    entries = information.get('topics_with_message_count')
    topics: dict[tuple[str, str], Mapping[str, Any]] = {}
    for entry in entries if isinstance(entries, list) else []:
        about = entry.get('topic_metadata') if isinstance(entry, dict) else None
        if isinstance(about, dict):
            topics[str(about.get('name')), str(about.get('type'))] = about
    return topics
