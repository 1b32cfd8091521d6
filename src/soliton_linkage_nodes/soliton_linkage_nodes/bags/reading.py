# SPDX-License-Identifier: Apache-2.0
"""Reading of bags with rosbags, on machines with and without rosbag2."""

from __future__ import annotations

import importlib
import sys
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from importlib.machinery import PathFinder
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, cast

from rclpy.serialization import deserialize_message
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinitionFormat,
    QosDurability,
)
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_nodes.bags.guards import (
    DEFAULT_LIMITS,
    BagLimits,
    decompress_file,
    decompressed_message,
    open_file,
    regular_file,
)
from soliton_linkage_nodes.bags.metadata import (
    METADATA_FILE,
    METADATA_VERSION,
    SUFFIXES,
    custom_data_in,
    load_metadata,
    storage_of,
)
from soliton_linkage_nodes.bags.storages.mcap_reader import IndexedMcap
from soliton_linkage_nodes.bags.storages.sqlite_files import StoredSqlite
from soliton_linkage_nodes.bags.storages.storage import LimitedReader, parse_profiles, summary_of
from soliton_linkage_nodes.bags.stored_topic import type_definition

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol

_READERS: dict[str, type[IndexedMcap | StoredSqlite]] = {
    'mcap': IndexedMcap,
    'sqlite3': StoredSqlite,
}
_MODES = ('', 'none', 'file', 'message', 'storage')
_MOST_FILES = 10_000
"""Largest number of files of a bag [1]: a day in pieces of ten seconds."""


class BagFolder(LimitedReader):
    """A bag directory: the messages of its files, one file after the other.

    The files define the topics. metadata.yaml supplies the fields that older files lack. Methods
    raise ValueError if the bag is damaged or exceeds the limits.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._mode = ''
        self._readers: list[ReaderProtocol] = []
        self._stack = ExitStack()

    def open(self) -> None:
        """Open all files."""
        information, names, storage, self._mode = _checked_metadata(self._path)
        files = [self._file(name) for name in names]
        for path in self._decompressed(files) if self._mode == 'file' else files:
            reader = _READERS[storage](path)
            reader.limits = self.limits
            reader.open()
            self._stack.callback(reader.close)
            self._readers.append(reader)
        self._merge_topics(_topics_in(information))
        filled = [each.metadata for each in self._readers if each.metadata.message_count]
        span = None
        if filled:
            last = max(each.end_time for each in filled) - 1
            span = min(each.start_time for each in filled), last
        self.metadata = summary_of(
            self.connections,
            span,
            ('zstd', self._mode) if self._mode in ('file', 'message') else (None, None),
            str(information.get('ros_distro') or ''),
            custom_data_in(information) or None,
        )

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield topic, stamp [ns] and bytes for stamps in [start, stop)."""
        wanted = {(each.topic, each.msgtype): each for each in connections}
        for reader in self._readers:
            in_file = [each for each in reader.connections if (each.topic, each.msgtype) in wanted]
            for found, stamp, data in reader.messages(in_file, start, stop) if in_file else ():
                if self._mode == 'message':
                    data = decompressed_message(data, self.limits.max_unpacked)
                yield wanted[found.topic, found.msgtype], stamp, data

    def _file(self, name: str) -> Path:
        path = self._path / PurePath(name).name
        if not path.exists():
            raise ValueError(f'its file {path.name!r} is missing.')
        regular_file(path, self._path)
        return path

    def _decompressed(self, files: list[Path]) -> Iterator[Path]:
        folder = self._stack.enter_context(TemporaryDirectory(prefix='bag_'))
        for file in files:
            plain = Path(folder, file.stem)
            with open_file(file, self._path) as packed:
                damage = decompress_file(packed, plain, self.limits)
            if damage:
                raise ValueError(f'{file.name}: {damage}')
            yield plain

    def _merge_topics(self, listed: Mapping[tuple[str, str], Mapping[str, Any]]) -> None:
        """List each topic once, though several files have it."""
        found: dict[tuple[str, str], Connection] = {}
        for each in (each for reader in self._readers for each in reader.connections):
            key = (each.topic, each.msgtype)
            known = found.get(key)
            if known is None:
                found[key] = _completed(self, len(found) + 1, each, listed.get(key, {}))
                continue
            defined = known.msgdef.format is not MessageDefinitionFormat.NONE
            found[key] = known._replace(
                msgcount=known.msgcount + each.msgcount,
                msgdef=known.msgdef if defined else each.msgdef,
            )
        self.connections.extend(found.values())


def _completed(
    owner: ReaderProtocol, number: int, each: Connection, listed: Mapping[str, Any]
) -> Connection:
    """Return a topic of a file; metadata.yaml supplies fields that the file does not have."""
    own = each.ext
    if not isinstance(own, ConnectionExtRosbag2) or own.serialization_format != 'cdr':
        raise ValueError(f'{each.topic} is not serialized as cdr; only cdr can be read.')
    profiles = listed.get('offered_qos_profiles', [])
    listed_profiles = parse_profiles(profiles if isinstance(profiles, (str, list)) else [])
    extension = ConnectionExtRosbag2('cdr', own.offered_qos_profiles or listed_profiles)
    digest = each.digest or str(listed.get('type_description_hash', ''))
    return each._replace(id=number, digest=digest, ext=extension, owner=owner)


