# SPDX-License-Identifier: Apache-2.0
"""Reader of finished MCAP files by their index, one chunk at a time."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from pathlib import Path
from typing import NamedTuple

from rosbags.interfaces import Connection

from soliton_linkage_nodes.bags.guards import map_file
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import (
    Bytes,
    Channel,
    Message,
    Opcode,
    Schema,
)
from soliton_linkage_nodes.bags.storages.storage import (
    LAST_STAMP,
    LimitedReader,
    connection,
    summary_of,
)
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_FOOTER_SIZE = 20
"""Size of the footer's fields [B]: two offsets and a checksum."""
_TAIL = mcap.RECORD_HEADER.size + _FOOTER_SIZE + len(mcap.MAGIC)
"""Size of the end of a finished file [B]: footer and magic."""
_MESSAGE_COST = 250
"""Approximate memory of a waiting message in addition to its data [B]."""
_MOST_WAITING = 4
"""Memory for messages of chunks that overlap in time, in multiples of `max_unpacked` [1]."""
_CHUNK_INDEX = struct.Struct('<QQQ')


class _ChunkEntry(NamedTuple):
    """First and last receive time [ns] of a chunk and its offset in the file [B]."""

    start: int
    end: int
    offset: int


class IndexedMcap(LimitedReader):
    """The messages of an MCAP file in the order of their receive times.

    A file without an index is read completely when it is opened; its messages come in file order.
    Methods raise ValueError if the file is damaged or exceeds the limits.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self._data: Bytes = b''
        self._end = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: dict[int, _ChunkEntry] = {}
        self._counts: Counter[int] | None = None
        self._span: tuple[int, int] | None = None

    def open(self) -> None:
        """Read the topics and the index."""
        self._data = map_file(self._path)
        self._end = len(self._data) - _TAIL
        size = len(mcap.MAGIC)
        if self._end < size or bytes(self._data[:size]) != mcap.MAGIC:
            raise ValueError('it does not begin like an MCAP file')
        opcode, footer = mcap.RECORD_HEADER.unpack_from(self._data, self._end)
        magic = bytes(self._data[-size:])
        if (opcode, footer, magic) != (Opcode.FOOTER, _FOOTER_SIZE, mcap.MAGIC):
            raise ValueError('it does not end like an MCAP file.')
        (summary,) = struct.unpack_from('<Q', self._data, self._end + mcap.RECORD_HEADER.size)
        if summary:
            for _, opcode, body in mcap.records_in(self._data[summary : self._end]):
                self._learn(opcode, body)
            self._end = min(summary, self._end)
        if self._counts is None or not (self._schemas and self._channels):
            stamps: list[int] = []
            self._counts = Counter()
            for message in self._in_file_order():
                self._counts[message.channel] += 1
                stamps = [min([message.stamp, *stamps[:1]]), max([message.stamp, *stamps[1:]])]
            self._span = (stamps[0], stamps[1]) if stamps else None
        counts = self._counts
        self.connections += [
            connection(self, self._topic(channel), counts[channel.id])
            for channel in self._channels.values()
        ]
        if self._span and max(self._span) > LAST_STAMP:
            raise ValueError(f'its stamps {self._span[0]} to {self._span[1]} ns exceed 63 bits')
        self.metadata = summary_of(self.connections, self._span)

    def close(self) -> None:
        """Close the file."""
        self._data = b''

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield topic, stamp [ns] and bytes for stamps in [start, stop)."""
        wanted = {each.id: each for each in connections}
        first = 0 if start is None else start
        last = LAST_STAMP if stop is None else stop - 1
        for message in self._in_order(first, last) if self._chunks else self._in_file_order():
            if message.stamp > LAST_STAMP:
                raise ValueError(f'a message has the stamp {message.stamp} ns, above 63 bits')
            if message.channel in wanted and first <= message.stamp <= last:
                yield wanted[message.channel], message.stamp, message.data

    def _topic(self, channel: Channel) -> StoredTopic:
        schema = self._schemas.get(channel.schema) or Schema(0, '', '', b'')
        return StoredTopic(
            channel.id,
            channel.topic,
            schema.name,
            schema.data.decode(),
            schema.encoding,
            channel.metadata.get('topic_type_hash', ''),
            channel.metadata.get('offered_qos_profiles', ''),
            channel.encoding,
        )

    def _learn(self, opcode: int, body: Bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = mcap.parse_schema(body)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap.parse_channel(body)
            self._channels[channel.id] = channel
        elif opcode == Opcode.CHUNK_INDEX:
            entry = _ChunkEntry(*_CHUNK_INDEX.unpack(mcap.Fields(body).take(_CHUNK_INDEX.size)))
            self._chunks[entry.offset] = entry
        elif opcode == Opcode.STATISTICS:
            fields = mcap.Fields(body)
            fields.take(8 + 2 + 4 * 4)
            span = fields.number(8), fields.number(8)
            self._counts = Counter(dict(struct.iter_unpack('<HQ', fields.sized())))
            self._span = span if any(self._counts.values()) else None

    def _in_order(self, first: int, last: int) -> Iterator[Message]:
        """Yield messages sorted by stamp, of the chunks that overlap [first, last]."""
        waiting: list[tuple[int, int, Message]] = []
        number = cost = 0
        most = _MOST_WAITING * self.limits.max_unpacked
        budget = self.limits.for_file(len(self._data))
        for entry in sorted(self._chunks.values()):
            if entry.end < first or entry.start > last:
                continue
            while waiting and waiting[0][0] < entry.start:
                message = heapq.heappop(waiting)[2]
                cost -= len(message.data) + _MESSAGE_COST
                yield message
            records = self._chunk_at(entry.offset)
            budget -= len(records)
            self._check(budget >= 0, 'its chunks together', 'max_unpacked_file')
            for message in mcap.messages_in(records):
                if first <= message.stamp <= last:
                    number += 1
                    cost += len(message.data) + _MESSAGE_COST
                    self._check(cost <= most, 'chunks that overlap in time', 'max_unpacked')
                    heapq.heappush(waiting, (message.stamp, number, message))
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _in_file_order(self) -> Iterator[Message]:
        """Yield all messages as they are stored, and learn the definitions among them."""
        budget = self.limits.for_file(len(self._data))
        for _, opcode, body in mcap.records_in(self._data[len(mcap.MAGIC) : self._end]):
            inner: Iterator[tuple[int, int, Bytes]] = iter([(0, opcode, body)])
            if opcode == Opcode.CHUNK:
                records = self._unpacked(body)
                budget -= len(records)
                self._check(budget >= 0, 'its chunks together', 'max_unpacked_file')
                inner = mcap.records_in(records)
            for _, kind, content in inner:
                if kind == Opcode.MESSAGE:
                    yield mcap.parse_message(content)
                elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._learn(kind, content)

    def _chunk_at(self, offset: int) -> Bytes:
        begin = offset + mcap.RECORD_HEADER.size
        if begin > self._end:
            raise ValueError(f'its index points to byte {offset}, beyond its messages')
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, offset)
        return self._unpacked(self._data[begin : begin + size]) if opcode == Opcode.CHUNK else b''

    def _unpacked(self, body: Bytes) -> Bytes:
        head = mcap.parse_chunk_head(body)
        self._check(head.uncompressed <= self.limits.max_unpacked, 'a chunk', 'max_unpacked')
        packed = body[head.begin : head.begin + head.packed]
        records, whole = mcap.unpack(head, packed, self.limits.max_unpacked)
        if not whole:
            raise ValueError('the size or checksum of a chunk is wrong')
        return records

    def _check(self, within: bool, subject: str, limit: str) -> None:
        if not within:
            most = getattr(self.limits, limit)
            raise ValueError(
                f'{subject} would decompress to more than {limit} = {most} bytes; raise {limit}'
            )
