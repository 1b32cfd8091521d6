# SPDX-License-Identifier: Apache-2.0
"""Reads a whole MCAP file by its index, a chunk at a time."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection

from soliton_linkage_nodes.bags.guards import mapped
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

_FOOTER_SIZE = 20
"""Bytes of the footer's fields: two places in the file and a checksum."""
_TAIL = mcap.RECORD_HEADER.size + _FOOTER_SIZE + len(mcap.MAGIC)
"""Bytes that a finished file ends with: its footer and its magic."""
_MESSAGE_COST = 250
"""About what a message that waits takes beside its bytes [B]."""
_MOST_WAITING = 4
"""Times `most_unpacked` that messages of chunks that overlap in time may take while they wait."""
_CHUNK_INDEX = struct.Struct('<QQQ')


@dataclass(frozen=True)
class _ChunkPlace:
    """Where a chunk is in the file, and when its first and last message were received [ns]."""

    start: int
    end: int
    place: int


class IndexedMcap(LimitedReader):
    """The messages of an MCAP file in the order of their receipt.

    Of a file without index all is read when it is opened, and messages come as they stand there.
    Methods raise ValueError where the file is damaged or asks for more than the limits.
    """

    def __init__(self, path: Path) -> None:
        """Look for nothing yet."""
        super().__init__()
        self._path = path
        self._data: Bytes = b''
        self._end = 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: dict[int, _ChunkPlace] = {}
        self._counts: Counter[int] | None = None
        self._span: tuple[int, int] | None = None

    def open(self) -> None:
        """Learn which topics there are, and where their messages."""
        self._data = mapped(self._path)
        self._end = len(self._data) - _TAIL
        size = len(mcap.MAGIC)
        if self._end < size or bytes(self._data[:size]) != mcap.MAGIC:
            raise ValueError('it does not begin as an MCAP file does')
        opcode, footer = mcap.RECORD_HEADER.unpack_from(self._data, self._end)
        if (opcode, footer) != (Opcode.FOOTER, _FOOTER_SIZE) or bytes(
            self._data[-size:]
        ) != mcap.MAGIC:
            raise ValueError('it does not end as an MCAP file does.')
        (summary,) = struct.unpack_from('<Q', self._data, self._end + mcap.RECORD_HEADER.size)
        if summary:
            for _, opcode, body in mcap.records_in(self._data[summary : self._end]):
                self._learn(opcode, body)
            self._end = min(summary, self._end)
        if self._counts is None or not (self._schemas and self._channels):
            self._count()
        self._describe()

    def close(self) -> None:
        """Let go of the file."""
        self._data = b''

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield topic, stamp [ns] and bytes, from a stamp on and before another."""
        wanted = {each.id: each for each in connections}
        first = 0 if start is None else start
        last = LAST_STAMP if stop is None else stop - 1
        for message in self._in_order(first, last) if self._chunks else self._as_they_stand():
            if message.stamp > LAST_STAMP:
                raise ValueError(f'a message has the stamp {message.stamp} ns, beyond all time')
            if message.channel in wanted and first <= message.stamp <= last:
                yield wanted[message.channel], message.stamp, message.data

    def _learn(self, opcode: int, body: Bytes) -> None:
        if opcode == Opcode.SCHEMA:
            schema = mcap.parse_schema(body)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap.parse_channel(body)
            self._channels[channel.id] = channel
        elif opcode == Opcode.CHUNK_INDEX:
            place = _ChunkPlace(*_CHUNK_INDEX.unpack(mcap.Fields(body).take(_CHUNK_INDEX.size)))
            self._chunks[place.place] = place
        elif opcode == Opcode.STATISTICS:
            fields = mcap.Fields(body)
            fields.take(8 + 2 + 4 * 4)
            span = fields.number(8), fields.number(8)
            counts = struct.iter_unpack('<HQ', fields.sized())
            self._counts = Counter(dict(counts))
            self._span = span if any(self._counts.values()) else None

    def _count(self) -> None:
        """Learn from the records themselves what the index does not tell."""
        counts: Counter[int] = Counter()
        stamps: list[int] = []
        for message in self._as_they_stand():
            counts[message.channel] += 1
            stamps = [min([message.stamp, *stamps[:1]]), max([message.stamp, *stamps[1:]])]
        self._counts = counts
        self._span = (stamps[0], stamps[1]) if stamps else None

    def _describe(self) -> None:
        counts = self._counts or Counter[int]()
        for channel in self._channels.values():
            schema = self._schemas.get(channel.schema)
            self.connections.append(
                connection(
                    self,
                    channel.id,
                    channel.topic,
                    schema.name if schema else '',
                    (schema.encoding, schema.data.decode()) if schema else ('', ''),
                    channel.metadata.get('topic_type_hash', ''),
                    count=counts[channel.id],
                    serialization=channel.encoding,
                    profiles=channel.metadata.get('offered_qos_profiles', ''),
                )
            )
        if self._span and max(self._span) > LAST_STAMP:
            raise ValueError(f'it reaches from {self._span[0]} to {self._span[1]} ns')
        self.metadata = summary_of(self.connections, self._span)

    def _in_order(self, first: int, last: int) -> Iterator[Message]:
        """Messages by their stamps, of chunks that hold some between two stamps."""
        waiting: list[tuple[int, int, Message]] = []
        number = cost = 0
        most = _MOST_WAITING * self.limits.most_unpacked
        budget = self.limits.for_file(len(self._data))
        for place in sorted(self._chunks.values(), key=lambda each: each.start):
            if place.end < first or place.start > last:
                continue
            while waiting and waiting[0][0] < place.start:
                message = heapq.heappop(waiting)[2]
                cost -= len(message.data) + _MESSAGE_COST
                yield message
            opcode, body = self._record_at(place.place)
            records = self._unpacked(body) if opcode == Opcode.CHUNK else b''
            budget -= len(records)
            self._check(budget >= 0, 'its chunks together', 'most_unpacked_file')
            for message in _messages_in(records):
                if not first <= message.stamp <= last:
                    continue
                number += 1
                cost += len(message.data) + _MESSAGE_COST
                self._check(cost <= most, 'chunks that overlap in time', 'most_unpacked')
                heapq.heappush(waiting, (message.stamp, number, message))
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _as_they_stand(self) -> Iterator[Message]:
        """All messages, by the records that hold them; definitions are learnt on the way."""
        budget = self.limits.for_file(len(self._data))
        for _, opcode, body in mcap.records_in(self._data[len(mcap.MAGIC) : self._end]):
            records: Bytes = b''
            if opcode == Opcode.MESSAGE:
                yield mcap.parse_message(body)
            elif opcode == Opcode.CHUNK:
                records = self._unpacked(body)
                budget -= len(records)
                self._check(budget >= 0, 'its chunks together', 'most_unpacked_file')
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._learn(opcode, body)
            for _, inner, content in mcap.records_in(records):
                if inner == Opcode.MESSAGE:
                    yield mcap.parse_message(content)
                elif inner in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._learn(inner, content)

    def _record_at(self, place: int) -> tuple[int, Bytes]:
        if place + mcap.RECORD_HEADER.size > self._end:
            raise ValueError(f'its index tells of byte {place}, beyond its messages')
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, place)
        begin = place + mcap.RECORD_HEADER.size
        return opcode, self._data[begin : begin + size]

    def _unpacked(self, body: Bytes) -> Bytes:
        head = mcap.parse_chunk_head(body)
        self._check(head.uncompressed <= self.limits.most_unpacked, 'a chunk', 'most_unpacked')
        packed = body[head.begin : head.begin + head.packed]
        records, whole = mcap.unpack(head, packed, self.limits.most_unpacked)
        if not whole:
            raise ValueError('a chunk has another size or checksum than it says')
        return records

    def _check(self, kept: bool, what: str, limit: str) -> None:
        if not kept:
            most = getattr(self.limits, limit)
            raise ValueError(
                f'{what} would unpack to more than {limit} = {most} bytes; raise {limit}'
            )


def _messages_in(records: Bytes) -> Iterator[Message]:
    for _, opcode, body in mcap.records_in(records):
        if opcode == Opcode.MESSAGE:
            yield mcap.parse_message(body)
