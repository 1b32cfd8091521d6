# SPDX-License-Identifier: Apache-2.0
"""An MCAP file that grows by whole chunks, so that it can be read however its writer ended."""

from __future__ import annotations

import os
import struct
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from zlib import crc32

from soliton_linkage_nodes.bags.metadata import suite_version
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Channel, Opcode, Schema
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

_LARGEST_CHUNK = 2**20
"""Size from which on a chunk is written [B]: a damaged byte costs a chunk, and of smaller ones
the heads and indexes count. The format's own writers take 768 KiB to 4 MiB."""


class McapWriter:
    """Writes chunks that carry checksums, and tells the definitions again every ten seconds.

    Whatever part of the file is lost, the messages in the rest can thus be understood. Every
    chunk holds a message: readers of MCAP C++ before 2.0.1 take a file whose first chunk has
    none for one without index. Definitions wait for the next chunk with a message, and those of
    topics that are silent so far also stand by themselves, before it. Where the disk refuses, the
    file is cut back to its last whole chunk.

    `counts` holds the messages of each topic by its number, `span` the stamps of the first and
    the last [ns]. Methods raise OSError if the disk refuses.
    """

    def __init__(self, path: Path, codec: str = '', definitions_interval: float = 10.0) -> None:
        """Create the file; codec is '' or 'zstd', the interval of definitions in seconds."""
        self.counts: Counter[int] = Counter()
        self.span: tuple[int, int] | None = None
        self._end = 0
        self._codec = codec
        self._definitions_interval = definitions_interval
        self._file = path.open('xb', buffering=0)
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        # It is overwritten from its beginning, never shrunk: new memory takes longer than writing.
        self._chunk = BytesIO()
        self._untold = bytearray()
        self._places: defaultdict[int, list[int]] = defaultdict(list)
        self._chunk_indexes: list[bytes] = []
        self._metadata: list[tuple[int, int, str]] = []
        self._told_at = time.monotonic()
        library = f'soliton_linkage {suite_version()}'
        header = mcap.record(Opcode.HEADER, mcap.text(mcap.PROFILE), mcap.text(library))
        self._append(mcap.MAGIC + header)

    @property
    def size(self) -> int:
        """How many bytes the file takes with those that wait, unless these will be compressed."""
        return self._end if self._codec else self._end + self._chunk.tell()

    def add_topic(self, topic: StoredTopic) -> None:
        """Begin to store a topic."""
        schema = self._schemas.get(topic.type_name)
        if schema is None:
            schema = Schema(
                len(self._schemas) + 1,
                topic.type_name,
                topic.definition_format,
                topic.definition.encode(),
            )
            self._schemas[topic.type_name] = schema
            self._define(mcap.schema_record(schema))
        about = {'offered_qos_profiles': topic.profiles, 'topic_type_hash': topic.digest}
        channel = Channel(topic.number, schema.id, topic.name, topic.serialization, about)
        self._channels[channel.id] = channel
        self.counts[channel.id] = 0
        self._define(mcap.channel_record(channel))

    def write(self, number: int, stamp: int, serialized: bytes) -> None:
        """Store a message of a topic."""
        self._places[number] += (stamp, self._chunk.tell())
        self._chunk.write(mcap.message_head(number, stamp, len(serialized)))
        self._chunk.write(serialized)
        self.counts[number] += 1
        if self._chunk.tell() > _LARGEST_CHUNK:
            self.flush()

    def flush(self) -> None:
        """Hand all messages to the system, which keeps them if this process is killed."""
        if not self._places:
            if self._untold:
                self._append(self._untold)
                self._untold.clear()
            return
        with self._chunk.getbuffer() as buffer, buffer[: self._chunk.tell()] as records:
            self._append_chunk(records)
        self._untold.clear()
        self._begin_chunk()

    def _define(self, definition: bytes) -> None:
        self._chunk.write(definition)
        self._untold += definition

    def _append_chunk(self, records: memoryview) -> None:
        stamps = [stamp for places in self._places.values() for stamp in places[::2]]
        start, end = min(stamps), max(stamps)
        head, packed = mcap.chunk_record(records, start, end, self._codec)
        length = len(head) + len(packed)
        indexes, offsets = bytearray(), bytearray()
        for number, places in self._places.items():
            place = self._end + length + len(indexes)
            offsets += struct.pack('<HQ', number, place)
            indexes += mcap.message_index_record(number, places)
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
        """Forget what the disk refused."""
        for number, places in self._places.items():
            self.counts[number] -= len(places) // 2
        self._begin_chunk()

    def note(self, texts: Mapping[str, str]) -> None:
        """Keep texts at this place of the file."""
        self._add_metadata(mcap.NOTES, texts)

    def close(self, metadata: str) -> None:
        """Write what is left, the bag's metadata and the index, and end the file."""
        self.flush()
        self._add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._append(mcap.record(Opcode.DATA_END, bytes(4)) + self._summary())
        self._file.close()

    def abandon(self) -> None:
        """End the file as it is."""
        self._file.close()

    def _begin_chunk(self) -> None:
        self._chunk.seek(0)
        self._places.clear()
        if time.monotonic() - self._told_at > self._definitions_interval:
            self._told_at = time.monotonic()
            self._chunk.writelines(map(mcap.schema_record, self._schemas.values()))
            self._chunk.writelines(map(mcap.channel_record, self._channels.values()))

    def _add_metadata(self, name: str, texts: Mapping[str, str]) -> None:
        record = mcap.metadata_record(name, texts)
        self._append(record)
        self._metadata.append((self._end - len(record), len(record), name))

    def _summary(self) -> bytes:
        """Repeat the definitions, say where everything is, and end the file."""
        groups = {
            Opcode.SCHEMA: b''.join(map(mcap.schema_record, self._schemas.values())),
            Opcode.CHANNEL: b''.join(map(mcap.channel_record, self._channels.values())),
            Opcode.CHUNK_INDEX: b''.join(self._chunk_indexes),
            Opcode.METADATA_INDEX: b''.join(
                mcap.record(Opcode.METADATA_INDEX, struct.pack('<QQ', *where), mcap.text(name))
                for *where, name in self._metadata
            ),
            Opcode.STATISTICS: self._statistics(),
        }
        start = place = self._end + mcap.RECORD_HEADER.size + 4
        offsets = bytearray()
        for opcode, group in groups.items():
            if group:
                where = struct.pack('<BQQ', opcode, place, len(group))
                offsets += mcap.record(Opcode.SUMMARY_OFFSET, where)
            place += len(group)
        body = b''.join(groups.values()) + bytes(offsets)
        head = mcap.RECORD_HEADER.pack(Opcode.FOOTER, 20) + struct.pack('<QQ', start, place)
        return body + head + struct.pack('<I', crc32(body + head)) + mcap.MAGIC

    def _statistics(self) -> bytes:
        counts = b''.join(struct.pack('<HQ', number, n) for number, n in self.counts.items())
        head = struct.pack(
            '<QHIIII',
            sum(self.counts.values()),
            len(self._schemas),
            len(self._channels),
            0,
            len(self._metadata),
            len(self._chunk_indexes),
        )
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
