# SPDX-License-Identifier: Apache-2.0
"""Reading of bags with the library rosbags, on machines with and without rosbag2."""

from __future__ import annotations

import importlib
import sys
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from rclpy.serialization import deserialize_message
from rosbags.interfaces import Connection, MessageDefinitionFormat, QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_nodes.bags.bag_files import BagFiles, encoding_of
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, PACKED, BagLimits
from soliton_linkage_nodes.bags.metadata import METADATA_FILE, SUFFIXES, explain_no_bag, gaps_in
from soliton_linkage_nodes.bags.stored_topic import CDR, type_definition

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol


class _AnyBag(Reader):
    STORAGE_PLUGINS: Mapping[str, type[ReaderProtocol]] = dict.fromkeys(
        ('dir', PACKED, *SUFFIXES.values()), BagFiles
    )


@contextmanager
def open_bag(path: Path, limits: BagLimits = DEFAULT_LIMITS) -> Iterator[Reader]:
    """Open a bag for reading. Raises ValueError if it does not exist or cannot be read."""
    if complaint := explain_no_bag(path):
        raise ValueError(complaint)
    if path.is_dir() and not (path / METADATA_FILE).exists():
        raise ValueError(
            f'bag {str(path)!r} cannot be read: it has no {METADATA_FILE}. Either its recorder '
            f'still runs, or it was killed; then recover it with: recover_bag {path}'
        )
    try:
        reader = _AnyBag(path)
        cast('BagFiles', reader.storage).limits = limits
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
    """Yield topic, receive time [ns] and bytes of messages; ValueError if the bag is damaged.

    Only messages with receive times in the interval [start, stop) are read.
    """
    # If the list is empty, rosbags would read all topics.
    if not connections:
        return
    try:
        for connection, stamp, serialized in reader.messages(connections, start, stop):
            yield connection, stamp, bytes(serialized)
    except Exception as error:
        raise ValueError(
            f'bag {str(reader.path)!r} is damaged: {_one_line(error).rstrip(".")}. '
            f'Recover the intact messages with: recover_bag {reader.path}'
        ) from error


def gaps_of(reader: Reader) -> list[tuple[int, int]]:
    """Return start and end [ns] of each interval without recording, such as a pause."""
    return gaps_in(cast('BagFiles', reader.storage).metadata.custom or {})


def latched_before(reader: Reader, connection: Connection, stop: int) -> list[bytes]:
    """Return the messages that a late subscriber of a latched topic receives at `stop` [ns]."""
    earlier = read_messages(reader, [connection], None, stop)
    return list(deque((data for _, _, data in earlier), maxlen=latched_depth(connection)))


_RECORD = 'record it with bag_recorder'


def find_topic(reader: Reader, name: str, remedy: str = _RECORD) -> Connection:
    """Return the topic `name` or, if there is none, the topic whose name has the same last part.

    Raises ValueError if no topic or several topics match, or if the topic has several types or is
    not in CDR. The error about a missing topic ends with `remedy`.
    """
    found = types_of_topic(reader, name, remedy)
    bag = f'bag {str(reader.path)!r}'
    decodable = [c for c in found if encoding_of(c) == CDR]
    if not decodable:
        raise ValueError(f'{bag}: {_other_encoding(found[0])}; {remedy}')
    if len(decodable) > 1:
        raise ValueError(
            f'{bag} has topic {found[0].topic} with {len(decodable)} types: '
            f'{", ".join(c.msgtype for c in decodable)}; only one can be read'
        )
    return decodable[0]


def types_of_topic(reader: Reader, name: str, remedy: str = _RECORD) -> list[Connection]:
    """Return an entry for each type and encoding of a topic, which is found as in `find_topic`."""
    wanted = name.rpartition('/')[2]
    found = [c for c in reader.connections if c.topic == name] or [
        c for c in reader.connections if c.topic.rpartition('/')[2] == wanted
    ]
    if not found:
        held = ', '.join(sorted({c.topic for c in reader.connections})) or 'no topics'
        raise ValueError(
            f'bag {str(reader.path)!r} has no topic {wanted!r}, it contains {held}; {remedy}'
        )
    names = sorted({c.topic for c in found})
    if len(names) > 1:
        raise ValueError(
            f'bag {str(reader.path)!r} has {len(names)} topics {wanted!r}: {", ".join(names)}; '
            'give the full name of one'
        )
    return found


def read_topic(reader: Reader, name: str, remedy: str = _RECORD) -> Iterator[tuple[int, Any]]:
    """Yield receive time [ns] and content of the messages of a topic, found as in `find_topic`."""
    connection = find_topic(reader, name, remedy)
    decode = decoder(connection)
    for _, stamp, serialized in read_messages(reader, [connection]):
        yield stamp, decode(serialized)


