# SPDX-License-Identifier: Apache-2.0
"""Rows of a sqlite3 file read from its pages alone (https://sqlite.org/fileformat2.html)."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator

from soliton_linkage_nodes.bags.guards.files import forget

Value = int | float | str | bytes | None
Row = tuple[int, tuple[Value, ...]]

MAGIC = b'SQLite format 3\x00'
_FILE_HEADER = 100
"""Bytes of the header that the first page begins with."""
_LEAF_OF_TABLE = 0x0D
"""First byte of a page that holds rows."""
_PAGE_HEADER = 8
"""Bytes of the header of such a page."""
_DEFAULT_PAGE = 4096
"""Size of a page where nobody asked for another [B]."""
_PAGE_SIZES = (512, 1024, 2048, 4096, 8192, 16384, 32768, 65536)
"""Sizes that a page can have [B]."""
_MOST_RESERVED = 32
"""Bytes that an extension of sqlite3 may reserve at the end of a page."""
_LET_GO_AFTER = 4096
"""Pages that are read before the memory that holds them is let go of."""
_LOOKED_AT = 2**20
"""Bytes of a file whose rows tell the size of its pages."""
_SIZES = {0: 0, 1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 7: 8, 8: 0, 9: 0}
"""Bytes of a value by its serial type, of those whose size is fixed."""


class DamagedRow(ValueError):
    """A row that cannot be put together."""


class SqlitePages:
    """The rows of all tables, whichever of the pages that lead to them are lost.

    Every page that is a leaf of a table is read by itself, with the pages that its long rows go
    on in. `damaged` counts the rows, and the pages, that could not be read.
    """

    def __init__(self, data: bytes | mmap.mmap) -> None:
        """Look at the header of a file; one whose page size does not fit the pages is mended."""
        self.damaged = 0
        self._data = data
        size = struct.unpack_from('>H', data, 16)[0] if len(data) >= _FILE_HEADER else 0
        size = 65536 if size == 1 else size
        reserved = data[20] if len(data) >= _FILE_HEADER and data[20] <= _MOST_RESERVED else 0
        told = [(size, reserved)] if size in _PAGE_SIZES else []
        layouts = [*told, (_DEFAULT_PAGE, 0), *((each, 0) for each in _PAGE_SIZES)]
        self._size, self._usable = 0, 0
        best = -1
        for size, reserved in dict.fromkeys(layouts):
            self._lay_out(size, reserved)
            readable = self._readable()
            if readable > best:
                best, chosen = readable, (size, reserved)
            if readable and not self.damaged and len(data) == size * _told_pages(data):
                break
        self._lay_out(*chosen)
        self.damaged = 0

    def rows(self) -> Iterator[Row]:
        """Yield number and values of each row that is whole, in the order of the pages."""
        for page in range(-(-len(self._data) // self._size)):
            if not page % _LET_GO_AFTER and isinstance(self._data, mmap.mmap):
                forget(self._data)
            yield from self._rows_on(page)

    def _lay_out(self, size: int, reserved: int) -> None:
        self._size, self._usable = size, size - reserved

    def _readable(self) -> int:
        """Rows on some pages, evenly spread: there are most with the true size of a page."""
        pages = -(-len(self._data) // self._size)
        every = max(1, pages * self._size // _LOOKED_AT)
        self.damaged = 0
        return sum(1 for page in range(0, pages, every) for _ in self._rows_on(page))

    def _rows_on(self, page: int) -> Iterator[Row]:
        begin = page * self._size
        header = begin + (_FILE_HEADER if page == 0 else 0)
        if self._data[header : header + 1] != bytes([_LEAF_OF_TABLE]):
            return
        pointers = header + _PAGE_HEADER
        if pointers > len(self._data):
            return
        count = struct.unpack_from('>H', self._data, header + 3)[0]
        most = (begin + self._size - pointers) // 2
        for number in range(min(count, most)):
            try:
                (offset,) = struct.unpack('>H', self._bytes(pointers + 2 * number, 2))
                yield self._row(begin + offset, begin + self._size)
            except (DamagedRow, UnicodeDecodeError, struct.error):
                self.damaged += 1

    def _row(self, place: int, end: int) -> Row:
        size, place = self._variable(place)
        number, place = self._variable(place)
        local = self._local(size)
        if size > len(self._data) or place + local > end:
            raise DamagedRow
        payload = self._bytes(place, local)
        if local < size:
            payload += self._overflow(place + local, size - local)
        return _signed(number), _values(payload)

    def _local(self, size: int) -> int:
        """How much of a row stands in its own page."""
        most = self._usable - 35
        if size <= most:
            return size
        least = (self._usable - 12) * 32 // 255 - 23
        local = least + (size - least) % (self._usable - 4)
        return local if local <= most else least

    def _overflow(self, pointer: int, size: int) -> bytes:
        pieces = bytearray()
        visited: set[int] = set()
        (page,) = struct.unpack('>I', self._bytes(pointer, 4))
        while len(pieces) < size:
            if page == 0 or page in visited:
                raise DamagedRow
            visited.add(page)
            begin = (page - 1) * self._size
            piece = min(size - len(pieces), self._usable - 4)
            pieces += self._bytes(begin + 4, piece)
            (page,) = struct.unpack('>I', self._bytes(begin, 4))
        if page != 0:
            raise DamagedRow
        return bytes(pieces)

    def _bytes(self, begin: int, size: int) -> bytes:
        taken = self._data[begin : begin + size]
        if begin < 0 or len(taken) != size:
            raise DamagedRow
        return taken

    def _variable(self, place: int) -> tuple[int, int]:
        return _variable(self._bytes(place, min(9, len(self._data) - place)), place)


def _told_pages(data: bytes | mmap.mmap) -> int:
    """How many pages the header says that there are."""
    return int(struct.unpack_from('>I', data, 28)[0])


def _variable(data: bytes, place: int) -> tuple[int, int]:
    """A number of variable length, and the place after it."""
    value = 0
    for count, byte in enumerate(data[:9]):
        if count == 8:
            return (value << 8) | byte, place + 9
        value = (value << 7) | (byte & 0x7F)
        if byte < 0x80:
            return value, place + count + 1
    raise DamagedRow


def _signed(value: int) -> int:
    return value - 2**64 if value >= 2**63 else value


def _values(payload: bytes) -> tuple[Value, ...]:
    """Values of a row, which fill its bytes to the last."""
    head, place = _variable(payload[:9], 0)
    if head > len(payload):
        raise DamagedRow
    kinds = []
    while place < head:
        kind, place = _variable(payload[place : place + 9], place)
        kinds.append(kind)
    values: list[Value] = []
    place = head
    for kind in kinds:
        size = _SIZES[kind] if kind in _SIZES else (kind - 12) // 2
        if kind in (10, 11) or place + size > len(payload):
            raise DamagedRow
        values.append(_value(kind, payload[place : place + size]))
        place += size
    if place != len(payload):
        raise DamagedRow
    return tuple(values)


def _value(kind: int, data: bytes) -> Value:
    if kind == 0:
        return None
    if kind == 7:
        return float(struct.unpack('>d', data)[0])
    if kind in (8, 9):
        return kind - 8
    if kind < 7:
        return int.from_bytes(data, 'big', signed=True)
    return data.decode() if kind % 2 else data
