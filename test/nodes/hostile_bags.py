# SPDX-License-Identifier: Apache-2.0
"""Malicious bags of any size; most have an intact part."""

import os
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from zlib import crc32

from backports import zstd
from recordings import START, data_file, run_of, write_bag

from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Opcode, Schema
from soliton_linkage_nodes.messages.conversions import NamedChain

MEBIBYTE = 2**20
_LAUGHS = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{b}: &{b} [{", ".join(["*" + a] * 9)}]\n'
    for a, b in zip('abcdefgh', 'bcdefghi', strict=True)
)


def write_hostile(case: str, name: Path, named: NamedChain, size: int) -> Path:
    """Write a case of a bag whose hostile file has about a size [B], and return its path."""
    return CASES[case](name, named, size)


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


def put_before_the_index(bag: Path, records: bytes) -> Path:
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
    return bag


def packed_file(name: Path, named: NamedChain, size: int) -> Path:
    bag = base(name, named)
    data = data_file(bag)
    (bag / f'{data.name}.zstd').write_bytes(
        zstd.compress(data.read_bytes()[:-37]) + bomb(size * 1000)
    )
    data.unlink()
    return tell(
        bag,
        lambda text: (
            text.replace(data.name, f'{data.name}.zstd')
            .replace("compression_format: ''", 'compression_format: zstd')
            .replace("compression_mode: ''", 'compression_mode: FILE')
        ),
    )


def honest_chunk(name: Path, named: NamedChain, size: int) -> Path:
    return put_before_the_index(base(name, named), chunk(bomb(200 * size), 200 * size))


def lying_chunk(name: Path, named: NamedChain, size: int) -> Path:
    return put_before_the_index(base(name, named), chunk(bomb(200 * size), 1000))


