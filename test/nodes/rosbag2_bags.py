# SPDX-License-Identifier: Apache-2.0
"""Bags laid out as `ros2 bag record` lays them out, by other writers than the suite's.

The files are written by the `mcap` package and by plain sqlite3, and metadata.yaml by hand, as
Jazzy's rosbag2 (version 9) and Humble's (version 5) write it.
"""

import json
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from backports import zstd
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

JOINT_STATES = '/arm/joint_states'
_TYPE = 'sensor_msgs/msg/JointState'
_INFINITE = {'sec': 9223372036, 'nsec': 854775807}
_PROFILE = {
    'history': 'unknown',
    'depth': 0,
    'reliability': 'reliable',
    'durability': 'volatile',
    'deadline': _INFINITE,
    'lifespan': _INFINITE,
    'liveliness': 'automatic',
    'liveliness_lease_duration': _INFINITE,
    'avoid_ros_namespace_conventions': False,
}
_OLD_PROFILE = {**_PROFILE, 'history': 3, 'reliability': 1, 'durability': 2, 'liveliness': 1}
Definition = tuple[str, str, str]
"""Name, definition and hash of a type."""
Message = tuple[str, int, bytes]
"""Topic, time [ns] and content."""


@dataclass(frozen=True)
class Layout:
    """How a bag is laid out."""

    storage: str
    version: int = 9
    files: int = 1
    compression_mode: str = ''
    chunk_compression: CompressionType = CompressionType.NONE
    chunk_size: int = 786432
    chunked: bool = True
    checksums: bool = True
    first: int = 0
    """Number of the first file."""


LAYOUTS = {
    'mcap': Layout('mcap'),
    'mcap in zstd chunks': Layout('mcap', chunk_compression=CompressionType.ZSTD, chunk_size=4096),
    'mcap in lz4 chunks': Layout('mcap', chunk_compression=CompressionType.LZ4, chunk_size=4096),
    'mcap without checksums': Layout('mcap', checksums=False),
    'mcap without chunks': Layout('mcap', chunked=False),
    'mcap in files of zstd': Layout('mcap', compression_mode='FILE', files=2),
    'mcap of messages in zstd': Layout('mcap', compression_mode='MESSAGE'),
    'split mcap': Layout('mcap', files=3, chunk_size=4096),
    'mcap of humble': Layout('mcap', version=5),
    'sqlite3': Layout('sqlite3'),
    'split sqlite3': Layout('sqlite3', files=3),
    'sqlite3 in files of zstd': Layout('sqlite3', compression_mode='FILE', files=2),
    'sqlite3 of messages in zstd': Layout('sqlite3', compression_mode='MESSAGE'),
    'sqlite3 of humble': Layout('sqlite3', version=5),
}


