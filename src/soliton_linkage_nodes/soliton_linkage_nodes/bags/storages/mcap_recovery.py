# SPDX-License-Identifier: Apache-2.0
"""Recovery of all intact messages from a truncated or damaged MCAP file."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple
from zlib import crc32

from soliton_linkage_nodes.bags.guards import map_file, release_pages
from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Bytes, ChunkHead, Opcode
from soliton_linkage_nodes.bags.storages.storage import LAST_STAMP, Message, RecoveredFile
from soliton_linkage_nodes.bags.stored_topic import completed


class _Chunk(NamedTuple):
    """Chunk of a file. Its record begins at `offset`, and the body of the record at `begin` [B].

    `cut` is whether the file ends within the chunk. `rejected` describes an exceeded limit.
    """

    offset: int
    begin: int
    head: ChunkHead
    cut: bool = False
    rejected: str = ''


class _Run(NamedTuple):
    """Messages outside of chunks in the bytes [begin, end).

    They are `doubtful` if they directly follow damaged bytes.
    """

    begin: int
    end: int
    doubtful: bool


class RecoveredMcap(RecoveredFile):
    """Recovery of the intact messages and the topics of an MCAP file.

    After damaged bytes, the scan continues at the next bytes that look like the head of a record.
    If the file ends within a chunk, all complete messages in this chunk are recovered, although
    its checksum cannot be checked. A message in any other chunk is doubtful if the checksum of the
    chunk is wrong. If the file has chunks, a message outside of chunks is also doubtful if it
    directly follows damaged bytes. Doubtful messages are recovered only if `doubtful` is set.
    """

    def _scan(self, path: Path) -> None:
        self._found: list[_Chunk | _Run] = []
        self._schemas: dict[int, mcap.Schema] = {}
        self._channels: dict[int, mcap.Channel] = {}
        self._unverified_schemas: dict[int, mcap.Schema] = {}
        self._unverified_channels: dict[int, mcap.Channel] = {}
        self._footer = False
        self._after_damage = False
        self._sizes: dict[int, int] = {}
        self._data = map_file(path)
        self._budget = self._limits.for_file(len(self._data))
        self._scan_records()
        schemas = self._unverified_schemas | self._schemas
        channels = (self._unverified_channels | self._channels).items()
        self.topics = {n: completed(mcap.topic_of(channel, schemas)) for n, channel in channels}

    def _messages(self) -> Iterator[Message]:
        chunked = any(isinstance(part, _Chunk) for part in self._found)
        for part in self._found:
            if isinstance(part, _Chunk):
                yield from self._messages_of(part)
                continue
            messages = self._counted(self._data[part.begin : part.end])
            if not (part.doubtful and chunked) or self._doubtful:
                yield from messages
                continue
            count = sum(1 for _ in messages)
            self.unverified -= count
            self.report_damage(f'{count} messages at byte {part.begin} are left out', count)

    def _messages_of(self, chunk: _Chunk) -> Iterator[Message]:
        if chunk.rejected:
            self.report_damage(f'the chunk at byte {chunk.offset} {chunk.rejected}')
            return
        records, whole = mcap.unpack(chunk.head, self._packed(chunk), self._limits.max_unpacked)
        if whole and chunk.head.crc:
            yield from mcap.messages_in(records, strict=False)
        elif whole or chunk.cut or self._doubtful:
            yield from self._counted(records)
        if not whole and not chunk.cut:
            messages = mcap.messages_in(records, strict=False)
            count = 0 if self._doubtful else sum(1 for _ in messages)
            where = f'the chunk at byte {chunk.offset} has a wrong checksum'
            self.report_damage(f'{where}: {count} messages left out', count)

    def _counted(self, records: Bytes) -> Iterator[Message]:
        for message in mcap.messages_in(records, strict=False):
            self.unverified += 1
            yield message

    def _scan_records(self) -> None:
        offset, size = len(mcap.MAGIC), len(self._data)
        if bytes(self._data[:offset]) != mcap.MAGIC:
            self.report_damage('it does not begin like an MCAP file')
            offset = 0
        while offset < size and bytes(self._data[offset : offset + 9]) != mcap.MAGIC:
            after = self._take(offset)
            if after is None:
                after = next_record(self._data, offset + 1)
                self.report_damage(f'bytes {offset} to {after} are damaged')
                self._after_damage = True
            offset = after
        if not self._footer:
            self.report_damage('it was not finished: there is no index')
        elif bytes(self._data[offset:]) != mcap.MAGIC:
            self.report_damage('it does not end like an MCAP file')

    def _take(self, offset: int) -> int | None:
        """Process the record at `offset`. Return the offset of the next record.

        If the record at `offset` is invalid, return None.
        """
        if len(self._data) - offset < mcap.RECORD_HEADER.size:
            return None
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, offset)
        begin = offset + mcap.RECORD_HEADER.size
        if opcode == Opcode.CHUNK:
            return self._take_chunk(offset, begin, size)
        end = int(begin + size)
        if end > len(self._data):
            return None
        if opcode == Opcode.MESSAGE:
            return self._take_message(offset, begin, size)
        body = self._data[begin:end]
        if opcode not in KINDS:
            if not _may_follow(self._data, end) or self._is_changed(opcode, body):
                return None
            self.records.append((opcode, body))
            return end
        try:
            # If the length of this record is wrong, the records after it would be skipped.
            if mcap.extra_bytes(opcode, body) and not _may_follow(self._data, end):
                return None
            mcap.define(opcode, body, self._unverified_schemas, self._unverified_channels)
            self._take_file_record(offset, opcode, body)
        except ValueError:
            return None
        self._after_damage &= opcode in _IN_CHUNKS
        return end

    def _take_chunk(self, offset: int, begin: int, size: int) -> int | None:
        try:
            head = mcap.parse_chunk_head(self._data[begin : begin + LARGEST_CHUNK_HEAD])
        except ValueError:
            return None
        if head.size == size and begin + size > len(self._data):
            self.report_damage(f'the file ends within the chunk at byte {offset}')
            chunk = _Chunk(offset, begin, head, cut=True)
            self._add_chunk(chunk, self._unpack(chunk)[0])
            return len(self._data)
        # The head and the record state the length of the chunk. If the lengths differ, the
        # checksum decides which length is right.
        lengths = {head.packed, size - head.begin}
        for packed in lengths:
            chunk = _Chunk(offset, begin, replace(head, packed=packed))
            if not 0 <= packed <= len(self._data) - begin - head.begin:
                continue
            records, whole = self._unpack(chunk)
            if whole:
                self._add_chunk(chunk, records)
                end = int(begin + max(size, chunk.head.size))
                return end if _may_follow(self._data, end) else begin + chunk.head.size
        rejected = self._rejection(head)
        if len(lengths) > 1 and not rejected:
            return None
        self._found.append(_Chunk(offset, begin, head, rejected=rejected))
        return int(begin + size)

    def _rejection(self, head: ChunkHead) -> str:
        limits = self._limits
        if head.uncompressed > limits.max_unpacked:
            return f'exceeds max_unpacked = {limits.max_unpacked} bytes decompressed: left out'
        if self._budget <= 0:
            most = limits.for_file(len(self._data))
            return f'exceeds max_unpacked_file = {most} bytes in all: left out'
        return ''

    def _unpack(self, chunk: _Chunk) -> tuple[Bytes, bool]:
        if self._budget <= 0:
            return b'', False
        records, whole = mcap.unpack(chunk.head, self._packed(chunk), self._limits.max_unpacked)
        self._budget -= len(records)
        return records, whole

    def _add_chunk(self, chunk: _Chunk, records: Bytes) -> None:
        self._found.append(chunk)
        self._after_damage = False
        for _, opcode, body in mcap.records_in(records):
            with suppress(ValueError):
                mcap.define(opcode, body, self._schemas, self._channels)

    def _packed(self, chunk: _Chunk) -> Bytes:
        begin = chunk.begin + chunk.head.begin
        return self._data[begin : begin + chunk.head.packed]

    def _take_message(self, offset: int, begin: int, size: int) -> int | None:
        if size < mcap.MESSAGE_HEADER.size:
            return None
        end = begin + size
        channel = struct.unpack_from('<H', self._data, begin)[0]
        known = channel in self._unverified_channels or channel in self._channels
        # The length counts as correct if a record follows the message, or if the previous message
        # of this channel had the same length.
        following = self._data[end : end + 1]
        repeated = self._sizes.get(channel) == size
        expected = repeated or not following or following[0] in KINDS
        fits = expected or _may_follow(self._data, end)
        if not known or not fits or not (repeated or _is_message(self._data[begin:end])):
            return None
        self._sizes[channel] = size
        last = self._found[-1] if self._found else None
        if isinstance(last, _Run) and last.end == offset:
            self._found[-1] = last._replace(end=end)
        else:
            self._found.append(_Run(offset, end, self._after_damage))
        return end

    def _is_changed(self, opcode: int, body: Bytes) -> bool:
        flipped = [opcode ^ 1 << bit for bit in range(8)]
        with suppress(ValueError):
            if Opcode.CHUNK in flipped:
                return mcap.parse_chunk_head(body[:LARGEST_CHUNK_HEAD]).size == len(body)
            if Opcode.MESSAGE in flipped:
                message = mcap.parse_message(body)
                known = {**self._unverified_channels, **self._channels}
                return message.topic in known and message.stamp <= LAST_STAMP
        return False

    def _take_file_record(self, offset: int, opcode: int, body: Bytes) -> None:
        if opcode == Opcode.METADATA:
            fields = mcap.Fields(body)
            name, texts = fields.text(), fields.text_map()
            if name == mcap.CUSTOM_DATA:
                self.custom_data.update(texts)
            elif name == 'rosbag2':
                self.custom_data.update(custom_data_of(texts.get('serialized_metadata', '')))
            else:
                self.records.append((opcode, body))
        elif opcode == Opcode.DATA_END:
            if not (self.damage or mcap.data_is_intact(self._data, offset)):
                self.report_damage('its data section has a wrong checksum')
        elif opcode == Opcode.ATTACHMENT:
            intact = mcap.attachment_is_intact(body)
            if not intact:
                self.report_damage(f'the attachment at byte {offset} has a wrong checksum')
            if intact or self._doubtful:
                self.records.append((opcode, body))
        elif opcode == Opcode.STATISTICS:
            self.stated = mcap.Fields(body).number(8)
        elif opcode == Opcode.FOOTER:
            fields = mcap.Fields(body)
            start, _, checksum = fields.number(8), fields.number(8), fields.number(4)
            self._footer = True
            # If the file has no summary, the checksum covers only the footer.
            covered = self._data[start or offset : offset + mcap.RECORD_HEADER.size + 16]
            if checksum and crc32(covered) != checksum:
                self.stated = 0
                self.report_damage('its index has a wrong checksum')


KINDS: Final = range(Opcode.HEADER, Opcode.DATA_END + 1)
"""Opcodes of the MCAP format. Other opcodes are allowed, and readers skip their records."""
_IN_CHUNKS: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
LARGEST_CHUNK_HEAD: Final = 64
"""Largest size of the head of a chunk [B]. The head has 40 bytes of numbers and a codec name."""
_CONFUSABLE: Final = [kind for kind in KINDS if (kind ^ Opcode.MESSAGE).bit_count() == 1]
"""Opcodes that a flipped bit changes to the opcode of a message."""
_HEAD = re.compile(rb'[\x01-\x0f](?=.{5}\x00\x00\x00)', re.DOTALL)
"""Pattern of the head of a record. It has an opcode and a length below 2^40 bytes."""
_SHORTEST, _LONGEST = 4, 2**40
"""Smallest and largest plausible size of the body of a record [B]."""
_WINDOW = 2**26
"""Number of searched bytes after which the memory of the mapped file is released [B]."""


def _may_follow(data: Bytes, offset: int) -> bool:
    """Return whether a record, the magic bytes or the end of the file may follow at `offset`."""
    rest = data[offset : offset + mcap.RECORD_HEADER.size]
    if len(rest) < mcap.RECORD_HEADER.size:
        return not rest or bool(rest[0])
    opcode, size = mcap.RECORD_HEADER.unpack(rest)
    shortest = _SHORTEST if opcode in KINDS else 0
    return bool(opcode) and shortest <= int(size) < _LONGEST


def _is_message(body: Bytes) -> bool:
    """Return whether a body belongs to a message, not to a record with a changed opcode."""
    *_, published = mcap.MESSAGE_HEADER.unpack_from(body)
    for opcode in _CONFUSABLE:
        with suppress(ValueError):
            # The number of a message can equal the length of an index. A message index then has
            # an offset in the place of the stamp.
            if not mcap.extra_bytes(opcode, body):
                return bool(opcode == Opcode.MESSAGE_INDEX and published >= _LONGEST)
    return True


def next_record(data: memoryview, begin: int) -> int:
    """Return the offset of the next bytes that look like a record, or the size of the file."""
    for start in range(begin, len(data), _WINDOW):
        end = min(start + _WINDOW, len(data))
        window = data[start : end + mcap.RECORD_HEADER.size]
        for match in _HEAD.finditer(window, 0):
            offset = start + match.start()
            if offset < end and _is_record(data, offset):
                return offset
        if end < len(data):
            release_pages(data)
    return len(data)


def _is_record(data: Bytes, offset: int) -> bool:
    """Return whether a valid record begins at `offset`. Of a chunk, only the head is checked."""
    opcode, size = mcap.RECORD_HEADER.unpack_from(data, offset)
    begin = offset + mcap.RECORD_HEADER.size
    end = begin + size
    with suppress(ValueError):
        if opcode == Opcode.CHUNK:
            head = mcap.parse_chunk_head(data[begin : begin + LARGEST_CHUNK_HEAD])
            return head.size == int(size)
        following = data[end : end + 1]
        if end > len(data) or (following and following[0] not in (*KINDS, mcap.MAGIC[0])):
            return False
        if opcode == Opcode.MESSAGE:
            return int(size) >= mcap.MESSAGE_HEADER.size
        return not mcap.extra_bytes(opcode, data[begin:end])
    return False
