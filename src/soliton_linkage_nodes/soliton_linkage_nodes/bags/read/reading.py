# SPDX-License-Identifier: Apache-2.0
"""Bags are read through rosbags, on machines with and without rosbag2."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rclpy.serialization import deserialize_message
from rosbags.interfaces import Connection, MessageDefinitionFormat, QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.metadata import METADATA_FILE, SUFFIXES, storage_of
from soliton_linkage_nodes.bags.read.bag_folder import READERS, BagFolder
from soliton_linkage_nodes.bags.storages.storage import LimitedReader
from soliton_linkage_nodes.bags.stored_topic import type_definition

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol


class _AnyBag(Reader):
    """A bag folder or a file of a bag, read within limits."""

    STORAGE_PLUGINS: Mapping[str, type[ReaderProtocol]] = {
        'dir': BagFolder,
        **{SUFFIXES[name]: reader for name, reader in READERS.items()},
    }


@contextmanager
def open_bag(path: Path, limits: BagLimits = DEFAULT_LIMITS) -> Iterator[Reader]:
    """Open a bag to read; raises ValueError where it is missing or cannot be read."""
    if not path.exists():
        raise ValueError(f'bag {str(path)!r} does not exist; give the path of a bag directory')
    unfinished = path.is_dir() and not (path / METADATA_FILE).exists()
    if unfinished and any(map(storage_of, path.iterdir())):
        raise ValueError(
            f'bag {str(path)!r} cannot be read: it has no {METADATA_FILE}; its recorder still '
            f'runs, or was killed, and then recover_bag {path} makes a whole bag of it'
        )
    try:
        reader = _AnyBag(path)
        cast('LimitedReader', reader.storage).limits = limits
        reader.open()
    except Exception as error:  # on a damaged file rosbags raises what it happens to stumble on
        raise ValueError(
            f'bag {str(path)!r} cannot be read: {_one_line(error).rstrip(".")}. '
            f'Give a directory with metadata.yaml and an {" or ".join(SUFFIXES.values())} file, '
            f'or, where it is damaged, try recover_bag {path}'
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
    """Yield the serialized messages of some topics with the time of their receipt [ns].

    Only those that were received at `start` or later, and before `stop`, where these are given.
    """
    try:
        for connection, stamp, serialized in reader.messages(connections, start, stop):
            yield connection, stamp, bytes(serialized)
    except Exception as error:
        raise ValueError(
            f'bag {str(reader.path)!r} is damaged: {_one_line(error).rstrip(".")}. '
            f'recover_bag {reader.path} brings back what is intact'
        ) from error


def last_before(reader: Reader, connection: Connection, stop: int) -> tuple[int, bytes] | None:
    """Return the last message of a topic that was received before an instant [ns], and when."""
    last = None
    for _, stamp, serialized in read_messages(reader, [connection], None, stop):
        last = stamp, serialized
    return last


def find_topic(reader: Reader, name: str) -> Connection:
    """Return the topic of a bag with a full name, or the one that ends in it, in any namespace.

    Raises ValueError where there is none, or more than one.
    """
    wanted = name.rpartition('/')[2]
    found = [c for c in reader.connections if c.topic == name] or [
        c for c in reader.connections if c.topic.rpartition('/')[2] == wanted
    ]
    if not found:
        held = ', '.join(sorted(c.topic for c in reader.connections)) or 'nothing'
        raise ValueError(
            f'bag {str(reader.path)!r} has no topic {wanted!r}, it holds {held}; '
            'record it with bag_recorder'
        )
    if len(found) > 1:
        names = ', '.join(sorted(c.topic for c in found))
        raise ValueError(
            f'bag {str(reader.path)!r} has {len(found)} topics {wanted!r}: {names}; '
            'give the full name of one'
        )
    return found[0]


def read_topic(reader: Reader, name: str) -> Iterator[tuple[int, Any]]:
    """Yield the messages of a topic with the time at which they were received [ns]."""
    connection = find_topic(reader, name)
    decode = decoder(connection)
    for _, stamp, serialized in read_messages(reader, [connection]):
        yield stamp, decode(serialized)


def decoder(connection: Connection) -> Callable[[bytes], Any]:
    """Return what makes messages of the installed type of a topic's serialized ones.

    Those that were recorded with another definition of the type are filled by name. It raises
    ValueError for a message that is damaged, and at once where the type is not installed.
    """
    message_type = message_class(connection.msgtype)
    if is_older(connection):
        return OlderMessages(connection, message_type).read

    def decode(serialized: bytes) -> Any:
        try:
            return deserialize_message(serialized, message_type)
        except Exception as error:  # rclpy's own, which has no public name
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
    """Whether a package has messages, found without it being run: its name is a stranger's."""
    if package in sys.modules:
        return True
    found = PathFinder.find_spec(package) if package.isidentifier() else None
    folders = (found.submodule_search_locations or []) if found else []
    return any(Path(folder, 'msg', '__init__.py').is_file() for folder in folders)


