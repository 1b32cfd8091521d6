# SPDX-License-Identifier: Apache-2.0
"""Parsers and serializers of MCAP records (https://mcap.dev/spec)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias
from zlib import crc32

from backports import zstd

from soliton_linkage_nodes.bags.guards import decompress_prefix
from soliton_linkage_nodes.bags.storages.storage import Message
from soliton_linkage_nodes.bags.stored_topic import CDR, StoredTopic

MAGIC: Final = b'\x89MCAP0\r\n'
MESSAGE_HEADER: Final = struct.Struct('<HIQQ')
_MESSAGE_RECORD_HEADER: Final = struct.Struct('<BQHIQQ')
RECORD_HEADER: Final = struct.Struct('<BQ')
CHUNK_HEADER: Final = struct.Struct('<QQQI')
CODECS: Final = ('', 'zstd', 'lz4')
Bytes: TypeAlias = bytes | bytearray | memoryview
PROFILE: Final = 'ros2'
_PROFILES: Final = 'offered_qos_profiles'
_DIGEST: Final = 'topic_type_hash'
CUSTOM_DATA: Final = 'soliton_linkage'
"""Name of the metadata records that contain the custom data while a bag is being written."""


class Opcode(IntEnum):
    """Types of MCAP records."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


@dataclass(frozen=True)
class Schema:
    """MCAP schema. It contains the definition of a message type."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """MCAP channel: topic, number of the schema, message encoding and metadata."""

    id: int
    schema: int
    topic: str
    encoding: str
    metadata: Mapping[str, str]


def record(opcode: Opcode, *parts: bytes) -> bytes:
    """Return a record whose body is the concatenation of the parts."""
    body = b''.join(parts)
    return RECORD_HEADER.pack(opcode, len(body)) + body


def sized(data: bytes) -> bytes:
    """Return the length of `data` in four bytes, followed by `data`."""
    return struct.pack('<I', len(data)) + data


def text(value: str) -> bytes:
    """Return the length of a text in UTF-8, followed by the text."""
    return sized(value.encode())


def schema_record(schema: Schema) -> bytes:
    """Return a schema as a record."""
    names = text(schema.name) + text(schema.encoding)
    return record(Opcode.SCHEMA, struct.pack('<H', schema.id), names, sized(schema.data))


def channel_record(channel: Channel) -> bytes:
    """Return a channel as a record."""
    numbers = struct.pack('<HH', channel.id, channel.schema)
    names = text(channel.topic) + text(channel.encoding)
    return record(Opcode.CHANNEL, numbers, names, _text_map(channel.metadata))


def topic_of(channel: Channel, schemas: Mapping[int, Schema]) -> StoredTopic:
    """Return the topic of a channel. The topic has no type if the schema is missing."""
    schema = schemas.get(channel.schema) or Schema(0, '', 'ros2msg' if channel.schema else '', b'')
    texts, definition = dict(channel.metadata), schema.data.decode(errors='surrogateescape')
    own = schema.encoding, texts.pop(_DIGEST, ''), texts.pop(_PROFILES, ''), channel.encoding
    about = tuple(texts.items())
    return StoredTopic(channel.id, channel.topic, schema.name, definition, *own, about)


def channel_of(topic: StoredTopic, schema: int) -> Channel:
    """Return the channel for a topic. `schema` is the number of the schema.

    The metadata of a CDR channel contains entries for the QoS profiles and the type hash, even if
    these are empty. rosbag2 requires the entries.
    """
    own = {_PROFILES: topic.profiles, _DIGEST: topic.digest}
    if topic.serialization != CDR:
        own = {key: value for key, value in own.items() if value}
    about = {**own, **dict(topic.about)}
    return Channel(topic.number, schema, topic.name, topic.serialization, about)


def metadata_record(name: str, texts: Mapping[str, str]) -> bytes:
    """Return a metadata record, which consists of a name and a map from texts to texts."""
    return record(Opcode.METADATA, text(name), _text_map(texts))


def _text_map(texts: Mapping[str, str]) -> bytes:
    return sized(b''.join(text(key) + text(value) for key, value in texts.items()))


def message_head(
    channel: int, stamp: int, size: int, published: int | None = None, sequence: int = 0
) -> bytes:
    """Return the bytes that precede the data in a message record. The data has `size` bytes.

    `stamp` is the receive time [ns]. `published` is the publish time [ns], by default `stamp`.
    """
    length = MESSAGE_HEADER.size + size
    published = stamp if published is None else published
    return _MESSAGE_RECORD_HEADER.pack(Opcode.MESSAGE, length, channel, sequence, stamp, published)


def chunk_record(
    records: bytes | memoryview, start: int, end: int, codec: str
) -> tuple[bytes, bytes | memoryview]:
    """Return the head and the content of a chunk record. The content is compressed by `codec`.

    `start` and `end` are the first and the last receive time in the chunk [ns].
    """
    packed = zstd.compress(records) if codec == 'zstd' else records
    fields = CHUNK_HEADER.pack(start, end, len(records), crc32(records))
    fields += text(codec) + struct.pack('<Q', len(packed))
    return RECORD_HEADER.pack(Opcode.CHUNK, len(fields) + len(packed)) + fields, packed


def message_index_record(channel: int, entries: Sequence[int]) -> bytes:
    """Return the index of the messages of a channel in a chunk.

    `entries` contains the stamp [ns] and the offset [B] of each message in turn.
    """
    packed = struct.pack(f'<{len(entries)}Q', *entries)
    return record(Opcode.MESSAGE_INDEX, struct.pack('<H', channel), sized(packed))


def attachment_index_record(body: Bytes, offset: int, length: int) -> bytes:
    """Return the index of an attachment from the body, offset [B] and length [B] of its record."""
    fields = Fields(body)
    times, name, media_type = bytes(fields.take(16)), fields.sized(), fields.sized()
    size = struct.pack('<Q', fields.number(8))
    position = struct.pack('<QQ', offset, length)
    names = sized(bytes(name)) + sized(bytes(media_type))
    return record(Opcode.ATTACHMENT_INDEX, position, times, size, names)


def data_is_intact(data: Bytes, end: int) -> bool:
    """Return whether the first `end` bytes agree with the checksum in the DataEnd record.

    This record begins at byte `end`. If its checksum is 0, there is no checksum, and the result is
    True.
    """
    begin = end + RECORD_HEADER.size
    checksum = int.from_bytes(data[begin : begin + 4], 'little')
    return not checksum or crc32(data[:end]) == checksum


def attachment_is_intact(body: Bytes) -> bool:
    """Return whether an attachment agrees with its checksum. Without a checksum, return True."""
    size = len(body) - extra_bytes(Opcode.ATTACHMENT, body) - 4
    checksum = int.from_bytes(body[size : size + 4], 'little')
    return not checksum or crc32(body[:size]) == checksum


class Fields:
    """Parser of the fields of a record. Raises ValueError if a field exceeds the record."""

    def __init__(self, body: Bytes) -> None:
        self._body = body
        self._offset = 0

    @property
    def rest(self) -> int:
        """Number of bytes that are not parsed yet."""
        return len(self._body) - self._offset

    def take(self, size: int) -> Bytes:
        """Return the next `size` bytes."""
        end = self._offset + size
        if end > len(self._body):
            raise ValueError(f'a field of {size} bytes exceeds its record of {len(self._body)}')
        taken = self._body[self._offset : end]
        self._offset = end
        return taken

    def number(self, size: int) -> int:
        """Return the next field, an unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), 'little')

    def sized(self) -> Bytes:
        """Return the next field, a byte string that is preceded by its length."""
        return self.take(self.number(4))

    def text(self) -> str:
        """Return the next field, a text."""
        return bytes(self.sized()).decode()

    def text_map(self) -> dict[str, str]:
        """Return the next field, a map from texts to texts."""
        inner = Fields(self.sized())
        texts = {}
        while inner.rest:
            key = inner.text()
            texts[key] = inner.text()
        return texts