def _checked_metadata(path: Path) -> tuple[Mapping[str, Any], list[str], str, str]:
    """Return metadata.yaml with its file names, storage and compression mode; else ValueError."""
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
    storage = str(information.get('storage_identifier'))
    if storage not in _READERS:
        raise ValueError(f'storage {storage!r} is not one of {", ".join(_READERS)}.')
    mode = str(information.get('compression_mode') or '').lower()
    if mode not in _MODES or (
        mode in _MODES[2:4] and information.get('compression_format') != 'zstd'
    ):
        raise ValueError(f'compression {mode!r} is not zstd; only zstd can be read.')
    return information, list(dict.fromkeys(names)), storage, mode


def _topics_in(information: Mapping[str, Any]) -> dict[tuple[str, str], Mapping[str, Any]]:
    entries = information.get('topics_with_message_count')
    topics: dict[tuple[str, str], Mapping[str, Any]] = {}
    for entry in entries if isinstance(entries, list) else []:
        about = entry.get('topic_metadata') if isinstance(entry, dict) else None
        if isinstance(about, dict):
            topics[str(about.get('name')), str(about.get('type'))] = about
    return topics


class _AnyBag(Reader):
    """A bag directory or one file of a bag, read within limits."""

    STORAGE_PLUGINS: Mapping[str, type[ReaderProtocol]] = {
        'dir': BagFolder,
        **{SUFFIXES[name]: reader for name, reader in _READERS.items()},
    }


@contextmanager
def open_bag(path: Path, limits: BagLimits = DEFAULT_LIMITS) -> Iterator[Reader]:
    """Open a bag for reading; raises ValueError if it is missing or cannot be read."""
    if not path.exists():
        raise ValueError(f'bag {str(path)!r} does not exist; give the path of a bag directory')
    unfinished = path.is_dir() and not (path / METADATA_FILE).exists()
    if unfinished and any(map(storage_of, path.iterdir())):
        raise ValueError(
            f'bag {str(path)!r} cannot be read: it has no {METADATA_FILE}. Either its recorder '
            f'still runs, or it was killed; then recover it with: recover_bag {path}'
        )
    try:
        reader = _AnyBag(path)
        cast('LimitedReader', reader.storage).limits = limits
        reader.open()
    except Exception as error:  # rosbags raises many types of errors for damaged files
        raise ValueError(
            f'bag {str(path)!r} cannot be read: {_one_line(error).rstrip(".")}. '
            f'Give a directory with metadata.yaml and an {" or ".join(SUFFIXES.values())} file; '
            f'if the bag is damaged, try recover_bag {path}'
        ) from error
    try:
        yield reader
    finally:
        reader.close()


