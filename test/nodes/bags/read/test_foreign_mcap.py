# SPDX-License-Identifier: Apache-2.0
"""MCAP files with everything that the format allows are read, checked and copied whole."""

import struct
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import pytest
from mcap.reader import NonSeekingReader

from soliton_linkage_nodes.bags import reading
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag, recovered_file
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Opcode, Schema

EXTRA = b'\x01\xff\xff'
EXAMPLE = Schema(1, 'Example', 'protobuf', b'\x04\xff\x06')
TOPIC = Channel(1, 1, 'example', 'a', {'foo': 'bar'})
DEFINITIONS = [mcap.schema_record(EXAMPLE), mcap.channel_record(TOPIC)]
SCHEMALESS = mcap.channel_record(Channel(7, 0, 'json', 'json', {}))
ATTACHMENT = struct.pack('<QQ', 2, 1) + mcap.text('file') + mcap.text('text/plain')
ATTACHMENT += struct.pack('<Q', 3) + b'abc'
ATTACHMENT += struct.pack('<I', crc32(ATTACHMENT))
DATA_END = mcap.record(Opcode.DATA_END, bytes(4))
Row = tuple[str, int, int, int, bytes]


def message(number: int, stamp: int, channel: int = 1) -> bytes:
    """A message record whose publish time and content differ from those of all others."""
    data = b'message %d' % number
    return mcap.message_head(channel, stamp, len(data), stamp + 5, number) + data


def padded(record: bytes) -> bytes:
    return mcap.record(record[0], record[9:], EXTRA)


def chunk(*records: bytes) -> bytes:
    """A chunk without a stated time span, which readers must not need."""
    return b''.join(mcap.chunk_record(b''.join(records), 0, 100, ''))


def chunk_index(offset: int, size: int) -> bytes:
    fields = struct.pack('<QQQQ', 0, 100, offset, size) + mcap.sized(b'') + bytes(8)
    return mcap.record(Opcode.CHUNK_INDEX, fields, mcap.text(''), bytes(16), EXTRA)


def statistics(count: int) -> bytes:
    head = struct.pack('<QHIIIIQQ', count, 1, 1, 0, 0, 0, 1, 90)
    return mcap.record(Opcode.STATISTICS, head, mcap.sized(struct.pack('<HQ', 1, count)), EXTRA)


@dataclass(frozen=True)
class Case:
    """Records of a file, and its summary if it has one."""

    records: Sequence[bytes]
    summary: Sequence[bytes] | None = None

    @property
    def content(self) -> bytes:
        header = mcap.record(Opcode.HEADER, mcap.text(''), mcap.text(''))
        data = mcap.MAGIC + header + b''.join(self.records) + DATA_END
        start = 0 if self.summary is None else len(data)
        covered = b''.join(self.summary or ()) + mcap.RECORD_HEADER.pack(Opcode.FOOTER, 20)
        covered += struct.pack('<QQ', start, 0)
        return data + covered + struct.pack('<I', crc32(covered)) + mcap.MAGIC


THREE = [message(1, 30), message(2, 10), message(3, 20)]
CHUNK = chunk(*DEFINITIONS, *THREE)
OFFSET = len(mcap.MAGIC) + 9 + 8
PRIVATE, FUTURE = mcap.record(0x85, b'some private data, unlike a message'), mcap.record(0x10)
INDEXED = [*DEFINITIONS, chunk_index(OFFSET, len(CHUNK))]
CASES = {
    'no summary': Case([*DEFINITIONS, *THREE]),
    'extra bytes after the known fields': Case(
        [padded(each) for each in [*DEFINITIONS, CHUNK]] + [message(4, 40)],
        [padded(each) for each in DEFINITIONS],
    ),
    'private and future records': Case(
        [PRIVATE, *DEFINITIONS, FUTURE, THREE[0], PRIVATE, THREE[1], FUTURE, THREE[2]],
        [PRIVATE, *DEFINITIONS],
    ),
    'a channel without a schema': Case([SCHEMALESS, message(1, 10, 7), message(2, 20, 7)]),
    'messages in and outside a chunk': Case(
        [CHUNK, message(4, 15), message(5, 25)], [*INDEXED, statistics(5)]
    ),
    'an index without statistics': Case([CHUNK], INDEXED),
    'a summary without definitions': Case([CHUNK], [INDEXED[-1], statistics(3)]),
    'two channels of one topic': Case(
        [
            *DEFINITIONS,
            mcap.channel_record(Channel(2, 1, 'example', 'a', {'foo': 'other'})),
            *THREE,
            message(4, 15, 2),
        ]
    ),
    'no message': Case([mcap.record(Opcode.ATTACHMENT, ATTACHMENT, EXTRA)], [statistics(0)]),
    'an attachment and metadata': Case(
        [
            mcap.record(Opcode.ATTACHMENT, ATTACHMENT),
            *DEFINITIONS,
            mcap.metadata_record('about', {'robot': 'arm'}),
            *THREE,
        ]
    ),
}


@pytest.fixture(params=CASES)
def path(request, tmp_path):
    file = tmp_path / 'case.mcap'
    file.write_bytes(CASES[request.param].content)
    return file