def define(
    opcode: int, body: Bytes, schemas: dict[int, Schema], channels: dict[int, Channel]
) -> None:
    """If a record is a schema or a channel, add it to `schemas` or `channels`.

    Raises ValueError if the record is invalid.
    """
    fields = Fields(body)
    if opcode == Opcode.SCHEMA:
        number = fields.number(2)
        schemas[number] = Schema(number, fields.text(), fields.text(), bytes(fields.sized()))
    elif opcode == Opcode.CHANNEL:
        number, schema = fields.number(2), fields.number(2)
        names = fields.text(), fields.text()
        channels[number] = Channel(number, schema, *names, fields.text_map())


def parse_message(body: Bytes) -> Message:
    """Return the message in a record. Raises ValueError if the record is too short."""
    if len(body) < MESSAGE_HEADER.size:
        raise ValueError(f'a message of {len(body)} bytes is shorter than its header')
    channel, sequence, stamp, published = MESSAGE_HEADER.unpack_from(body)
    return Message(channel, sequence, stamp, published, bytes(body[MESSAGE_HEADER.size :]))


_TEXT, _DATA = 4, 8
_LAYOUTS: dict[int, tuple[int, tuple[int, ...], int]] = {
    Opcode.HEADER: (0, (_TEXT, _TEXT), 0),
    Opcode.FOOTER: (20, (), 0),
    Opcode.SCHEMA: (2, (_TEXT, _TEXT, _TEXT), 0),
    Opcode.CHANNEL: (4, (_TEXT, _TEXT, _TEXT), 0),
    Opcode.MESSAGE_INDEX: (2, (_TEXT,), 0),
    Opcode.CHUNK_INDEX: (32, (_TEXT,), 8),
    Opcode.ATTACHMENT: (16, (_TEXT, _TEXT, _DATA), 4),
    Opcode.ATTACHMENT_INDEX: (40, (_TEXT, _TEXT), 0),
    Opcode.STATISTICS: (42, (_TEXT,), 0),
    Opcode.METADATA: (0, (_TEXT, _TEXT), 0),
    Opcode.METADATA_INDEX: (16, (_TEXT,), 0),
    Opcode.SUMMARY_OFFSET: (17, (), 0),
    Opcode.DATA_END: (4, (), 0),
}
"""Layout of the body of each record: size of all numbers at the start [B], size of the length of
each following text or data field [B], and size of all numbers at the end [B]."""


