# SPDX-License-Identifier: Apache-2.0
"""Serialization of messages without rclpy's extra bytes, which strict readers reject."""

from __future__ import annotations

import re
from typing import Any

from rclpy.serialization import serialize_message

_ENCAPSULATION_BYTES = 4
"""Size of the encapsulation header [B]."""
_SIZES = {
    **dict.fromkeys(('boolean', 'octet', 'char', 'uint8', 'int8'), 1),
    **dict.fromkeys(('uint16', 'int16'), 2),
    **dict.fromkeys(('uint32', 'int32', 'float'), 4),
    **dict.fromkeys(('uint64', 'int64', 'double'), 8),
}
"""Size and alignment of each primitive type [B]."""
_SEQUENCE = re.compile(r'sequence<(.*?)(?:, \d+)?>')
_ARRAY = re.compile(r'(.*)\[\d+\]')


def serialize(message: Any) -> bytes:
    """Return the CDR bytes of a message, without bytes after its end."""
    serialized = bytes(serialize_message(message))
    try:
        # A message without fields has one byte.
        return serialized[: _ENCAPSULATION_BYTES + max(_end(message, 0), 1)]
    except NotImplementedError:
        return serialized


def _end(message: Any, begin: int) -> int:
    """Return the position of the end of a message that begins at `begin` [B].

    Positions are counted from the end of the encapsulation header.
    """
    for name, kind in message.get_fields_and_field_types().items():
        begin = _end_of_field(getattr(message, name), kind, begin)
    return begin


def _end_of_field(value: Any, kind: str, begin: int) -> int:
    if size := _SIZES.get(kind):
        return _aligned(begin, size) + size
    if kind.startswith('string'):
        return _aligned(begin, 4) + 4 + len(value.encode()) + 1
    if kind.startswith('wstring'):
        raise NotImplementedError('the size of a wide character depends on the middleware')
    sequence = _SEQUENCE.fullmatch(kind)
    if sequence:
        begin = _aligned(begin, 4) + 4
    repeated = sequence or _ARRAY.fullmatch(kind)
    if not repeated:
        return _end(value, begin)
    if len(value) and (size := _SIZES.get(repeated[1])):
        return _aligned(begin, size) + size * len(value)
    for each in value:
        begin = _end_of_field(each, repeated[1], begin)
    return begin


def _aligned(begin: int, size: int) -> int:
    return begin + -begin % size
