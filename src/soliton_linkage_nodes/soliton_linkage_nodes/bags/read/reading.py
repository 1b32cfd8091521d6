# SPDX-License-Identifier: Apache-2.0
"""Bags are read through rosbags, on machines with and without rosbag2."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.serialization import deserialize_message
from rosbags.interfaces import Connection, QosDurability
from rosbags.rosbag2 import Reader

from soliton_linkage_nodes.bags.guards.limits import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.metadata import METADATA_FILE
from soliton_linkage_nodes.bags.read.bag_folder import BagFolder
from soliton_linkage_nodes.bags.read.older_messages import OlderMessages, is_older
from soliton_linkage_nodes.bags.storages.connections import LimitedReader
from soliton_linkage_nodes.bags.storages.registry import STORAGES, storage_of, suffixes

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol


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
        reader = _reader(path)
        if isinstance(reader.storage, LimitedReader):
            reader.storage.limits = limits
        reader.open()
    except Exception as error:  # on a damaged file rosbags raises what it happens to stumble on
        raise ValueError(
            f'bag {str(path)!r} cannot be read: {_one_line(error).rstrip(".")}. '
            f'Give a directory with metadata.yaml and an {suffixes()} file, or, where it is '
            f'damaged, try recover_bag {path}'
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


def _reader(path: Path) -> Reader:
    """A reader of a bag of any storage; rosbags by itself knows two."""
    by_suffix = {each.suffix: each.reader for each in STORAGES.values()}
    everything: dict[str, type[ReaderProtocol]] = {'dir': BagFolder, **by_suffix}

    class AnyBag(Reader):
        STORAGE_PLUGINS = everything

    return AnyBag(path)


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__