def type_name(message_type: Any) -> str:
    """Return the name of a message class, such as 'sensor_msgs/msg/JointState'."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


def latched(connection: Connection) -> bool:
    """Whether a topic of a bag was recorded from a publisher that keeps its last messages."""
    return latched_depth(connection) > 0


def latched_depth(connection: Connection) -> int:
    """How many last messages the publisher of a topic of a bag kept for late joiners."""
    profiles = getattr(connection.ext, 'offered_qos_profiles', [])
    kept = [p.depth for p in profiles if p.durability is QosDurability.TRANSIENT_LOCAL]
    return max(1, *kept) if kept else 0


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__


_LONGER, _MARGIN = 4, 4096
"""Times the length of the installed definition, and characters more, that a recorded one may
have: parsing takes a second for 40,000."""
_LONGEST_REASON = 200
"""Characters of what a parser says, which may repeat all that it was given."""


def is_older(connection: Connection) -> bool:
    """Whether a topic was recorded with another definition of its type than the installed one."""
    told = connection.digest and connection.msgdef.format is MessageDefinitionFormat.MSG
    if not told:
        return False
    try:
        return type_definition(connection.msgtype)[1] != connection.digest
    except ValueError:
        return False


class OlderMessages:
    """Reads messages by the definition that is in their bag, and fills installed ones by name.

    Fields that the recorded definition did not have keep their default.
    """

    def __init__(self, connection: Connection, message_type: Any) -> None:
        """Learn the recorded definition; ValueError where it is none."""
        self._name = connection.msgtype
        self._type = message_type
        self._store = get_typestore(Stores.EMPTY)
        text = connection.msgdef.data
        try:
            installed, _ = type_definition(self._name)
            longest = _LONGER * len(installed) + _MARGIN
            if len(text) > longest:
                raise ValueError(f'it has {len(text)} characters, more than {longest}')
            self._store.register(get_types_from_msg(text, self._name))
        except Exception as error:  # whatever a parser stumbles on
            raise ValueError(
                f'the definition that {connection.topic} was recorded with is none of '
                f'{self._name!r}: {" ".join(str(error).split())[:_LONGEST_REASON]}'
            ) from error

    def read(self, serialized: bytes) -> Any:
        """Message of the installed type; ValueError where it does not fit its definition."""
        try:
            recorded = self._store.deserialize_cdr(serialized, self._name)
            return _filled(self._type, recorded)
        except Exception as error:  # whatever a decoder stumbles on
            raise ValueError(
                f'a message of type {self._name!r} does not fit the definition that was recorded '
                f'with it: {" ".join(str(error).split())[:_LONGEST_REASON]}'
            ) from error


def _filled(message_type: Any, recorded: Any) -> Any:
    message = message_type()
    kinds = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
    for name, kind in kinds:
        if hasattr(recorded, name):
            setattr(message, name, _value(kind, getattr(recorded, name)))
    return message


def _value(kind: Any, recorded: Any) -> Any:
    element = getattr(kind, 'value_type', None)
    if element is not None and hasattr(element, 'namespaces'):
        return [_filled(_class_of(element), one) for one in recorded]
    if hasattr(kind, 'namespaces'):
        return _filled(_class_of(kind), recorded)
    return recorded.tolist() if hasattr(recorded, 'tolist') else recorded


def _class_of(kind: Any) -> Any:
    return getattr(importlib.import_module('.'.join(kind.namespaces)), kind.name)
