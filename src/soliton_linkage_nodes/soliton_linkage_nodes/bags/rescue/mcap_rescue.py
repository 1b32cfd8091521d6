# SPDX-License-Identifier: Apache-2.0
"""Reads what is intact of an MCAP file that is cut short or damaged anywhere."""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

from soliton_linkage_nodes.bags.metadata import custom_data_of
from soliton_linkage_nodes.bags.read import mcap_records as mcap
from soliton_linkage_nodes.bags.read.mcap_records import Channel, ChunkHead, Opcode, Schema
from soliton_linkage_nodes.bags.record.mcap_writer import NOTES
from soliton_linkage_nodes.bags.rescue.rescued import Findings, RescuedMessage, completed
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

# A record's head: its kind and a length under 2^40.
_HEAD = re.compile(rb'(?=[\x01-\x0f].{5}\x00\x00\x00)', re.DOTALL)
_KINDS = range(Opcode.HEADER, Opcode.DATA_END + 1)
_LARGEST_HEAD = 64


@dataclass(frozen=True)
class _Chunk:
    """A chunk that was found: where its packed records are, and how they are packed."""

    place: int
    begin: int
    head: ChunkHead
    cut: bool = False


@dataclass(frozen=True)
class _Run:
    """Records side by side, among them messages that are in no chunk."""

    begin: int
    end: int


