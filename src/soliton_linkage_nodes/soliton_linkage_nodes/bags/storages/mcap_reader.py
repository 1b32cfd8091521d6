# SPDX-License-Identifier: Apache-2.0
"""Reader of finished MCAP files. It reads only the chunks with the requested times."""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from soliton_linkage_nodes.bags.guards import BagLimits, map_file
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Bytes, Channel, Opcode, Schema
from soliton_linkage_nodes.bags.storages.storage import LAST_STAMP, Message

_FOOTER_SIZE = 20
"""Size of the footer [B]. The footer contains two offsets and a checksum."""
_TAIL = mcap.RECORD_HEADER.size + _FOOTER_SIZE + len(mcap.MAGIC)
_MESSAGE_COST = 250
"""Assumed memory of a message in addition to its data [B]."""
_MOST_WAITING = 4
"""Messages of chunks that overlap in time wait in memory until they can be yielded in order. Their
memory is limited to this number [1] times `BagLimits.max_unpacked`, the limit for one chunk."""
_LONGEST_RUN = 2**20
"""Size at which a run of messages outside of chunks ends [B]. A run is read as a whole."""
_CHUNK_INDEX = struct.Struct('<QQQQ')
_stamp = attrgetter('stamp')


class _Stretch(NamedTuple):
    """Part of a file: a chunk, or a run of consecutive messages outside of chunks.

    `start` and `end` are the first and the last receive time in this part [ns]. `offset` is the
    position of the part in the file, and `size` is its size [B].
    """

    start: int
    end: int
    offset: int
    size: int


