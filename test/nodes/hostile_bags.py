# SPDX-License-Identifier: Apache-2.0
"""Malicious bags of any size; most have an intact part."""

import os
import re
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from zlib import crc32

from backports import zstd
from recordings import START, change_metadata, data_file, run_of, write_bag

from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Opcode, Schema
from soliton_linkage_nodes.messages.conversions import NamedChain

MEBIBYTE = 2**20
Case = Callable[[Path, int], None]
"""Makes a small whole bag hostile, by about a size [B]."""
_LAUGHS = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{b}: &{b} [{", ".join(["*" + a] * 9)}]\n'
    for a, b in zip('abcdefgh', 'bcdefghi', strict=True)
)


def write_hostile(case: str, name: Path, named: NamedChain, size: int) -> Path:
    """Write a case of a bag whose hostile file has about a size [B], and return its path."""
    bag = base(name, named, 'sqlite3' if case in SQLITE_CASES else 'mcap')
    CASES[case](bag, size)
    return bag


def base(name: Path, named: NamedChain, storage: str = 'mcap') -> Path:
    """A small whole bag with a chain, frames and a nudge."""
    return write_bag(name, run_of(named, 40), storage)


def bomb(size: int) -> bytes:
    """Return compressed zeros."""
    packer = zstd.ZstdCompressor()
    piece = bytes(MEBIBYTE)
    packed = [packer.compress(piece) for _ in range(size // MEBIBYTE)]
    return b''.join(packed) + packer.flush()


def chunk(packed: bytes, uncompressed: int, codec: str = 'zstd', crc: int = 0) -> bytes:
    """Return a chunk with an arbitrary stated size."""
    head = mcap.CHUNK_HEADER.pack(START, START, uncompressed, crc) + mcap.text(codec)
    return mcap.record(Opcode.CHUNK, head, struct.pack('<Q', len(packed)), packed)


def put_before_the_index(bag: Path, records: bytes) -> None:
    """Put records behind the last chunk of an MCAP file, whose index is made to know them."""
    data = data_file(bag)
    content = data.read_bytes()
    end = content.index(mcap.record(Opcode.DATA_END, bytes(4)))
    places, definitions = [], b''
    for place, opcode, body in mcap.records_in(records):
        if opcode == Opcode.CHUNK:
            places.append((end + place, len(body) + mcap.RECORD_HEADER.size))
            head = mcap.parse_chunk_head(body)
            inner = b'' if head.codec else body[head.begin :]
            definitions += b''.join(
                mcap.record(Opcode(kind), content)
                for _, kind, content in mcap.records_in(inner)
                if kind in (Opcode.SCHEMA, Opcode.CHANNEL)
            )
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions += mcap.record(Opcode(opcode), body)
    indexes = b''.join(
        mcap.record(
            Opcode.CHUNK_INDEX,
            struct.pack('<QQQQ', START, START, place, length),
            struct.pack('<IQ', 0, 0),
            mcap.text('zstd'),
            struct.pack('<QQ', length, length),
        )
        for place, length in places
    )
    footer = content[-20 - 8 :][:16]
    start, _ = struct.unpack('<QQ', footer)
    summary = content[start : -20 - 9 - 8] + definitions + indexes
    body = content[:end] + records + mcap.record(Opcode.DATA_END, bytes(4))
    fields = struct.pack('<QQI', len(body), 0, 0)
    data.write_bytes(body + summary + mcap.record(Opcode.FOOTER, fields) + mcap.MAGIC)


def add_metadata(text: Callable[[int], str], before: str = '') -> Case:
    """Put text behind the metadata, or around them."""

    def write(bag: Path, size: int) -> None:
        path = bag / 'metadata.yaml'
        path.write_text(f'{before}{path.read_text()}  x: {text(size)}\n')

    return write


def packed_file(bag: Path, size: int) -> None:
    data = data_file(bag)
    packed = data.with_name(f'{data.name}.zstd')
    packed.write_bytes(zstd.compress(data.read_bytes()[:-37]) + bomb(size * 1000))
    data.unlink()
    change_metadata(
        bag,
        compression_format='zstd',
        compression_mode='FILE',
        relative_file_paths=[packed.name],
        files=[{'path': packed.name, 'message_count': 42}],
    )


def honest_chunk(bag: Path, size: int) -> None:
    put_before_the_index(bag, chunk(bomb(200 * size), 200 * size))


def lying_chunk(bag: Path, size: int) -> None:
    put_before_the_index(bag, chunk(bomb(200 * size), 1000))


def many_chunks(bag: Path, size: int) -> None:
    one = chunk(bomb(32 * MEBIBYTE), 32 * MEBIBYTE)
    put_before_the_index(bag, one * (size // len(one)))


def packed_message(bag: Path, size: int) -> None:
    data = bomb(200 * size)
    message = mcap.message_head(2, START, len(data)) + data
    put_before_the_index(bag, chunk(message, len(message), '', crc32(message)))
    change_metadata(bag, compression_format='zstd', compression_mode='MESSAGE')


def replaced(where: str, put: Callable[[Path, bytes], None]) -> Case:
    """Put something else in the place of the data or of the metadata."""

    def write(bag: Path, _size: int) -> None:
        path = data_file(bag) if where == 'data' else bag / 'metadata.yaml'
        content = path.read_bytes()
        path.unlink()
        put(path, content)

    return write


def pipe(path: Path, _content: bytes) -> None:
    os.mkfifo(path)


def link_to_a_device(path: Path, _content: bytes) -> None:
    path.symlink_to('/dev/zero')


def link_out_of_the_bag(path: Path, content: bytes) -> None:
    elsewhere = path.parent.with_name(f'{path.parent.name}_elsewhere')
    elsewhere.write_bytes(content)
    path.symlink_to(elsewhere)


def extra_file(bag: Path, _size: int) -> None:
    """Put a pipe beside, which looks like a file of the bag."""
    os.mkfifo(bag / 'zzz_9.mcap')


def infinite_counts(bag: Path, _size: int) -> None:
    path = bag / 'metadata.yaml'
    counted = re.sub('message_count: 4[02]', 'message_count: .inf', path.read_text())
    path.write_text(counted)


def notes(key: str, value: str) -> Case:
    """Texts inside an MCAP file."""

    def write(bag: Path, _size: int) -> None:
        put_before_the_index(bag, mcap.metadata_record(mcap.CUSTOM_DATA, {key: value}))
        change_metadata(bag, custom_data={'a': 'b'})

    return write


def laughing_notes(bag: Path, _size: int) -> None:
    text = _LAUGHS + 'custom_data:\n  chain: *i\n'
    put_before_the_index(bag, mcap.metadata_record('rosbag2', {'serialized_metadata': text}))


def profiles(text: str) -> Case:
    def write(bag: Path, _size: int) -> None:
        schemas: dict[int, Schema] = {}
        for _, opcode, body in mcap.records_in(data_file(bag).read_bytes()[8:]):
            mcap.define(opcode, body, schemas, {})
        number = next(n for n, each in schemas.items() if each.name.endswith('JointState'))
        about = {'offered_qos_profiles': text}
        channel = Channel(9, number, '/other/states', 'cdr', about)
        put_before_the_index(bag, mcap.channel_record(channel))

    return write


def database(change: Callable[[sqlite3.Connection, int], None]) -> Case:
    """Change the file of a sqlite3 bag."""

    def write(bag: Path, size: int) -> None:
        with closing(sqlite3.connect(data_file(bag), isolation_level=None)) as held:
            change(held, size)

    return write


def view(query: str) -> Case:
    def change(held: sqlite3.Connection, _size: int) -> None:
        held.execute('ALTER TABLE messages RENAME TO kept')
        held.execute(f'CREATE VIEW messages(id, topic_id, timestamp, data) AS {query}')

    return database(change)


def generated(held: sqlite3.Connection, _size: int) -> None:
    held.execute('ALTER TABLE messages RENAME TO kept')
    held.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        'data AS (zeroblob(1000000000)))'
    )
    held.execute('INSERT INTO messages SELECT id, topic_id, timestamp FROM kept')


def zero_blobs(held: sqlite3.Connection, size: int) -> None:
    for number in range(3):
        held.execute(f'INSERT INTO messages VALUES ({900 + number}, 2, {START}, zeroblob({size}))')


def strange_values(held: sqlite3.Connection, _size: int) -> None:
    held.execute(f"INSERT INTO messages VALUES (901, 2, {START}, 'a text')")
    held.execute("INSERT INTO messages VALUES (902, 2, 'no time', x'00')")
    held.execute("INSERT INTO messages VALUES (903, 'no topic', 5, x'00')")
    held.execute(f'INSERT INTO messages VALUES (904, 2, {START}, 1.5)')
    held.execute("INSERT INTO messages VALUES (905, 2, 1e300, x'00')")


def nulls(held: sqlite3.Connection, _size: int) -> None:
    held.execute('ALTER TABLE messages RENAME TO kept')
    held.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data)'
    )
    held.execute('INSERT INTO messages SELECT * FROM kept')
    held.execute('DROP TABLE kept')
    held.execute(f'INSERT INTO messages VALUES (901, 2, {START}, NULL)')
    held.execute("INSERT INTO messages VALUES (902, 2, NULL, x'00')")


def many_topics(held: sqlite3.Connection, size: int) -> None:
    number = size // 200
    held.execute('BEGIN')
    held.executemany(
        "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '', '')",
        ((n, f'/topic_{n}', f'strange_msgs/msg/Type{n}') for n in range(100, 100 + number)),
    )
    held.executemany(
        "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, x'00010000')",
        ((n, START) for n in range(100, 100 + number)),
    )
    held.execute('COMMIT')


def page_size(value: bytes) -> Case:
    def write(bag: Path, _size: int) -> None:
        data = data_file(bag)
        content = bytearray(data.read_bytes())
        content[16:18] = value
        data.write_bytes(content)

    return write


def channels(same: bool) -> Case:
    """Many channels with definitions of their own, or one channel repeated many times."""

    def write(bag: Path, size: int) -> None:
        content = b''
        for n in range(size // 200):
            number = 7 if same else 10 + n % 65_000
            content += mcap.schema_record(
                Schema(number, f'strange_msgs/msg/T{number}', 'ros2msg', b'int8 x\n' * 4)
            )
            content += mcap.channel_record(Channel(number, number, f'/t{number}', 'cdr', {}))
            content += mcap.message_head(number, START, 4) + b'\x00\x01\x00\x00'
        put_before_the_index(bag, chunk(content, len(content), '', crc32(content)))

    return write


def repeated_definitions(bag: Path, size: int) -> None:
    text = b'float64 x\n' * 1000
    one = mcap.schema_record(Schema(77, 'strange_msgs/msg/T', 'ros2msg', text))
    one += mcap.channel_record(Channel(77, 77, '/t', 'cdr', {}))
    put_before_the_index(bag, one * (size // len(one)))


def zeros_at_the_end(bag: Path, size: int) -> None:
    with data_file(bag).open('ab') as file:
        file.write(bytes(size))


def nothing_but_zeros(bag: Path, size: int) -> None:
    data_file(bag).write_bytes(bytes(size))


def zeros_in_the_middle(bag: Path, size: int) -> None:
    put_before_the_index(bag, bytes(size))


def heads_in_noise(bag: Path, size: int) -> None:
    """Put bytes that look like the header of a long record at every offset."""
    put_before_the_index(bag, b'\x07' + b'\x01\x00\x00\x00' * (size // 4))


_ENDLESS = (
    'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    "SELECT i, 2, 1700000000000000000 + i, x'00010000' FROM n"
)
_SPINNING = (
    'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    "SELECT i, 2, 17, x'00' FROM n WHERE i < 0"
)
_MANY_LOST = '{"/joint_states": Infinity, "/nudge": -1e400, "/chain": -5}'
MCAP_CASES: dict[str, Case] = {
    'zstd bomb: file': packed_file,
    'zstd bomb: honest chunk': honest_chunk,
    'zstd bomb: lying chunk': lying_chunk,
    'zstd bomb: many chunks': many_chunks,
    'zstd bomb: message': packed_message,
    'pipe as data': replaced('data', pipe),
    'pipe as metadata': replaced('metadata', pipe),
    'pipe beside': extra_file,
    'link to a device as data': replaced('data', link_to_a_device),
    'link to a device as metadata': replaced('metadata', link_to_a_device),
    'link out of the bag as data': replaced('data', link_out_of_the_bag),
    'link out of the bag as metadata': replaced('metadata', link_out_of_the_bag),
    'laughs in metadata': add_metadata(lambda _: '*i', _LAUGHS),
    'laughs in notes': laughing_notes,
    'large metadata': add_metadata(lambda size: '[' + 'x, ' * (size // 6) + 'x]'),
    'deep metadata': add_metadata(lambda _: '[' * 100_000 + ']' * 100_000),
    'long number in metadata': add_metadata(lambda _: '1:' * 1_000_000 + '1'),
    'deep json in notes': notes('lost_messages', '[' * 100_000),
    'infinite counts in notes': notes('lost_messages', _MANY_LOST),
    'strange counts in notes': notes('lost_messages', '{"a": [1], "b": "x", "c": null}'),
    'strange loss in notes': notes('lost_in_damage', 'many'),
    'infinite counts': infinite_counts,
    'profiles of python': profiles('!!python/object/apply:os.system ["true"]'),
    'profiles of laughs': profiles(_LAUGHS),
    'profiles of another form': profiles('[1, {history: [2]}, x]'),
    'many channels': channels(same=False),
    'one channel many times': channels(same=True),
    'repeated definitions': repeated_definitions,
    'zeros at the end: mcap': zeros_at_the_end,
    'zeros in the middle': zeros_in_the_middle,
    'nothing but zeros: mcap': nothing_but_zeros,
    'heads of records in noise': heads_in_noise,
}
SQLITE_CASES: dict[str, Case] = {
    'view without end': view(_ENDLESS),
    'view that spins': view(_SPINNING),
    'generated gigabytes': database(generated),
    'zeroblobs': database(zero_blobs),
    'values of other types': database(strange_values),
    'values that are null': database(nulls),
    'many topics': database(many_topics),
    'page size of 65536': page_size(b'\x00\x01'),
    'page size of 4095': page_size(b'\x0f\xff'),
    'zeros at the end: sqlite3': zeros_at_the_end,
    'nothing but zeros: sqlite3': nothing_but_zeros,
}
CASES = MCAP_CASES | SQLITE_CASES