def decoder(connection: Connection) -> Callable[[bytes], Any]:
    """Return a function that converts serialized messages of a topic to its installed type.

    If the messages were recorded with another definition of the type, fields with equal names are
    copied. Raises ValueError if the type is not installed or the encoding is not CDR. The returned
    function raises ValueError if a message is damaged.
    """
    message_type = class_of(connection)
    if is_older(connection):
        return _older_decoder(connection, message_type)

    def decode(serialized: bytes) -> Any:
        try:
            return deserialize_message(serialized, message_type)
        except Exception as error:  # a private error type of rclpy
            raise ValueError(
                f'a message on {connection.topic} is damaged: {_one_line(error)}'
            ) from error

    return decode


def class_of(connection: Connection) -> Any:
    """Return the message class of a topic; ValueError if it is not installed or not in CDR."""
    if encoding_of(connection) != CDR:
        raise ValueError(_other_encoding(connection))
    return message_class(connection.msgtype)


def _other_encoding(connection: Connection) -> str:
    return f'{connection.topic} has the encoding {encoding_of(connection)!r}; only cdr is decoded'


_KINDS = ('msg', 'srv', 'action')


def message_class(type_name: str) -> Any:
    """Return the class of a type like 'sensor_msgs/msg/JointState'; ValueError if unknown."""
    try:
        package, kind, name = type_name.split('/')
    except ValueError:
        package = kind = name = ''
    if kind not in _KINDS:
        raise ValueError(f'message type {type_name!r} is not PACKAGE/KIND/TYPE as in ROS 2')
    if not _has_types(package, kind):
        raise ValueError(
            f'message type {type_name!r} is not installed; install its package {package!r}'
        )
    try:
        return getattr(importlib.import_module(f'{package}.{kind}'), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f'message type {type_name!r} is not in the installed package {package!r}; '
            'install the version of the package that the bag was recorded with'
        ) from error


def _has_types(package: str, kind: str) -> bool:
    """Search a package for types without importing it: an untrusted bag may name any package."""
    if f'{package}.{kind}' in sys.modules:
        return True
    found = PathFinder.find_spec(package) if package.isidentifier() else None
    folders = (found.submodule_search_locations or []) if found else []
    return any(Path(folder, kind, '__init__.py').is_file() for folder in folders)


def type_name(message_type: Any) -> str:
    """Return the type name of a message class, such as 'sensor_msgs/msg/JointState'."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


_UNKNOWN_DEPTH = 10
"""Queue depth of a latched topic whose depth the bag does not state [messages], as in rosbag2."""


def latched(connection: Connection) -> bool:
    """Return whether a topic was recorded from a transient-local publisher."""
    return latched_depth(connection) > 0


def latched_depth(connection: Connection) -> int:
    """Return how many last messages the publisher kept for late subscribers, 0 if not latched."""
    profiles = getattr(connection.ext, 'offered_qos_profiles', [])
    kept = [p.depth for p in profiles if p.durability is QosDurability.TRANSIENT_LOCAL]
    return max(depth if depth > 0 else _UNKNOWN_DEPTH for depth in kept) if kept else 0


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__


_LONGER, _MARGIN = 4, 4096
"""A recorded definition is rejected if it is longer than `_LONGER` [1] times the installed
definition plus `_MARGIN` [characters]."""
_LONGEST_REASON = 200
"""Error texts are cut to this length [characters], because they may quote the whole input."""


def is_older(connection: Connection) -> bool:
    """Return whether a topic was recorded with another definition than the installed one."""
    if not connection.digest or connection.msgdef.format is not MessageDefinitionFormat.MSG:
        return False
    try:
        return type_definition(connection.msgtype)[1] != connection.digest
    except ValueError:
        return False


def _older_decoder(connection: Connection, message_type: Any) -> Callable[[bytes], Any]:
    name, text = connection.msgtype, connection.msgdef.data
    store = get_typestore(Stores.EMPTY)
    try:
        longest = _LONGER * len(type_definition(name)[0]) + _MARGIN
        if len(text) > longest:
            raise ValueError(f'it has {len(text)} characters; the limit is {longest}')
        store.register(get_types_from_msg(text, name))
    except Exception as error:  # the parser raises many types of errors
        raise ValueError(
            f'the recorded definition of {connection.topic} is not a valid {name!r}: '
            f'{_one_line(error)[:_LONGEST_REASON]}'
        ) from error

    def decode(serialized: bytes) -> Any:
        try:
            return _converted(message_type, store.deserialize_cdr(serialized, name))
        except Exception as error:  # the decoder raises many types of errors
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
