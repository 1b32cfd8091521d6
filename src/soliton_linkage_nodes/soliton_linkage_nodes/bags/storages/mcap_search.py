# SPDX-License-Identifier: Apache-2.0
"""Where records of an MCAP file begin after bytes that are damaged."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from soliton_linkage_nodes.bags.guards.files import forget
from soliton_linkage_nodes.bags.storages import mcap_records as mcap
from soliton_linkage_nodes.bags.storages.mcap_records import Bytes, Opcode

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