class IndexedMcap:
    """Reader of the messages of an MCAP file in the order of their receive times.

    `topics` maps topic numbers to topics, and `counts` maps topic numbers to numbers of messages.
    `span` is the first and the last receive time [ns], or None for a file without messages. The
    methods raise ValueError if the file is damaged or exceeds the limits.
    """

    def __init__(self, path: Path, limits: BagLimits) -> None:
        """Read the topics and the index. If the index is incomplete, read the whole file."""
        self._limits = limits
        self._data: Bytes = map_file(path)
        self._end = len(self._data) - _TAIL
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._parts: list[_Stretch] = []
        self._after: dict[int, int] = {}
        self._stated: Counter[int] | None = None
        self.span: tuple[int, int] | None = None
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
                self._take_record(opcode, body)
            self._end = min(summary, self._end)
        schemas = {channel.schema for channel in self._channels.values()} - {0}
        known = schemas <= self._schemas.keys()
        if self._stated is None or not (known and self._stated.keys() <= self._channels.keys()):
            self._parts, self._after = [], {}
            self.counts = self._scan()
            starts = [part.start for part in self._parts]
            self.span = (min(starts), max(part.end for part in self._parts)) if starts else None
        else:
            self._scan()
            self.counts = self._stated
        self._parts.sort()
        channels = self._channels.items()
        self.topics = {n: mcap.topic_of(channel, self._schemas) for n, channel in channels}
        if self.span and max(self.span) > LAST_STAMP:
            raise ValueError(f'its stamps {self.span[0]} to {self.span[1]} ns exceed 63 bits')

    def close(self) -> None:
        """Close the file."""
        self._data = b''

    def messages(
        self, topics: Collection[int], start: int | None, stop: int | None
    ) -> Iterator[Message]:
        """Yield the messages with these topic numbers and a receive time in [start, stop) [ns]."""
        first = 0 if start is None else start
        last = LAST_STAMP if stop is None else stop - 1
        return (each for each in self._in_order(first, last) if each.topic in topics)

    def _take_record(self, opcode: int, body: Bytes) -> None:
        mcap.define(opcode, body, self._schemas, self._channels)
        if opcode == Opcode.CHUNK_INDEX:
            fields = mcap.Fields(body)
            part = _Stretch(*_CHUNK_INDEX.unpack(fields.take(_CHUNK_INDEX.size)))
            fields.sized()
            if part.offset not in self._after:
                self._parts.append(part)
            self._after[part.offset] = part.offset + part.size + fields.number(8)
        elif opcode == Opcode.STATISTICS:
            fields = mcap.Fields(body)
            fields.take(8 + 2 + 4 * 4)
            span = fields.number(8), fields.number(8)
            self._stated = Counter(dict(struct.iter_unpack('<HQ', fields.sized())))
            self.span = span if any(self._stated.values()) else None

    def _scan(self) -> Counter[int]:
        counts: Counter[int] = Counter()
        budget = self._limits.for_file(len(self._data))
        offset = len(mcap.MAGIC)
        while offset + mcap.RECORD_HEADER.size <= self._end:
            if offset in self._after:
                offset = max(self._after[offset], offset + mcap.RECORD_HEADER.size)
                continue
            opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, offset)
            begin = offset + mcap.RECORD_HEADER.size
            end = int(begin + size)
            if opcode == Opcode.DATA_END or not opcode or end > self._end:
                break
            body = self._data[begin:end]
            inner: Iterable[tuple[int, int, Bytes]] = [(0, opcode, body)]
            if opcode == Opcode.CHUNK:
                records = self._unpacked(body)
                budget -= len(records)
                self._check(budget >= 0, 'its chunks together', 'max_unpacked_file')
                inner = mcap.records_in(records)
            stamps = []
            for _, kind, content in inner:
                if kind == Opcode.MESSAGE:
                    message = mcap.parse_message(content)
                    counts[message.topic] += 1
                    stamps.append(message.stamp)
                elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._take_record(kind, content)
            if stamps:
                part = _Stretch(min(stamps), max(stamps), offset, end - offset)
                self._add_part(part, opcode == Opcode.MESSAGE)
            offset = end
        # If the index lists the chunks, their own checksums are sufficient.
        at_end = self._data[offset : offset + 1] == bytes([Opcode.DATA_END])
        if not self._after and not (at_end and mcap.data_is_intact(self._data, offset)):
            raise ValueError(f'its data ends at byte {offset}, or has a wrong checksum')
        return counts

    def _add_part(self, part: _Stretch, in_run: bool) -> None:
        """Add a chunk or, if `in_run` is set, a message. A message extends an adjacent run."""
        last = self._parts[-1] if self._parts and in_run else part
        follows = last.offset not in self._after and last.offset + last.size == part.offset
        if follows and self._data[last.offset] == Opcode.MESSAGE and last.size < _LONGEST_RUN:
            start, end = min(last.start, part.start), max(last.end, part.end)
            self._parts[-1] = _Stretch(start, end, last.offset, last.size + part.size)
        else:
            self._parts.append(part)

    def _in_order(self, first: int, last: int) -> Iterator[Message]:
        waiting: list[tuple[int, int, Message]] = []
        number = cost = 0
        most = _MOST_WAITING * self._limits.max_unpacked
        budget = self._limits.for_file(len(self._data))
        chosen = [part for part in self._parts if part.end >= first and part.start <= last]
        for position, part in enumerate(chosen):
            while waiting and waiting[0][0] < part.start:
                message = heapq.heappop(waiting)[2]
                cost -= len(message.data) + _MESSAGE_COST
                yield message
            records = self._records_of(part)
            budget -= len(records)
            self._check(budget >= 0, 'its chunks together', 'max_unpacked_file')
            found = [each for each in mcap.messages_in(records) if first <= each.stamp <= last]
            if not waiting and (part is chosen[-1] or part.end < chosen[position + 1].start):
                found.sort(key=_stamp)
                yield from found
                continue
            for message in found:
                number += 1
                cost += len(message.data) + _MESSAGE_COST
                heapq.heappush(waiting, (message.stamp, number, message))
            self._check(cost <= most, 'messages that overlap in time', 'max_unpacked')
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _records_of(self, part: _Stretch) -> Bytes:
        begin = part.offset + mcap.RECORD_HEADER.size
        if begin > self._end:
            raise ValueError(f'its index points to byte {part.offset}, beyond its messages')
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, part.offset)
        if opcode == Opcode.MESSAGE:
            return self._data[part.offset : part.offset + part.size]
        if opcode != Opcode.CHUNK:
            raise ValueError(f'its index points to byte {part.offset}, where no chunk begins')
        return self._unpacked(self._data[begin : begin + size])

    def _unpacked(self, body: Bytes) -> Bytes:
        head = mcap.parse_chunk_head(body)
        self._check(head.uncompressed <= self._limits.max_unpacked, 'a chunk', 'max_unpacked')
        packed = body[head.begin : head.begin + head.packed]
        records, whole = mcap.unpack(head, packed, self._limits.max_unpacked)
        if not whole:
            raise ValueError('the size or checksum of a chunk is wrong')
        return records

    def _check(self, within: bool, subject: str, limit: str) -> None:
        if not within:
            most = getattr(self._limits, limit)
            raise ValueError(
                f'{subject} would decompress to more than {limit} = {most} bytes; raise {limit}'
            )