def held(path: Path) -> list[Row]:
    """All messages, read record by record with the parsers of this module alone."""
    found, names = [], {1: 'example', 2: 'example', 7: 'json'}

    def take(data: bytes) -> None:
        for _, opcode, body in mcap.records_in(data):
            if opcode == Opcode.CHUNK:
                head = mcap.parse_chunk_head(body)
                take(bytes(body[head.begin : head.begin + head.packed]))
            elif opcode == Opcode.MESSAGE:
                channel, sequence, stamp, published = struct.unpack_from('<HIQQ', body)
                row = (names[channel], stamp, published, sequence, bytes(body[22:]))
                found.append(row)

    take(path.read_bytes()[len(mcap.MAGIC) :])
    return sorted(found, key=lambda row: row[1])


def copied(path: Path) -> tuple[list[object], set[bytes]]:
    """Messages with their definitions, read by the `mcap` package, and the other records."""
    with path.open('rb') as file:
        rows: list[object] = [
            (
                schema and replace(schema, id=0),
                replace(channel, id=0, schema_id=0),
                replace(sent, channel_id=0),
            )
            for schema, channel, sent in NonSeekingReader(file).iter_messages()
        ]
    found = mcap.records_in(path.read_bytes()[len(mcap.MAGIC) :])
    kinds = (Opcode.ATTACHMENT, Opcode.METADATA)
    return rows, {bytes(body) for _, kind, body in found if kind in kinds or kind > DATA_END[0]}


def test_it_is_read_checked_and_copied_whole(path, tmp_path):
    expected = [(topic, stamp, data) for topic, stamp, _, _, data in held(path)]
    with reading.open_bag(path) as reader:
        read = reader.messages(reader.topics)
        assert [(each.name, stamp, data) for each, stamp, data in read] == expected
        assert reader.message_count == len(expected)
        topics = [each.name for each in reader.topics]
    assert len(set(topics)) == len(topics)
    report = check_bag(path)
    assert (report.damage, report.lost, report.messages) == ([], 0, len(expected))
    _, new = recover_bag(path, tmp_path / 'new')
    (file,) = new.glob('*.mcap')
    rows, records = copied(file)
    expected_rows, expected_records = copied(path)
    assert rows == expected_rows
    assert expected_records <= records
    assert check_bag(new).damage == []


def test_at_every_length_each_whole_message_of_a_cut_file_comes_back(path):
    whole, rows = path.read_bytes(), held(path)
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        file = recovered_file(path, 'mcap', False, DEFAULT_LIMITS)
        found = sorted(sent.data for _, sent in file.messages())
        expected = [data for *_, data in rows if whole.index(data) + len(data) <= length]
        assert found == sorted(expected)
        assert file.damage


@pytest.mark.parametrize('case', ['no summary', 'private and future records'])
def test_no_flipped_bit_loses_a_message_silently(tmp_path, case):
    path = tmp_path / 'case.mcap'
    whole = bytearray(CASES[case].content)
    position = whole.index(DATA_END)
    whole[position + 9 : position + 13] = struct.pack('<I', crc32(whole[:position]))
    path.write_bytes(whole)
    count = len(held(path))
    assert check_bag(path).damage == []
    for byte in range(len(mcap.MAGIC), position):
        damaged = bytearray(whole)
        damaged[byte] ^= 1 << byte % 8
        path.write_bytes(damaged)
        report = check_bag(path)
        assert report.messages == count or report.damage
        with suppress(ValueError), reading.open_bag(path) as reader:
            assert len(list(reader.messages(reader.topics))) == count


def test_without_a_checksum_a_flipped_type_is_no_private_record(tmp_path):
    path = tmp_path / 'case.mcap'
    content = bytearray(CASES['no summary'].content)
    content[content.index(THREE[1])] ^= 0x80
    path.write_bytes(content)
    report = check_bag(path)
    assert report.messages == 2
    assert report.damage


def test_a_file_in_reverse_order_is_read_in_bounded_memory(tmp_path):
    path = tmp_path / 'case.mcap'
    body = bytes(2000)
    count = 5000
    records = [mcap.message_head(1, count - n, len(body)) + body for n in range(count)]
    path.write_bytes(Case([*DEFINITIONS, *records]).content)
    limits = BagLimits(max_unpacked=2**20)
    with reading.open_bag(path, limits) as reader:
        stamps = [stamp for _, stamp, _ in reader.messages(reader.topics)]
    assert stamps == list(range(1, count + 1))


def test_topics_in_other_encodings_are_rejected_beside_a_cdr_topic(tmp_path):
    path = tmp_path / 'case.mcap'
    number = Schema(2, 'std_msgs/msg/Float64', 'ros2msg', b'float64 data')
    records = [
        *DEFINITIONS,
        mcap.schema_record(number),
        mcap.channel_record(Channel(2, 2, '/nudge', 'cdr', {})),
        mcap.channel_record(Channel(3, 2, '/nudge', 'json', {})),
        message(1, 10),
        mcap.message_head(2, 20, 12) + b'\x00\x01\x00\x00' + struct.pack('<d', 1.5),
        message(2, 30, 3),
    ]
    path.write_bytes(Case(records).content)
    with reading.open_bag(path) as reader:
        assert [sent.data for _, sent in reading.read_topic(reader, 'nudge')] == [1.5]
        with pytest.raises(ValueError, match="example has the encoding 'a'; only cdr is decoded"):
            reading.find_topic(reader, 'example')
