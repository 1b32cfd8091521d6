# SPDX-License-Identifier: Apache-2.0
"""Records of MCAP files as bytes (https://mcap.dev/spec): what writing and rescuing share."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias
from zlib import crc32

from backports import zstd

from soliton_linkage_nodes.bags.guards import unpacked_begin

MAGIC: Final = b'\x89MCAP0\r\n'
MESSAGE_HEADER: Final = struct.Struct('<HIQQ')
_MESSAGE_RECORD_HEADER: Final = struct.Struct('<BQHIQQ')
RECORD_HEADER: Final = struct.Struct('<BQ')
CHUNK_HEADER: Final = struct.Struct('<QQQI')
CODECS: Final = ('', 'zstd', 'lz4')
Bytes: TypeAlias = bytes | bytearray | memoryview
"""What is read: views, where a copy would have to be made."""
PROFILE: Final = 'ros2'
NOTES: Final = 'soliton_linkage'
"""Name of the records of metadata in which a bag that is not closed keeps its texts."""


class Opcode(IntEnum):
    """Kinds of records."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


@dataclass(frozen=True)
class Schema:
    """Definition of a message type."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A topic: its schema, name, encoding of messages, and texts about it."""

    id: int
    schema: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


@dataclass(frozen=True)
class Message:
    """A message of a channel, and when it was received [ns]."""

    channel: int
    stamp: int
    data: bytes


def record(opcode: Opcode, *parts: bytes) -> bytes:
    """A record of some parts."""
    body = b''.join(parts)
    return RECORD_HEADER.pack(opcode, len(body)) + body


def text(value: str) -> bytes:
    """A text with its length before it."""
    return sized(value.encode())


def sized(data: bytes) -> bytes:
    """Bytes with their length before them."""
    return struct.pack('<I', len(data)) + data


def schema_record(schema: Schema) -> bytes:
    """A schema as a record."""
    return record(
        Opcode.SCHEMA,
        struct.pack('<H', schema.id),
        text(schema.name),
        text(schema.encoding),
        sized(schema.data),
    )


def channel_record(channel: Channel) -> bytes:
    """A channel as a record."""
    return record(
        Opcode.CHANNEL,
        struct.pack('<HH', channel.id, channel.schema),
        text(channel.topic),
        text(channel.encoding),
        text_map(channel.metadata),
    )


def text_map(texts: Mapping[str, str]) -> bytes:
    """Named texts with their length before them."""
    return sized(b''.join(text(key) + text(value) for key, value in texts.items()))


def metadata_record(name: str, texts: Mapping[str, str]) -> bytes:
    """Named texts as a record."""
    return record(Opcode.METADATA, text(name), text_map(texts))


def message_head(channel: int, stamp: int, size: int) -> bytes:
    """What a message's bytes, so many, follow to be a record.

    It was published when it was received [ns], for all that is known.
    """
    length = MESSAGE_HEADER.size + size
    return _MESSAGE_RECORD_HEADER.pack(Opcode.MESSAGE, length, channel, 0, stamp, stamp)


def chunk_record(
    records: bytes | memoryview, start: int, end: int, codec: str
) -> tuple[bytes, bytes | memoryview]:
    """A chunk of records with messages from start to end [ns]: its head, and they as packed."""
    packed = zstd.compress(records) if codec == 'zstd' else records
    fields = CHUNK_HEADER.pack(start, end, len(records), crc32(records))
    fields += text(codec) + struct.pack('<Q', len(packed))
    return RECORD_HEADER.pack(Opcode.CHUNK, len(fields) + len(packed)) + fields, packed


def message_index_record(channel: int, places: Sequence[int]) -> bytes:
    """Where in the chunk before it the messages of a channel are: stamp [ns], offset, ..."""
    entries = struct.pack(f'<{len(places)}Q', *places)
    return record(Opcode.MESSAGE_INDEX, struct.pack('<H', channel), sized(entries))


