# SPDX-License-Identifier: Apache-2.0
"""Writer of MCAP files. A file stays readable if the writer is killed."""

from __future__ import annotations

import os
import struct
import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sized
from io import BytesIO
from pathlib import Path
from zlib import crc32

from soliton_linkage_nodes.bags.metadata import suite_version
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Opcode, Schema
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_LARGEST_CHUNK = 2**20
"""Size above which a chunk is written to the file [B]. Sensitivity: at a larger size, a damaged
byte causes the loss of more messages; at a smaller size, the file is larger."""


class McapWriter:
    """Writer of an MCAP file that consists of chunks with checksums.

    The writer repeats the definitions of all topics at intervals, so that messages stay readable
    if another part of the file is lost. Every chunk contains a message, because MCAP C++ before
    2.0.1 ignores the index if the first chunk has no message. If a write fails, the file is
    truncated to its previous length, and OSError is raised.

    Added messages are pending until their chunk is written to the file. `counts` maps topic
    numbers to numbers of messages, including pending messages. `span` is the first and the last
    receive time of the written messages [ns].
    """

    def __init__(self, path: Path, codec: str = '', definitions_interval: float = 10.0) -> None:
        self.counts: Counter[int] = Counter()
        self.span: tuple[int, int] | None = None
        self._end = 0
        self._codec = codec
        self._definitions_interval = definitions_interval
        self._file = path.open('xb', buffering=0)
        self._schemas: dict[tuple[str, str, str], Schema] = {}
        self._channels: dict[int, Channel] = {}
        # Reuse the buffer and never shrink it, because allocation takes longer than writing.
        self._chunk = BytesIO()
        self._pending_definitions = bytearray()
        self._entries: defaultdict[int, list[int]] = defaultdict(list)
        self._chunk_indexes: list[bytes] = []
        self._metadata: list[tuple[int, int, str]] = []
        self._attachments: list[bytes] = []
        self._defined_at = time.monotonic()
        library = f'soliton_linkage {suite_version()}'
        header = mcap.record(Opcode.HEADER, mcap.text(mcap.PROFILE), mcap.text(library))
        self._append(mcap.MAGIC + header)

    @property
    def size(self) -> int:
        """Size of the file [B]. It includes the pending chunk, unless chunks are compressed."""
        return self._end if self._codec else self._end + self._chunk.tell()

    def add_topic(self, topic: StoredTopic) -> None:
        """Add a topic. A topic must be added before its messages."""
        key = (topic.type_name, topic.definition_format, topic.definition)
        if any(key) and key not in self._schemas:
            definition = topic.definition.encode(errors='surrogateescape')
            schema = Schema(len(self._schemas) + 1, *key[:2], definition)
            self._schemas[key] = schema
            self._define(mcap.schema_record(schema))
        channel = mcap.channel_of(topic, self._schemas[key].id if any(key) else 0)
        self._channels[channel.id] = channel
        self.counts[channel.id] = 0
        self._define(mcap.channel_record(channel))

    def write(
        self, number: int, stamp: int, data: bytes, published: int | None = None, sequence: int = 0
    ) -> None:
        """Add a message that was received at `stamp` and published at `published` [ns]."""
        self._entries[number] += (stamp, self._chunk.tell())
        self._chunk.write(mcap.message_head(number, stamp, len(data), published, sequence))
        self._chunk.write(data)
        self.counts[number] += 1
        if self._chunk.tell() > _LARGEST_CHUNK:
            self.flush()

    def flush(self) -> None:
        """Pass pending messages to the operating system, so that a killed process loses none."""
        if not self._entries:
            if self._pending_definitions:
                self._append(self._pending_definitions)
                self._pending_definitions.clear()
            return
        with self._chunk.getbuffer() as buffer, buffer[: self._chunk.tell()] as records:
            self._append_chunk(records)
        self._pending_definitions.clear()
        self._begin_chunk()

    def _define(self, definition: bytes) -> None:
        self._chunk.write(definition)
        self._pending_definitions += definition

    def _append_chunk(self, records: memoryview) -> None:
        stamps = [stamp for entries in self._entries.values() for stamp in entries[::2]]
        start, end = min(stamps), max(stamps)
        head, packed = mcap.chunk_record(records, start, end, self._codec)
        length = len(head) + len(packed)
        indexes, offsets = bytearray(), bytearray()
        for number, entries in self._entries.items():
            offsets += struct.pack('<HQ', number, self._end + length + len(indexes))
            indexes += mcap.message_index_record(number, entries)
        index = mcap.record(
            Opcode.CHUNK_INDEX,
            struct.pack('<QQQQ', start, end, self._end, length),
            mcap.sized(bytes(offsets)),
            struct.pack('<Q', len(indexes)),
            mcap.text(self._codec),
            struct.pack('<QQ', len(packed), len(records)),
        )
        self._append(head, packed, indexes)
        self._chunk_indexes.append(index)
        known = [*(self.span or ()), start, end]
        self.span = (min(known), max(known))

    def discard(self) -> None:
        """Discard the pending messages after a failed write. Subtract them from `counts`."""
        for number, entries in self._entries.items():
            self.counts[number] -= len(entries) // 2
        self._begin_chunk()

    def add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        """Write a metadata record at once. It is readable even if the file is never closed."""
        record = mcap.metadata_record(name, texts)
        self._append(record)
        self._metadata.append((self._end - len(record), len(record), name))

    def copy_record(self, opcode: int, body: mcap.Bytes) -> None:
        """Copy an MCAP record, for example an attachment, from another file without changes."""
        begin, head = self._end, mcap.RECORD_HEADER.pack(opcode, len(body))
        self._append(head, body)
        length = self._end - begin
        if opcode == Opcode.METADATA:
            self._metadata.append((begin, length, mcap.Fields(body).text()))
        elif opcode == Opcode.ATTACHMENT:
            self._attachments.append(mcap.attachment_index_record(body, begin, length))

    def close(self, metadata: str) -> None:
        """Write the pending messages, the metadata of the bag and the index. Close the file."""
        self.flush()
        self.add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._append(mcap.record(Opcode.DATA_END, bytes(4)) + self._summary())
        self._file.close()

    def abandon(self) -> None:
        """Close the file without an index."""
        self._file.close()

    def _begin_chunk(self) -> None:
        self._chunk.seek(0)
        self._entries.clear()
        if time.monotonic() - self._defined_at > self._definitions_interval:
            self._defined_at = time.monotonic()
            self._chunk.writelines(map(mcap.schema_record, self._schemas.values()))
            self._chunk.writelines(map(mcap.channel_record, self._channels.values()))

    def _summary(self) -> bytes:
        groups = {
            Opcode.SCHEMA: b''.join(map(mcap.schema_record, self._schemas.values())),
            Opcode.CHANNEL: b''.join(map(mcap.channel_record, self._channels.values())),
            Opcode.CHUNK_INDEX: b''.join(self._chunk_indexes),
            Opcode.ATTACHMENT_INDEX: b''.join(self._attachments),
            Opcode.METADATA_INDEX: b''.join(
                mcap.record(Opcode.METADATA_INDEX, struct.pack('<QQ', *position), mcap.text(name))
                for *position, name in self._metadata
            ),
            Opcode.STATISTICS: self._statistics(),
        }
        start = offset = self._end + mcap.RECORD_HEADER.size + 4
        offsets = bytearray()
        for opcode, group in groups.items():
            if group:
                position = struct.pack('<BQQ', opcode, offset, len(group))
                offsets += mcap.record(Opcode.SUMMARY_OFFSET, position)
            offset += len(group)
        body = b''.join(groups.values()) + bytes(offsets)
        head = mcap.RECORD_HEADER.pack(Opcode.FOOTER, 20) + struct.pack('<QQ', start, offset)
        return body + head + struct.pack('<I', crc32(body + head)) + mcap.MAGIC

    def _statistics(self) -> bytes:
        counts = b''.join(struct.pack('<HQ', number, n) for number, n in self.counts.items())
        held: list[Sized] = [self._schemas, self._channels, self._attachments, self._metadata]
        numbers = map(len, [*held, self._chunk_indexes])
        head = struct.pack('<QHIIII', sum(self.counts.values()), *numbers)
        span = struct.pack('<QQ', *(self.span or (0, 0)))
        return mcap.record(Opcode.STATISTICS, head, span, mcap.sized(counts))

    def _append(self, *parts: bytes | bytearray | memoryview) -> None:
        begin, size = self._end, sum(map(len, parts))
        try:
            written = os.writev(self._file.fileno(), parts)
            if written < size:
                rest = memoryview(b''.join(parts))[written:]
                while rest:
                    rest = rest[self._file.write(rest) :]
        except OSError:
            self._file.truncate(begin)
            self._file.seek(begin)
            raise
        self._end = begin + size
