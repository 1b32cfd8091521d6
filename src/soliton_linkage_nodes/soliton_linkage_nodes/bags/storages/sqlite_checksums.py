# SPDX-License-Identifier: Apache-2.0
"""Checksums of the messages of a sqlite3 file, in a table beside rosbag2's, which it ignores."""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Final
from zlib import crc32

TABLE: Final = 'soliton_linkage_checksums'
SCHEMA: Final = f"""
CREATE TABLE {TABLE}(first_message INTEGER PRIMARY KEY, crc32 BLOB NOT NULL);
"""
"""A row holds the checksums of messages side by side, of which it names the first, and at the end
one of its own: of a row that is damaged itself nothing is concluded."""
_NUMBERS = struct.Struct('<qqq')
_SIZE = 4
"""Bytes of a checksum."""
_OWN = struct.Struct('<I')


def checksum(number: int, topic: int, stamp: int, data: bytes) -> int:
    """Checksum (CRC-32) of all that a message is in its file, its row's number too."""
    return crc32(data, crc32(_NUMBERS.pack(number, topic, stamp)))


def packed_checksums(first: int, messages: Sequence[tuple[int, int, bytes]]) -> bytes:
    """Content of a row: of messages, told by topic, stamp [ns] and bytes."""
    checksums = [checksum(first + n, *message) for n, message in enumerate(messages)]
    content = struct.pack(f'<{len(checksums)}I', *checksums)
    return content + _OWN.pack(_own(first, content))


class Checksums:
    """Checksums that were read, by the number of the message."""

    def __init__(self, rows: Sequence[tuple[int, Any]]) -> None:
        """Take rows of the table: number of the first message, and checksums."""
        self._rows = sorted(
            (first, data[:-_SIZE])
            for first, data in rows
            if isinstance(data, bytes) and data[-_SIZE:] == _OWN.pack(_own(first, data[:-_SIZE]))
        )
        self._firsts = [first for first, _ in self._rows]
        self.last = max((first - 1 + len(data) // _SIZE for first, data in self._rows), default=0)

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._rows)

    def of(self, number: int) -> int | None:
        """Checksum of the message of a number, None where it has none."""
        place = bisect_right(self._firsts, number) - 1
        if place < 0:
            return None
        first, data = self._rows[place]
        begin = _SIZE * (number - first)
        found = data[begin : begin + _SIZE]
        return int.from_bytes(found, 'little') if len(found) == _SIZE else None


def _own(first: int, content: bytes) -> int:
    return crc32(content, crc32(_NUMBERS.pack(first, 0, len(content))))
