# SPDX-License-Identifier: Apache-2.0
"""Reads what is intact of an MCAP file that is cut short or damaged anywhere."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from zlib import crc32

from soliton_linkage_nodes.bags.guards import forget, mapped
from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import (
    Bytes,
    Channel,
    ChunkHead,
    Opcode,
    Schema,
)
from soliton_linkage_nodes.bags.storages.storage import RescuedFile
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, completed


@dataclass(frozen=True)
class _Chunk:
    """A chunk that was found: where its packed records are, and how they are packed."""

    place: int
    begin: int
    head: ChunkHead
    cut: bool = False
    refused: str = ''


@dataclass(frozen=True)
class _Run:
    """Records side by side, among them messages that are in no chunk."""

    begin: int
    end: int


class RescuedMcap(RescuedFile):
    """The intact messages of an MCAP file, and what is known of their topics.

    Records are taken one after the other; where one is damaged, the search goes on for the next
    head of a record that fits what follows it. A chunk counts if its checksum is right. Of a
    chunk that the file's end cuts, the whole messages before the cut count. `doubtful` lets the
    messages of chunks with wrong checksums count as well.
    """

    def _learn(self, path: Path) -> None:
        self._found: list[_Chunk | _Run] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._doubtful_schemas: dict[int, Schema] = {}
        self._doubtful_channels: dict[int, Channel] = {}
        self._stated: int | None = None
        self._footer = False
        self._sizes: dict[int, int] = {}
        self._data = mapped(path)
        self._budget = self._limits.for_file(len(self._data))
        self._scan()
        channels = {**self._doubtful_channels, **self._channels}
        self._schemas = {**self._doubtful_schemas, **self._schemas}
        self.topics = {number: self._topic(channel) for number, channel in channels.items()}

    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        chunked = any(isinstance(part, _Chunk) for part in self._found)
        for part in self._found:
            if isinstance(part, _Chunk) or not chunked:
                for message in self._messages_of(part):
                    yield message.channel, message.stamp, message.data

    def _conclude(self) -> None:
        missing = (self._stated or 0) - self._read - self.lost
        if missing > 0:
            self.complain(f'{missing} more messages are in the index than in the file', missing)

    def _messages_of(self, part: _Chunk | _Run) -> Iterator[mcap.Message]:
        if isinstance(part, _Run):
            yield from self._unverified(_messages_in(self._data[part.begin : part.end]))
            return
        if part.refused:
            self.complain(f'the chunk at byte {part.place} {part.refused}')
            return
        most = self._limits.most_unpacked
        records, whole = mcap.unpack(part.head, self._packed(part), most)
        messages = _messages_in(records)
        if whole and part.head.crc:
            yield from messages
        elif whole or part.cut or self._doubtful:
            yield from self._unverified(messages)
        if not whole and not part.cut:
            count = 0 if self._doubtful else sum(1 for _ in messages)
            self.complain(
                f'the chunk at byte {part.place} has a wrong checksum: {count} messages left out',
                count,
            )

    def _unverified(self, messages: Iterator[mcap.Message]) -> Iterator[mcap.Message]:
        for message in messages:
            self.unverified += 1
            yield message

    def _scan(self) -> None:
        place = len(mcap.MAGIC)
        if bytes(self._data[:place]) != mcap.MAGIC:
            self.complain('it does not begin as an MCAP file does')
            place = 0
        size = len(self._data)
        while place < size and not self._is_end(place):
            after = self._take(place)
            if after is None:
                after = next_record(self._data, place + 1)
                self.complain(f'bytes {place} to {after} are damaged')
            place = after
        if not self._footer:
            self.complain('it was not finished: there is no index')

    def _is_end(self, place: int) -> bool:
        left = len(self._data) - place
        return left == len(mcap.MAGIC) and bytes(self._data[place:]) == mcap.MAGIC

    def _take(self, place: int) -> int | None:
        """Note the record at a place and return where the next one begins; None for no record."""
        if len(self._data) - place < mcap.RECORD_HEADER.size:
            return None
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, place)
        begin = place + mcap.RECORD_HEADER.size
        if opcode == Opcode.CHUNK:
            return self._take_chunk(place, begin, size)
        end = begin + size
        if opcode not in KINDS or end > len(self._data):
            return None
        if opcode == Opcode.MESSAGE:
            return self._take_message(place, begin, size)
        body = self._data[begin:end]
        try:
            self._define(opcode, body, self._doubtful_schemas, self._doubtful_channels)
            self._learn_about_file(place, opcode, body)
        except ValueError:
            return None
        return int(end)

    def _take_chunk(self, place: int, begin: int, size: int) -> int | None:
        try:
            head = mcap.parse_chunk_head(self._data[begin : begin + LARGEST_CHUNK_HEAD])
        except ValueError:
            return None
        if head.size == size and begin + size > len(self._data):
            self.complain(f'the file ends within the chunk at byte {place}')
            chunk = _Chunk(place, begin, head, cut=True)
            self._note_chunk(chunk, self._unpack(chunk)[0])
            return len(self._data)
        # Either of the two lengths may be damaged; the checksum tells which is right.
        lengths = {size - head.begin, head.packed}
        for packed in lengths:
            chunk = _Chunk(place, begin, replace(head, packed=packed))
            if not 0 <= packed <= len(self._data) - begin - head.begin:
                continue
            records, whole = self._unpack(chunk)
            if whole:
                self._note_chunk(chunk, records)
                return begin + chunk.head.size
        refused = self._refusal(head)
        if len(lengths) > 1 and not refused:
            return None
        self._found.append(_Chunk(place, begin, head, refused=refused))
        return int(begin + size)

    def _refusal(self, head: ChunkHead) -> str:
        """Why a chunk is left out unread, if it is."""
        limits = self._limits
        if head.uncompressed > limits.most_unpacked:
            return f'unpacks to more than most_unpacked = {limits.most_unpacked} bytes: left out'
        if self._budget <= 0:
            most = limits.for_file(len(self._data))
            return f'is beyond what the file may unpack to, most_unpacked_file = {most}: left out'
        return ''

    def _unpack(self, chunk: _Chunk) -> tuple[Bytes, bool]:
        """Unpack a chunk for the first time, which all chunks together may not do without end."""
        if self._budget <= 0:
            return b'', False
        records, whole = mcap.unpack(chunk.head, self._packed(chunk), self._limits.most_unpacked)
        self._budget -= len(records)
        return records, whole

    def _note_chunk(self, chunk: _Chunk, records: Bytes) -> None:
        """Keep a chunk and learn what it defines."""
        self._found.append(chunk)
        for _, opcode, body in mcap.records_in(records):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                with suppress(ValueError):
                    self._define(opcode, body, self._schemas, self._channels)

    def _packed(self, chunk: _Chunk) -> Bytes:
        begin = chunk.begin + chunk.head.begin
        return self._data[begin : begin + chunk.head.packed]

    def _take_message(self, place: int, begin: int, size: int) -> int | None:
        if size < mcap.MESSAGE_HEADER.size:
            return None
        end = begin + size
        channel = struct.unpack_from('<H', self._data, begin)[0]
        known = channel in self._doubtful_channels or channel in self._channels
        following = self._data[end : end + 1]
        # What follows tells whether the length is right; if that is damaged, those before do.
        fits = not following or following[0] in KINDS or self._sizes.get(channel) == size
        if not known or not fits:
            return None
        self._sizes[channel] = size
        last = self._found[-1] if self._found else None
        if isinstance(last, _Run) and last.end == place:
            self._found[-1] = _Run(last.begin, end)
        else:
            self._found.append(_Run(place, end))
        return end

    def _define(
        self, opcode: int, body: Bytes, schemas: dict[int, Schema], channels: dict[int, Channel]
    ) -> None:
        if opcode == Opcode.SCHEMA:
            schema = mcap.parse_schema(body)
            schema.data.decode()
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap.parse_channel(body)
            channels[channel.id] = channel

    def _learn_about_file(self, place: int, opcode: int, body: Bytes) -> None:
        if opcode == Opcode.METADATA:
            name, texts = mcap.parse_metadata(body)
            if name == mcap.NOTES:
                self.custom_data.update(texts)
            elif name == 'rosbag2':
                self.custom_data.update(custom_data_of(texts.get('serialized_metadata', '')))
        elif opcode == Opcode.MESSAGE_INDEX:
            mcap.parse_message_index(body)
        elif opcode == Opcode.STATISTICS:
            self._stated = mcap.Fields(body).number(8)
        elif opcode == Opcode.FOOTER:
            self._check_footer(place, body)

    def _check_footer(self, place: int, body: Bytes) -> None:
        fields = mcap.Fields(body)
        start, _, checksum = fields.number(8), fields.number(8), fields.number(4)
        self._footer = True
        covered = self._data[start : place + mcap.RECORD_HEADER.size + 16]
        if checksum and crc32(covered) != checksum:
            self._stated = None
            self.complain('its index has a wrong checksum')

    def _topic(self, channel: Channel) -> StoredTopic:
        schema = self._schemas.get(channel.schema)
        return completed(
            channel.id,
            channel.topic,
            schema.name if schema else '',
            (schema.encoding, schema.data.decode()) if schema else None,
            channel.metadata.get('topic_type_hash', ''),
            channel.metadata.get('offered_qos_profiles', ''),
        )


def _messages_in(records: Bytes) -> Iterator[mcap.Message]:
    for _, opcode, body in mcap.records_in(records):
        if opcode == Opcode.MESSAGE:
            with suppress(ValueError):
                yield mcap.parse_message(body)


KINDS: Final = range(Opcode.HEADER, Opcode.DATA_END + 1)
"""Every opcode that the format defines."""
LARGEST_CHUNK_HEAD: Final = 64
"""Bytes that the head of a chunk fits into: 40 of numbers and the name of its codec."""
_HEAD = re.compile(rb'[\x01-\x0f](?=.{5}\x00\x00\x00)', re.DOTALL)
"""A record's head: its kind and a length under 2^40."""
_WINDOW = 2**26
"""Bytes of a file that are searched before the memory that holds them is let go of."""
_SIZES = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
"""Bytes of records whose size is fixed."""
_PARSERS: dict[int, Callable[[Bytes], object]] = {
    Opcode.MESSAGE: mcap.parse_message,
    Opcode.MESSAGE_INDEX: mcap.parse_message_index,
    Opcode.SCHEMA: mcap.parse_schema,
    Opcode.CHANNEL: mcap.parse_channel,
    Opcode.METADATA: mcap.parse_metadata,
}