def write_rosbag2_bag(
    folder: Path, layout: Layout, frames: Sequence[tuple[int, JointState]]
) -> Path:
    """Write joint states alone and return the path of the bag."""
    messages = [(JOINT_STATES, stamp, serialize_message(frame)) for stamp, frame in frames]
    share = -(-len(messages) // layout.files)
    parts = [messages[begin : begin + share] for begin in range(0, len(messages), share)]
    return write_files(folder, layout, parts, _TYPE)


def write_files(
    folder: Path, layout: Layout, parts: Sequence[Sequence[Message]], type_name: str
) -> Path:
    """Write a bag of one file for each part, whose topics all have one type."""
    folder.mkdir()
    schema = _definition(type_name)
    names = []
    for number, part in enumerate(parts, layout.first):
        path = folder / f'{folder.name}_{number}{".mcap" if layout.storage == "mcap" else ".db3"}'
        packed = part
        if layout.compression_mode == 'MESSAGE':
            packed = [(topic, stamp, zstd.compress(data)) for topic, stamp, data in part]
        (_write_mcap if layout.storage == 'mcap' else _write_sqlite)(path, layout, packed, schema)
        if layout.compression_mode == 'FILE':
            packed_path = path.with_name(f'{path.name}.zstd')
            packed_path.write_bytes(zstd.compress(path.read_bytes()))
            path.unlink()
            path = packed_path
        names.append(path.name)
    (folder / 'metadata.yaml').write_text(yaml.safe_dump(_metadata(layout, names, parts, schema)))
    return folder


def _write_mcap(
    path: Path, layout: Layout, messages: Sequence[Message], schema: Definition
) -> None:
    name, definition, digest = schema
    with path.open('wb') as file:
        writer = Writer(
            file,
            chunk_size=layout.chunk_size,
            compression=layout.chunk_compression,
            use_chunking=layout.chunked,
            enable_crcs=layout.checksums,
        )
        writer.start(profile='ros2', library='libmcap 1.1.0')
        number = writer.register_schema(name, 'ros2msg', definition.encode())
        profiles = yaml.safe_dump(_profiles(layout))
        about = {'offered_qos_profiles': profiles, 'topic_type_hash': digest}
        channels = {
            topic: writer.register_channel(topic, 'cdr', number, about)
            for topic in _topics(messages)
        }
        for topic, stamp, data in messages:
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def _write_sqlite(
    path: Path, layout: Layout, messages: Sequence[Message], schema: Definition
) -> None:
    name, definition, digest = schema
    numbers = {topic: number for number, topic in enumerate(_topics(messages), 1)}
    profiles = yaml.safe_dump(_profiles(layout))
    with sqlite3.connect(path) as database:
        columns, values = '', ''
        if layout.version == 9:
            database.execute('CREATE TABLE schema(schema_version INTEGER, ros_distro TEXT)')
            database.execute("INSERT INTO schema VALUES (4, 'jazzy')")
            database.execute(
                'CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT '
                'NULL, encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, '
                'type_description_hash TEXT NOT NULL)'
            )
            database.execute(
                'INSERT INTO message_definitions VALUES (1, ?, ?, ?, ?)',
                (name, 'ros2msg', definition, digest),
            )
            columns, values = ', type_description_hash TEXT NOT NULL', f", '{digest}'"
        database.execute(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
            f'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL{columns})'
        )
        database.executemany(
            f"INSERT INTO topics VALUES (?, ?, ?, 'cdr', ?{values})",
            [(number, topic, name, profiles) for topic, number in numbers.items()],
        )
        database.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
            'timestamp INTEGER NOT NULL, data BLOB NOT NULL)'
        )
        database.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
        database.executemany(
            'INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)',
            [(numbers[topic], stamp, data) for topic, stamp, data in messages],
        )
    database.close()


def _profiles(layout: Layout) -> list[dict[str, Any]]:
    return json.loads(json.dumps([_PROFILE if layout.version == 9 else _OLD_PROFILE]))


def _definition(name: str) -> Definition:
    store = get_typestore(Stores.ROS2_JAZZY)
    return name, store.generate_msgdef(name, ros_version=2)[0], store.hash_rihs01(name)


def _topics(messages: Sequence[Message]) -> list[str]:
    return list(dict.fromkeys(topic for topic, _, _ in messages))


def _metadata(
    layout: Layout,
    names: Sequence[str],
    parts: Sequence[Sequence[Message]],
    schema: Definition,
) -> dict[str, Any]:
    messages = [message for part in parts for message in part]
    topics = []
    for topic in _topics(messages):
        about: dict[str, Any] = {
            'name': topic,
            'type': schema[0],
            'serialization_format': 'cdr',
            'offered_qos_profiles': _profiles(layout),
            'type_description_hash': schema[2],
        }
        if layout.version < 9:
            about['offered_qos_profiles'] = yaml.safe_dump(_profiles(layout))
            del about['type_description_hash']
        count = sum(name == topic for name, _, _ in messages)
        topics.append({'topic_metadata': about, 'message_count': count})
    information = {
        'version': layout.version,
        'storage_identifier': layout.storage,
        **_times(messages),
        'message_count': len(messages),
        'topics_with_message_count': topics,
        'compression_format': 'zstd' if layout.compression_mode else '',
        'compression_mode': layout.compression_mode,
        'relative_file_paths': list(names),
        'files': [
            {
                'path': name.removesuffix('.zstd'),
                **_times(part),
                'message_count': len(part),
            }
            for name, part in zip(names, parts, strict=True)
        ],
    }
    if layout.version == 9:
        information.update(custom_data=None, ros_distro='jazzy')
    # What stands in it twice is written twice, as rosbag2 does, not once with an alias.
    return json.loads(json.dumps({'rosbag2_bagfile_information': information}))


def _times(messages: Sequence[Message]) -> dict[str, dict[str, int]]:
    stamps = [stamp for _, stamp, _ in messages]
    return {
        'starting_time': {'nanoseconds_since_epoch': min(stamps)},
        'duration': {'nanoseconds': max(stamps) - min(stamps)},
    }
