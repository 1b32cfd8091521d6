# SPDX-License-Identifier: Apache-2.0
"""Bags of the suite: written and read through rosbags, on machines with and without rosbag2."""

from __future__ import annotations

import importlib
import sqlite3
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from ament_index_python.packages import get_package_share_directory
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from soliton_linkage.recording import Recording
from soliton_linkage_nodes.conversions import (
    NamedChain,
    chain_from_msg,
    frame_from_msg,
    time_from_msg,
)

STORAGES = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}

_METADATA_VERSION: Final = 9
_MESSAGES_PACKAGE = 'soliton_linkage_msgs'
_UNLIMITED = QosTime(sec=2147483647, nsec=4294967295)


class BagWriter:
    """A bag that is being written, in a directory named `<name>_<first free number>`.

    It may be used from one thread only, as sqlite3 demands. Its methods raise OSError where the
    bag cannot be written.
    """

    def __init__(self, name: Path, storage: str) -> None:
        """Create the directory."""
        self.path = name
        with self._complaining():
            self.path = _first_free(name)
            self._writer = Writer(
                self.path, version=_METADATA_VERSION, storage_plugin=STORAGES[storage]
            )
            self._writer.open()

    def add_topic(self, topic: str, type_name: str, qos: QoSProfile) -> Connection:
        """Begin to store a topic, with the quality of service to replay it with."""
        return self._writer.add_connection(
            topic, type_name, typestore=_typestore(), offered_qos_profiles=[_stored_qos(qos)]
        )

    def write(self, connection: Connection, stamp: int, serialized: bytes) -> None:
        """Store a serialized message that was received at a time since the epoch [ns]."""
        with self._complaining():
            self._writer.write(connection, stamp, serialized)

    @property
    def messages(self) -> int:
        """Messages stored so far."""
        return sum(self._writer.counts.values())

    def close(self, custom_data: dict[str, str]) -> None:
        """Finish the bag, with texts that are kept in its metadata."""
        if not self.messages:
            # rosbags would say that an empty bag begins in the year 2262.
            self._writer.min_timestamp = self._writer.max_timestamp = time.time_ns()
        for key, value in custom_data.items():
            self._writer.set_custom_data(key, value)
        with self._complaining():
            self._writer.close()

    def abort(self) -> None:
        """Give up a bag that could not be written; what is on disk stays, without an index."""
        with suppress(OSError, sqlite3.Error):
            self._writer.abort()

    @contextmanager
    def _complaining(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error, WriterError) as error:
            raise OSError(
                f'bag {str(self.path)!r} cannot be written: {error}; choose another output'
            ) from error


@contextmanager
def open_bag(path: Path) -> Iterator[Reader]:
    """Open a bag to read; raises ValueError where it is missing or cannot be read."""
    if not path.exists():
        raise ValueError(f'bag {str(path)!r} does not exist; give the path of a bag directory')
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # on a damaged file rosbags raises what it happens to stumble on
        raise ValueError(
            f'bag {str(path)!r} cannot be read: {_one_line(error)} '
            'Give a directory with metadata.yaml and an .mcap or .db3 file'
        ) from error
    try:
        yield reader
    finally:
        reader.close()


def read_messages(
    reader: Reader, connections: Collection[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield the serialized messages of some topics with the time of their receipt [ns]."""
    try:
        for connection, stamp, serialized in reader.messages(connections):
            yield connection, stamp, bytes(serialized)
    except Exception as error:
        raise ValueError(f'bag {str(reader.path)!r} is damaged: {_one_line(error)}') from error


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
    message_type = message_class(connection.msgtype)
    for _, stamp, serialized in read_messages(reader, [connection]):
        yield stamp, deserialize_message(serialized, message_type)


def read_chain(reader: Reader) -> NamedChain:
    """Return the last chain that a bag holds."""
    chains = [message for _, message in read_topic(reader, 'chain')]
    if not chains:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic chain')
    return chain_from_msg(chains[-1])


def read_recording(reader: Reader) -> tuple[NamedChain, Recording]:
    """Return the chain of a bag and its joint states; time 0 is the first frame."""
    named = read_chain(reader)
    messages = [message for _, message in read_topic(reader, 'joint_states')]
    if not messages:
        raise ValueError(f'bag {str(reader.path)!r} has no message on the topic joint_states')
    frames = [frame_from_msg(named, message) for message in messages]
    stamps = [time_from_msg(message.header.stamp) for message in messages]
    times = np.array([stamp - stamps[0] for stamp in stamps], dtype=np.float64) * 1e-9
    rates = [frame.rates for frame in frames if frame.rates is not None]
    complete = np.array(rates) if len(rates) == len(frames) else np.empty((0, named.rotors))
    return named, Recording(times, np.array([frame.angles for frame in frames]), complete)


def message_class(type_name: str) -> Any:
    """Return the class of a message type such as 'sensor_msgs/msg/JointState'."""
    package, _, name = type_name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(
            f'message type {type_name!r} is not installed; install its package {package!r}'
        ) from error


def type_name(message_type: Any) -> str:
    """Return the name of a message class, such as 'sensor_msgs/msg/JointState'."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


def latched(connection: Connection) -> bool:
    """Whether a topic of a bag was recorded from a publisher that keeps its last message."""
    profiles = getattr(connection.ext, 'offered_qos_profiles', [])
    return any(profile.durability is QosDurability.TRANSIENT_LOCAL for profile in profiles)


def _first_free(name: Path) -> Path:
    number = 0
    while (path := name.parent / f'{name.name}_{number}').exists():
        number += 1
    return path


def _one_line(error: Exception) -> str:
    return ' '.join(str(error).split()) or type(error).__name__


@lru_cache(maxsize=1)
def _typestore() -> Typestore:
    """Jazzy's message types, and those of the suite."""
    store = get_typestore(Stores.ROS2_JAZZY)
    folder = Path(get_package_share_directory(_MESSAGES_PACKAGE), 'msg')
    types: dict[str, Any] = {}
    for path in sorted(folder.glob('*.msg')):
        name = f'{_MESSAGES_PACKAGE}/msg/{path.stem}'
        types.update(get_types_from_msg(path.read_text(encoding='utf-8'), name))
    store.register(types)
    return store


def _stored_qos(qos: QoSProfile) -> Qos:
    keep_all = qos.history == HistoryPolicy.KEEP_ALL
    reliable = qos.reliability == ReliabilityPolicy.RELIABLE
    transient = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    by_topic = qos.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return Qos(
        history=QosHistory.KEEP_ALL if keep_all else QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if transient else QosDurability.VOLATILE,
        deadline=_UNLIMITED,
        lifespan=_UNLIMITED,
        liveliness=QosLiveliness.MANUAL_BY_TOPIC if by_topic else QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_UNLIMITED,
        avoid_ros_namespace_conventions=False,
    )