class RescuedMcap:
    """The intact messages of an MCAP file, and what is known of their topics.

    Records are taken one after the other; where one is damaged, the search goes on for the next
    head of a record that fits what follows it. A chunk counts if its checksum is right. Of a
    chunk that the file's end cuts, the whole messages before the cut count. `doubtful` lets the
    messages of chunks with wrong checksums count as well.
    """

    def __init__(self, path: Path, doubtful: bool = False) -> None:
        """Look through the file."""
        self.findings = Findings()
        self.custom_data: dict[str, str] = {}
        self._doubtful = doubtful
        self._found: list[_Chunk | _Run] = []
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._doubtful_schemas: dict[int, Schema] = {}
        self._doubtful_channels: dict[int, Channel] = {}
        self._stated: int | None = None
        self._footer = False
        self._sizes: dict[int, int] = {}
        with path.open('rb') as file:
            size = file.seek(0, 2)
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if size else b''
        self._scan()
        self._channels = {**self._doubtful_channels, **self._channels}
        self._schemas = {**self._doubtful_schemas, **self._schemas}
        self._topics = {number: self._topic(channel) for number, channel in self._channels.items()}
        self.topics: list[StoredTopic] = list(self._topics.values())

    def messages(self) -> Iterator[RescuedMessage]:
        """Yield the intact messages; `findings` is complete after the last."""
        unknown = 0
        chunked = any(isinstance(part, _Chunk) for part in self._found)
        for part in self._found:
            if isinstance(part, _Run) and chunked:
                continue
            for message in self._messages_of(part):
                topic = self._topics.get(message.channel)
                if topic is None:
                    unknown += 1
                else:
                    self.findings.messages += 1
                    yield topic, message.stamp, message.data
        if unknown:
            self._complain(f'{unknown} messages are of topics whose names are lost', unknown)
        stated = self._stated
        if stated is not None and stated > self.findings.messages + self.findings.lost:
            missing = stated - self.findings.messages - self.findings.lost
            self._complain(f'{missing} more messages are in the index than in the file', missing)

    def _messages_of(self, part: _Chunk | _Run) -> Iterator[mcap.Message]:
        if isinstance(part, _Run):
            yield from _messages_in(self._data[part.begin : part.end])
            return
        records, whole = mcap.unpack(part.head, self._packed(part))
        messages = _messages_in(records)
        if whole or part.cut or self._doubtful:
            yield from messages
        if not whole and not part.cut:
            count = 0 if self._doubtful else sum(1 for _ in messages)
            self._complain(
                f'the chunk at byte {part.place} has a wrong checksum: {count} messages left out',
                count,
            )

    def _scan(self) -> None:
        place = len(mcap.MAGIC)
        if self._data[:place] != mcap.MAGIC:
            self._complain('it does not begin as an MCAP file does')
            place = 0
        size = len(self._data)
        while place < size and not self._is_end(place):
            after = self._take(place)
            if after is None:
                after = self._next_record(place + 1)
                self._complain(f'bytes {place} to {after} are damaged')
            place = after
        if not self._footer:
            self._complain('it was not finished: there is no index')

    def _is_end(self, place: int) -> bool:
        return len(self._data) - place == len(mcap.MAGIC) and self._data[place:] == mcap.MAGIC

    def _take(self, place: int) -> int | None:
        """Note the record at a place and return where the next one begins; None for no record."""
        if len(self._data) - place < mcap.RECORD_HEADER.size:
            return None
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, place)
        begin = place + mcap.RECORD_HEADER.size
        if opcode == Opcode.CHUNK:
            return self._take_chunk(place, begin, size)
        end = begin + size
        if opcode not in _KINDS or end > len(self._data):
            return None
        if opcode == Opcode.MESSAGE:
            return self._take_message(place, begin, size)
        body = self._data[begin:end]
        try:
            self._learn(opcode, body, self._doubtful_schemas, self._doubtful_channels)
            self._learn_about_file(place, opcode, body)
        except (ValueError, struct.error):
            return None
        return int(end)

    def _take_chunk(self, place: int, begin: int, size: int) -> int | None:
        try:
            head = mcap.parse_chunk_head(self._data[begin : begin + _LARGEST_HEAD])
        except (ValueError, struct.error):
            return None
        if head.size == size and begin + size > len(self._data):
            self._complain(f'the file ends within the chunk at byte {place}')
            chunk = _Chunk(place, begin, head, cut=True)
            self._note_chunk(chunk, mcap.unpack(head, self._packed(chunk))[0])
            return len(self._data)
        # Either of the two lengths may be damaged; the checksum tells which is right.
        lengths = {size - head.begin, head.packed}
        for packed in lengths:
            chunk = _Chunk(place, begin, replace(head, packed=packed))
            if not 0 <= packed <= len(self._data) - begin - head.begin:
                continue
            records, whole = mcap.unpack(chunk.head, self._packed(chunk))
            if whole:
                self._note_chunk(chunk, records)
                return begin + chunk.head.size
        if len(lengths) > 1:
            return None
        self._found.append(_Chunk(place, begin, head))
        return int(begin + size)

    def _note_chunk(self, chunk: _Chunk, records: bytes) -> None:
        """Keep a chunk and learn what it defines."""
        self._found.append(chunk)
        for _, opcode, body in mcap.records_in(records):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                with suppress(ValueError):
                    self._learn(opcode, body, self._schemas, self._channels)

    def _packed(self, chunk: _Chunk) -> bytes:
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
        fits = not following or following[0] in _KINDS or self._sizes.get(channel) == size
        if not known or not fits:
            return None
        self._sizes[channel] = size
        last = self._found[-1] if self._found else None
        if isinstance(last, _Run) and last.end == place:
            self._found[-1] = _Run(last.begin, end)
        else:
            self._found.append(_Run(place, end))
        return end

    def _learn(
        self, opcode: int, body: bytes, schemas: dict[int, Schema], channels: dict[int, Channel]
    ) -> None:
        if opcode == Opcode.SCHEMA:
            schema = mcap.parse_schema(body)
            schema.data.decode()
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap.parse_channel(body)
            channels[channel.id] = channel

    def _learn_about_file(self, place: int, opcode: int, body: bytes) -> None:
        if opcode == Opcode.METADATA:
            name, texts = mcap.parse_metadata(body)
            if name == NOTES:
                self.custom_data.update(texts)
            elif name == 'rosbag2':
                self.custom_data.update(custom_data_of(texts.get('serialized_metadata', '')))
        elif opcode == Opcode.MESSAGE_INDEX:
            fields = mcap.Fields(body)
            fields.take(2)
            if len(fields.sized()) % 16 or fields.rest:
                raise ValueError('an index of messages has the wrong length')
        elif opcode == Opcode.STATISTICS:
            self._stated = mcap.Fields(body).number(8)
        elif opcode == Opcode.FOOTER:
            self._check_footer(place, body)

    def _check_footer(self, place: int, body: bytes) -> None:
        fields = mcap.Fields(body)
        start, _, checksum = fields.number(8), fields.number(8), fields.number(4)
        self._footer = True
        covered = self._data[start : place + mcap.RECORD_HEADER.size + 16]
        if checksum and crc32(covered) != checksum:
            self._stated = None
            self._complain('its index has a wrong checksum')

    def _next_record(self, begin: int) -> int:
        """Where the next record begins that is told from chance, or the end of the file."""
        for match in _HEAD.finditer(self._data, begin):
            place = match.start()
            if self._is_record(place):
                return place
        return len(self._data)

    def _is_record(self, place: int) -> bool:
        """Whether what is at a place has the form of a record that a file goes on with."""
        opcode, size = mcap.RECORD_HEADER.unpack_from(self._data, place)
        begin = place + mcap.RECORD_HEADER.size
        end = begin + size
        following = self._data[end : end + 1]
        if opcode == Opcode.CHUNK:
            with suppress(ValueError, struct.error):
                head = mcap.parse_chunk_head(self._data[begin : begin + _LARGEST_HEAD])
                return head.size == int(size)
            return False
        if end > len(self._data) or (following and following[0] not in (*_KINDS, mcap.MAGIC[0])):
            return False
        return _has_form(opcode, self._data[begin:end])

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

    def _complain(self, damage: str, lost: int = 0) -> None:
        self.findings.damage.append(damage)
        self.findings.lost += lost


def _messages_in(records: bytes) -> Iterator[mcap.Message]:
    for _, opcode, body in mcap.records_in(records):
        if opcode == Opcode.MESSAGE:
            with suppress(ValueError):
                yield mcap.parse_message(body)


def _has_form(opcode: int, body: bytes) -> bool:
    """Whether a record's body has the form of its kind."""
    sizes = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
    if opcode in sizes:
        return len(body) == sizes[Opcode(opcode)]
    if opcode == Opcode.MESSAGE:
        return len(body) >= mcap.MESSAGE_HEADER.size
    fields = mcap.Fields(body)
    try:
        if opcode == Opcode.MESSAGE_INDEX:
            fields.take(2)
            return len(fields.sized()) % 16 == 0 and not fields.rest
        if opcode == Opcode.SCHEMA:
            mcap.parse_schema(body)
            return True
        if opcode == Opcode.CHANNEL:
            mcap.parse_channel(body)
            return True
        if opcode == Opcode.METADATA:
            mcap.parse_metadata(body)
            return True
    except ValueError:
        return False
    return False