def read_messages(
    reader: Reader,
    connections: Collection[Connection],
    start: int | None = None,
    stop: int | None = None,
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield topic, receive time [ns] and serialized message, for receive times in [start, stop).

    Raises ValueError if the bag is damaged.
    """
    try:
        for connection, stamp, serialized in reader.messages(connections, start, stop):
            yield connection, stamp, bytes(serialized)
    except Exception as error:
        raise ValueError(
            f'bag {str(reader.path)!r} is damaged: {_one_line(error).rstrip(".")}. '
            f'Recover the intact messages with: recover_bag {reader.path}'
        ) from error


def latched_before(reader: Reader, connection: Connection, stop: int) -> list[bytes]:
    """Return the messages of a topic that a subscriber receives that starts at an instant [ns]."""
    earlier = read_messages(reader, [connection], None, stop)
    return list(deque((data for _, _, data in earlier), maxlen=latched_depth(connection)))


def find_topic(reader: Reader, name: str) -> Connection:
    """Return the topic with this full name, else the one in any namespace that ends in it.

    Raises ValueError if there is none, or more than one, or if the topic has several types.
    """
    found = types_of_topic(reader, name)
    if len(found) > 1:
        raise ValueError(
            f'bag {str(reader.path)!r} has topic {found[0].topic} with {len(found)} types: '
            f'{", ".join(c.msgtype for c in found)}; only one can be read'
        )
    return found[0]


def types_of_topic(reader: Reader, name: str) -> list[Connection]:
    """Return one topic, found as by `find_topic`, once with each of its types."""
    wanted = name.rpartition('/')[2]
    found = [c for c in reader.connections if c.topic == name] or [
        c for c in reader.connections if c.topic.rpartition('/')[2] == wanted
    ]
    if not found:
        held = ', '.join(sorted(c.topic for c in reader.connections)) or 'no topics'
        raise ValueError(
            f'bag {str(reader.path)!r} has no topic {wanted!r}, it contains {held}; '
            'record it with bag_recorder'
        )
    names = sorted({c.topic for c in found})
    if len(names) > 1:
        raise ValueError(
            f'bag {str(reader.path)!r} has {len(names)} topics {wanted!r}: {", ".join(names)}; '
            'give the full name of one'
        )
    return found


def read_topic(reader: Reader, name: str) -> Iterator[tuple[int, Any]]:
    """Yield receive time [ns] and message of a topic."""
    connection = find_topic(reader, name)
    decode = decoder(connection)
    for _, stamp, serialized in read_messages(reader, [connection]):
        yield stamp, decode(serialized)


def decoder(connection: Connection) -> Callable[[bytes], Any]:
    """Return a function that deserializes messages of a topic to the installed type.

    Messages recorded with another definition of the type are converted field by field, by name.
    Raises ValueError if the type is not installed; the function raises it for damaged messages.
    """
    message_type = message_class(connection.msgtype)
    if is_older(connection):
        return _older_decoder(connection, message_type)

    def decode(serialized: bytes) -> Any:
        try:
            return deserialize_message(serialized, message_type)
        except Exception as error:  # rclpy raises a private type
            raise ValueError(
                f'a message on {connection.topic} is damaged: {_one_line(error)}'
            ) from error

    return decode


def message_class(type_name: str) -> Any:
    """Return the class of a message type such as 'sensor_msgs/msg/JointState'."""
    package, _, name = type_name.partition('/msg/')
    try:
        if not _has_messages(package):
            raise ImportError(package)
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f'message type {type_name!r} is not installed; install its package {package!r}'
        ) from error


def _has_messages(package: str) -> bool:
    """Return whether a package has messages, without running it: a bag may name any package."""
    if package in sys.modules:
        return True
    found = PathFinder.find_spec(package) if package.isidentifier() else None
    folders = (found.submodule_search_locations or []) if found else []
    return any(Path(folder, 'msg', '__init__.py').is_file() for folder in folders)


def type_name(message_type: Any) -> str:
    """Return the name of a message class, such as 'sensor_msgs/msg/JointState'."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


_UNKNOWN_DEPTH = 10
"""Depth of a latched topic whose depth was not recorded [messages]."""


def latched(connection: Connection) -> bool:
    """Return whether a topic was recorded from a transient-local publisher."""
    return latched_depth(connection) > 0


def latched_depth(connection: Connection) -> int:
    """Return how many messages the recorded publisher kept for late subscribers [1].

    A depth of 0 is unknown, because the middleware does not report it. Then 10 is returned, which
    rosbag2 uses.
    """
    profiles = getattr(connection.ext, 'offered_qos_profiles', [])
    kept = [p.depth for p in profiles if p.durability is QosDurability.TRANSIENT_LOCAL]
    return max(depth if depth > 0 else _UNKNOWN_DEPTH for depth in kept) if kept else 0


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__


_LONGER, _MARGIN = 4, 4096
"""Largest length of a recorded definition: this multiple of the installed one, plus this many
characters. Parsing 40,000 characters takes a second."""
_LONGEST_REASON = 200
"""Characters of a parser's message that are quoted; the message may repeat the whole input."""


def is_older(connection: Connection) -> bool:
    """Return whether a topic was recorded with another definition than the installed one."""
    if not connection.digest or connection.msgdef.format is not MessageDefinitionFormat.MSG:
        return False
    try:
        return type_definition(connection.msgtype)[1] != connection.digest
    except ValueError:
        return False


def _older_decoder(connection: Connection, message_type: Any) -> Callable[[bytes], Any]:
    """Return a decoder for the definition in the bag; missing fields keep their default."""
    name, text = connection.msgtype, connection.msgdef.data
    store = get_typestore(Stores.EMPTY)
    try:
        longest = _LONGER * len(type_definition(name)[0]) + _MARGIN
        if len(text) > longest:
            raise ValueError(f'it has {len(text)} characters; the limit is {longest}')
        store.register(get_types_from_msg(text, name))
    except Exception as error:  # the parser raises many types
        raise ValueError(
            f'the recorded definition of {connection.topic} is not a valid {name!r}: '
            f'{_one_line(error)[:_LONGEST_REASON]}'
        ) from error

    def decode(serialized: bytes) -> Any:
        try:
            return _converted(message_type, store.deserialize_cdr(serialized, name))
        except Exception as error:  # the decoder raises many types
            raise ValueError(
                f'a message of type {name!r} does not fit its recorded definition: '
                f'{_one_line(error)[:_LONGEST_REASON]}'
            ) from error

    return decode


def _converted(message_type: Any, recorded: Any) -> Any:
    message = message_type()
    kinds = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
    for name, kind in kinds:
        if hasattr(recorded, name):
            setattr(message, name, _value(kind, getattr(recorded, name)))
    return message


def _value(kind: Any, recorded: Any) -> Any:
    element = getattr(kind, 'value_type', None)
    if element is not None and hasattr(element, 'namespaces'):
        return [_converted(_class_of(element), one) for one in recorded]
    if hasattr(kind, 'namespaces'):
        return _converted(_class_of(kind), recorded)
    return recorded.tolist() if hasattr(recorded, 'tolist') else recorded


def _class_of(kind: Any) -> Any:
    return getattr(importlib.import_module('.'.join(kind.namespaces)), kind.name)