class Fields:
    """Takes the fields of a record one after the other; ValueError where they overrun it."""

    def __init__(self, body: Bytes) -> None:
        """Begin at the first field."""
        self._body = body
        self._place = 0

    @property
    def rest(self) -> int:
        """How many bytes were not taken yet."""
        return len(self._body) - self._place

    def take(self, size: int) -> Bytes:
        """Take so many bytes."""
        end = self._place + size
        if end > len(self._body):
            raise ValueError(f'a field of {size} bytes overruns a record of {len(self._body)}')
        taken = self._body[self._place : end]
        self._place = end
        return taken

    def number(self, size: int) -> int:
        """Take a number of so many bytes."""
        return int.from_bytes(self.take(size), 'little')

    def sized(self) -> Bytes:
        """Take bytes that their length goes before."""
        return self.take(self.number(4))

    def text(self) -> str:
        """Take a text."""
        return bytes(self.sized()).decode()

    def text_map(self) -> dict[str, str]:
        """Take named texts."""
        inner = Fields(self.sized())
        texts = {}
        while inner.rest:
            key = inner.text()
            texts[key] = inner.text()
        return texts


def parse_schema(body: Bytes) -> Schema:
    """Schema of a record; ValueError where it is none."""
    fields = Fields(body)
    return Schema(fields.number(2), fields.text(), fields.text(), bytes(fields.sized()))


def parse_channel(body: Bytes) -> Channel:
    """Channel of a record; ValueError where it is none."""
    fields = Fields(body)
    return Channel(
        fields.number(2), fields.number(2), fields.text(), fields.text(), fields.text_map()
    )


def parse_message(body: Bytes) -> Message:
    """Message of a record; ValueError where it is none."""
    if len(body) < MESSAGE_HEADER.size:
        raise ValueError(f'a message of {len(body)} bytes is shorter than its header')
    channel, _, stamp, _ = MESSAGE_HEADER.unpack_from(body)
    return Message(channel, stamp, bytes(body[MESSAGE_HEADER.size :]))


def parse_metadata(body: Bytes) -> tuple[str, dict[str, str]]:
    """Name and texts of a record; ValueError where it is none."""
    fields = Fields(body)
    return fields.text(), fields.text_map()


def parse_message_index(body: Bytes) -> list[int]:
    """Stamps [ns] and offsets of an index of messages, by turns; ValueError where it is none."""
    fields = Fields(body)
    fields.take(2)
    places = fields.sized()
    if len(places) % 16 or fields.rest:
        raise ValueError('an index of messages has the wrong length')
    return list(struct.unpack(f'<{len(places) // 8}Q', places))


@dataclass(frozen=True)
class ChunkHead:
    """What a chunk says of itself, and where its packed records begin in it."""

    uncompressed: int
    crc: int
    codec: str
    packed: int
    begin: int

    @property
    def size(self) -> int:
        """Size of the record's body."""
        return self.begin + self.packed


def parse_chunk_head(body: Bytes) -> ChunkHead:
    """Head of a chunk; ValueError where it is none."""
    fields = Fields(body)
    _, _, uncompressed, crc = CHUNK_HEADER.unpack(fields.take(CHUNK_HEADER.size))
    codec = bytes(fields.sized())
    if codec not in {name.encode() for name in CODECS}:
        raise ValueError(f'a chunk is packed with {codec[:20]!r}, which is none of {CODECS}')
    packed = fields.number(8)
    begin = CHUNK_HEADER.size + 4 + len(codec) + 8
    return ChunkHead(uncompressed, crc, codec.decode(), packed, begin)


def unpack(head: ChunkHead, packed: Bytes, most: int) -> tuple[Bytes, bool]:
    """Records of a chunk as far as they can be unpacked, and whether that is all of them.

    None come out of a chunk that says of itself, or turns out, to be larger than the limit [B].
    """
    if head.uncompressed > most:
        return b'', False
    records = packed
    if head.codec:
        records = unpacked_begin(packed, head.codec, head.uncompressed)
    whole = len(packed) == head.packed and len(records) == head.uncompressed
    return records, whole and (not head.crc or crc32(records) == head.crc)


def records_in(data: Bytes) -> Iterator[tuple[int, int, Bytes]]:
    """Yield offset, opcode and body of each whole record; end where one is cut or damaged."""
    data, place = memoryview(data), 0
    while place + RECORD_HEADER.size <= len(data):
        opcode, size = RECORD_HEADER.unpack_from(data, place)
        begin = place + RECORD_HEADER.size
        if not opcode or begin + size > len(data):
            return
        yield place, opcode, data[begin : begin + size]
        place = begin + size