def next_record(data: memoryview, begin: int) -> int:
    """Where the next record begins that is told from chance, or the end of the file."""
    for start in range(begin, len(data), _WINDOW):
        end = min(start + _WINDOW, len(data))
        window = data[start : end + mcap.RECORD_HEADER.size]
        for match in _HEAD.finditer(window, 0):
            place = start + match.start()
            if place < end and _is_record(data, place):
                return place
        if end < len(data):
            forget(data)
    return len(data)


def _is_record(data: Bytes, place: int) -> bool:
    """Whether what is at a place has the form of a record that a file goes on with."""
    opcode, size = mcap.RECORD_HEADER.unpack_from(data, place)
    begin = place + mcap.RECORD_HEADER.size
    end = begin + size
    following = data[end : end + 1]
    if opcode == Opcode.CHUNK:
        with suppress(ValueError):
            head = mcap.parse_chunk_head(data[begin : begin + LARGEST_CHUNK_HEAD])
            return head.size == int(size)
        return False
    if end > len(data) or (following and following[0] not in (*KINDS, mcap.MAGIC[0])):
        return False
    body = data[begin:end]
    if opcode in _SIZES:
        return len(body) == _SIZES[Opcode(opcode)]
    if opcode in _PARSERS:
        with suppress(ValueError):
            _PARSERS[opcode](body)
            return True
    return False