def extra_bytes(opcode: int, body: Bytes) -> int:
    """Return the number of bytes after the last known field of a record.

    Raises ValueError if a field is missing.
    """
    head, lengths, tail = _LAYOUTS[opcode]
    fields = Fields(body)
    fields.take(head)
    for size in lengths:
        fields.take(fields.number(size))
    fields.take(tail)
    if opcode == Opcode.CHUNK_INDEX:
        fields.sized()
        fields.take(16)
    return fields.rest


@dataclass(frozen=True)
class ChunkHead:
    """Head of a chunk record.

    The content of the chunk begins at byte `begin` of the body and has `packed` bytes. Before
    compression, the content had `uncompressed` bytes.
    """

    uncompressed: int
    crc: int
    codec: str
    packed: int
    begin: int

    @property
    def size(self) -> int:
        """Size of the body of the chunk record [B]."""
        return self.begin + self.packed


def parse_chunk_head(body: Bytes) -> ChunkHead:
    """Return the head in the body of a chunk record. Raises ValueError if the head is invalid."""
    fields = Fields(body)
    _, _, uncompressed, crc = CHUNK_HEADER.unpack(fields.take(CHUNK_HEADER.size))
    codec = bytes(fields.sized())
    if codec not in {name.encode() for name in CODECS}:
        raise ValueError(f'a chunk has the compression {codec[:20]!r}, which is not in {CODECS}')
    packed = fields.number(8)
    begin = CHUNK_HEADER.size + 4 + len(codec) + 8
    return ChunkHead(uncompressed, crc, codec.decode(), packed, begin)


def unpack(head: ChunkHead, packed: Bytes, most: int) -> tuple[Bytes, bool]:
    """Return the decompressed records of a chunk, and whether they are intact.

    If the records exceed `most` bytes, b'' and False are returned.
    """
    if head.uncompressed > most:
        return b'', False
    records = packed
    if head.codec:
        records = decompress_prefix(packed, head.codec, head.uncompressed)
    whole = len(packed) == head.packed and len(records) == head.uncompressed
    return records, whole and (not head.crc or crc32(records) == head.crc)


def records_in(data: Bytes) -> Iterator[tuple[int, int, Bytes]]:
    """Yield offset, opcode and body of each record, up to the first invalid record."""
    data, offset = memoryview(data), 0
    while offset + RECORD_HEADER.size <= len(data):
        opcode, size = RECORD_HEADER.unpack_from(data, offset)
        begin = offset + RECORD_HEADER.size
        if not opcode or begin + size > len(data):
            return
        yield offset, opcode, data[begin : begin + size]
        offset = begin + size


def messages_in(records: Bytes, strict: bool = True) -> Iterator[Message]:
    """Yield the messages in records.

    A message that is too short raises ValueError if `strict` is set. Otherwise it is skipped.
    """
    for _, opcode, body in records_in(records):
        if opcode == Opcode.MESSAGE and (strict or len(body) >= MESSAGE_HEADER.size):
            yield parse_message(body)