def many_chunks(name: Path, named: NamedChain, size: int) -> Path:
    one = chunk(bomb(32 * MEBIBYTE), 32 * MEBIBYTE)
    return put_before_the_index(base(name, named), one * (size // len(one)))


def packed_message(name: Path, named: NamedChain, size: int) -> Path:
    bag = base(name, named)
    data = bomb(200 * size)
    message = mcap.message_head(2, START, len(data)) + data
    put_before_the_index(bag, chunk(message, len(message), '', crc32(message)))
    return tell(
        bag,
        lambda text: text.replace("compression_format: ''", 'compression_format: zstd').replace(
            "compression_mode: ''", 'compression_mode: MESSAGE'
        ),
    )


def tell(bag: Path, change: Callable[[str], str]) -> Path:
    path = bag / 'metadata.yaml'
    path.write_text(change(path.read_text()))
    return bag


def pipe(where: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, _size: int) -> Path:
        bag = base(name, named)
        path = data_file(bag) if where == 'data' else bag / 'metadata.yaml'
        path.unlink()
        os.mkfifo(path)
        return bag

    return write


def link(where: str, target: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, _size: int) -> Path:
        bag = base(name, named)
        path = data_file(bag) if where == 'data' else bag / 'metadata.yaml'
        held = path.read_bytes()
        path.unlink()
        if target == 'a file elsewhere':
            elsewhere = bag.with_name(f'{bag.name}_elsewhere')
            elsewhere.write_bytes(held)
            path.symlink_to(elsewhere)
        else:
            path.symlink_to(target)
        return bag

    return write


def extra_file(name: Path, named: NamedChain, _size: int) -> Path:
    """A whole bag with a pipe beside, which looks like one of its files."""
    bag = base(name, named)
    os.mkfifo(bag / 'zzz_9.mcap')
    return bag


def laughs_in_metadata(name: Path, named: NamedChain, _size: int) -> Path:
    return tell(base(name, named), lambda text: _LAUGHS + text + '  laughs: *i\n')


def large_metadata(name: Path, named: NamedChain, size: int) -> Path:
    return tell(base(name, named), lambda text: text + '  x: [' + 'x, ' * (size // 6) + 'x]\n')


def deep_metadata(name: Path, named: NamedChain, _size: int) -> Path:
    return tell(base(name, named), lambda text: text + '  x: ' + '[' * 100_000 + ']' * 100_000)


def long_number(name: Path, named: NamedChain, _size: int) -> Path:
    return tell(base(name, named), lambda text: text + '  x: ' + '1:' * 1_000_000 + '1\n')


def counts(value: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, _size: int) -> Path:
        def change(text: str) -> str:
            return text.replace('message_count: 42', f'message_count: {value}').replace(
                'message_count: 40', f'message_count: {value}'
            )

        return tell(base(name, named), change)

    return write


def notes(key: str, value: str) -> Callable[..., Path]:
    """Texts inside an MCAP file."""

    def write(name: Path, named: NamedChain, _size: int) -> Path:
        records = mcap.metadata_record(mcap.CUSTOM_DATA, {key: value})
        bag = put_before_the_index(base(name, named), records)
        return tell(bag, lambda text: text.replace('custom_data: null', 'custom_data:\n    a: b'))

    return write


def laughing_notes(name: Path, named: NamedChain, _size: int) -> Path:
    text = _LAUGHS + 'custom_data:\n  chain: *i\n'
    records = mcap.metadata_record('rosbag2', {'serialized_metadata': text})
    return put_before_the_index(base(name, named), records)


def profiles(text: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, _size: int) -> Path:
        about = {'offered_qos_profiles': text}
        bag = base(name, named)
        content = data_file(bag).read_bytes()
        schemas: dict[int, Schema] = {}
        for _, opcode, body in mcap.records_in(content[8:]):
            mcap.define(opcode, body, schemas, {})
        number = next(n for n, each in schemas.items() if each.name.endswith('JointState'))
        records = mcap.channel_record(Channel(9, number, '/other/states', 'cdr', about))
        return put_before_the_index(bag, records)

    return write


def database(change: Callable[[sqlite3.Connection, int], None]) -> Callable[..., Path]:
    """A sqlite3 bag after a change of its file."""

    def write(name: Path, named: NamedChain, size: int) -> Path:
        bag = base(name, named, 'sqlite3')
        with closing(sqlite3.connect(data_file(bag), isolation_level=None)) as held:
            change(held, size)
        return bag

    return write


def view(query: str) -> Callable[..., Path]:
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


def page_size(value: bytes) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, _size: int) -> Path:
        bag = base(name, named, 'sqlite3')
        data = data_file(bag)
        content = bytearray(data.read_bytes())
        content[16:18] = value
        data.write_bytes(content)
        return bag

    return write


def channels(same: bool) -> Callable[..., Path]:
    """Many channels with definitions of their own, or one channel repeated many times."""

    def write(name: Path, named: NamedChain, size: int) -> Path:
        def records() -> Iterator[bytes]:
            for n in range(size // 200):
                number = 7 if same else 10 + n % 65_000
                yield mcap.schema_record(
                    Schema(number, f'strange_msgs/msg/T{number}', 'ros2msg', b'int8 x\n' * 4)
                )
                yield mcap.channel_record(Channel(number, number, f'/t{number}', 'cdr', {}))
                yield mcap.message_head(number, START, 4) + b'\x00\x01\x00\x00'

        content = b''.join(records())
        return put_before_the_index(
            base(name, named), chunk(content, len(content), '', crc32(content))
        )

    return write


def repeated_definitions(name: Path, named: NamedChain, size: int) -> Path:
    text = b'float64 x\n' * 1000
    one = mcap.schema_record(Schema(77, 'strange_msgs/msg/T', 'ros2msg', text))
    one += mcap.channel_record(Channel(77, 77, '/t', 'cdr', {}))
    return put_before_the_index(base(name, named), one * (size // len(one)))


def zeros(storage: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, size: int) -> Path:
        bag = base(name, named, storage)
        with data_file(bag).open('ab') as file:
            file.write(bytes(size))
        return bag

    return write


def nothing_but_zeros(storage: str) -> Callable[..., Path]:
    def write(name: Path, named: NamedChain, size: int) -> Path:
        bag = base(name, named, storage)
        data_file(bag).write_bytes(bytes(size))
        return bag

    return write


def zeros_in_the_middle(name: Path, named: NamedChain, size: int) -> Path:
    return put_before_the_index(base(name, named), bytes(size))


def heads_in_noise(name: Path, named: NamedChain, size: int) -> Path:
    """Return bytes that look like the header of a long record at every offset."""
    return put_before_the_index(base(name, named), b'\x07' + b'\x01\x00\x00\x00' * (size // 4))


_ENDLESS = (
    'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    "SELECT i, 2, 1700000000000000000 + i, x'00010000' FROM n"
)
_SPINNING = (
    'WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) '
    "SELECT i, 2, 17, x'00' FROM n WHERE i < 0"
)
_MANY_LOST = '{"/joint_states": Infinity, "/nudge": -1e400, "/chain": -5}'
CASES: dict[str, Callable[..., Path]] = {
    'zstd bomb: file': packed_file,
    'zstd bomb: honest chunk': honest_chunk,
    'zstd bomb: lying chunk': lying_chunk,
    'zstd bomb: many chunks': many_chunks,
    'zstd bomb: message': packed_message,
    'pipe as data': pipe('data'),
    'pipe as metadata': pipe('metadata'),
    'pipe beside': extra_file,
    'link to a device as data': link('data', '/dev/zero'),
    'link to a device as metadata': link('metadata', '/dev/zero'),
    'link out of the bag as data': link('data', 'a file elsewhere'),
    'link out of the bag as metadata': link('metadata', 'a file elsewhere'),
    'laughs in metadata': laughs_in_metadata,
    'laughs in notes': laughing_notes,
    'large metadata': large_metadata,
    'deep metadata': deep_metadata,
    'long number in metadata': long_number,
    'deep json in notes': notes('lost_messages', '[' * 100_000),
    'infinite counts in notes': notes('lost_messages', _MANY_LOST),
    'strange counts in notes': notes('lost_messages', '{"a": [1], "b": "x", "c": null}'),
    'strange loss in notes': notes('lost_in_damage', 'many'),
    'infinite counts': counts('.inf'),
    'profiles of python': profiles('!!python/object/apply:os.system ["true"]'),
    'profiles of laughs': profiles(_LAUGHS),
    'profiles of another form': profiles('[1, {history: [2]}, x]'),
    'view without end': view(_ENDLESS),
    'view that spins': view(_SPINNING),
    'generated gigabytes': database(generated),
    'zeroblobs': database(zero_blobs),
    'values of other types': database(strange_values),
    'values that are null': database(nulls),
    'many topics': database(many_topics),
    'page size of 65536': page_size(b'\x00\x01'),
    'page size of 4095': page_size(b'\x0f\xff'),
    'many channels': channels(same=False),
    'one channel many times': channels(same=True),
    'repeated definitions': repeated_definitions,
    'zeros at the end: mcap': zeros('mcap'),
    'zeros at the end: sqlite3': zeros('sqlite3'),
    'zeros in the middle': zeros_in_the_middle,
    'nothing but zeros: mcap': nothing_but_zeros('mcap'),
    'nothing but zeros: sqlite3': nothing_but_zeros('sqlite3'),
    'heads of records in noise': heads_in_noise,
}
