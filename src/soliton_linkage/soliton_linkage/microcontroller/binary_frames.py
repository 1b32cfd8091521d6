# SPDX-License-Identifier: Apache-2.0
"""Frames in bytes: a header, the values, a CRC-32, in COBS.

The checksum is that of zlib, CRC-32/ISO-HDLC. Consistent overhead byte stuffing takes the zeros
out of a frame, so that a zero ends it: S. Cheshire and M. Baker, IEEE/ACM Transactions on
Networking 7, 159 (1999), doi:10.1109/90.769765.
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, NamedTuple

import numpy as np

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.frames import (
    CLOCK_RANGE,
    SEQUENCES,
    FrameKind,
    SerialFrame,
)

END = b'\0'
"""Of a frame."""
VERSION = 1
"""Of the layout [1]; a frame of another one is refused."""
_HEADER = struct.Struct('<cBHI')
"""Letter of the kind, version, sequence number, time [us]; the values after it are aligned."""
_CHECKSUM = struct.Struct('<I')
_LONGEST_BLOCK = 254
"""Bytes without a zero that one code byte of COBS counts, which has 255 values but zero."""


class _ValueLayout(NamedTuple):
    letter: bytes
    kind: FrameKind
    type: np.dtype[Any]


_LAYOUTS = (
    _ValueLayout(b'c', FrameKind.COUNTS, np.dtype('<i2')),
    _ValueLayout(b'C', FrameKind.COUNTS, np.dtype('<i4')),
    _ValueLayout(b'r', FrameKind.RADIANS, np.dtype('<f4')),
    _ValueLayout(b'h', FrameKind.HELLO, np.dtype('<i2')),
    _ValueLayout(b't', FrameKind.TORQUES, np.dtype('<f4')),
    _ValueLayout(b'p', FrameKind.PRESSURES, np.dtype('<f4')),
)
_OF_LETTER = {layout.letter: layout for layout in _LAYOUTS}


def encode_binary(frame: SerialFrame) -> bytes:
    """Frame in bytes, with its end; counts in the shortest integers that hold them."""
    layout = next(one for one in _LAYOUTS if one.kind is frame.kind and _holds(one, frame.values))
    sequence, time = frame.sequence or 0, frame.time or 0
    header = _HEADER.pack(layout.letter, VERSION, sequence % SEQUENCES, time % CLOCK_RANGE)
    content = header + _to_bytes(layout, frame.values)
    return stuff(content + _CHECKSUM.pack(zlib.crc32(content))) + END


def decode_binary(piece: bytes) -> SerialFrame:
    """Frame of the bytes before an end; ValueError where they are none."""
    whole = unstuff(piece)
    if len(whole) < _HEADER.size + _CHECKSUM.size:
        raise ValueError(f'a frame of {len(whole)} bytes is too short')
    content, checksum = whole[: -_CHECKSUM.size], whole[-_CHECKSUM.size :]
    if _CHECKSUM.pack(zlib.crc32(content)) != checksum:
        raise ValueError('the checksum of a frame is wrong')
    letter, version, sequence, time = _HEADER.unpack_from(content)
    layout = _OF_LETTER.get(letter)
    if layout is None or version != VERSION:
        raise ValueError(
            f'frames of kind {letter!r} and version {version} are not known; see docs/serial.md'
        )
    data = content[_HEADER.size :]
    if len(data) % layout.type.itemsize:
        raise ValueError(
            f'{len(data)} bytes of values are no multiple of {layout.type.itemsize} bytes each'
        )
    values = np.frombuffer(data, layout.type).astype(np.float64)
    if layout.type.kind == 'i':
        values[values == np.iinfo(layout.type).min] = np.nan
    elif np.isinf(values).any():
        raise ValueError(f'a value of {layout.kind.value} is infinite; send NaN for a missing one')
    return SerialFrame(layout.kind, sequence, time, values)


def stuff(data: bytes) -> bytes:
    """Bytes without a zero that stand for these."""
    stuffed = bytearray()
    for block in data.split(END):
        while len(block) >= _LONGEST_BLOCK:
            stuffed.append(_LONGEST_BLOCK + 1)
            stuffed += block[:_LONGEST_BLOCK]
            block = block[_LONGEST_BLOCK:]
        stuffed.append(len(block) + 1)
        stuffed += block
    return bytes(stuffed)


def unstuff(stuffed: bytes) -> bytes:
    """Bytes that stuffed ones stand for; ValueError where they stand for none."""
    data = bytearray()
    at, size = 0, len(stuffed)
    while at < size:
        code = stuffed[at]
        following = at + code
        if code == 0 or following > size:
            raise ValueError('a frame is cut short')
        data += stuffed[at + 1 : following]
        if code <= _LONGEST_BLOCK and following < size:
            data.append(0)
        at = following
    return bytes(data)


def _holds(layout: _ValueLayout, values: Array) -> bool:
    if layout.type.kind == 'f':
        return True
    limits = np.iinfo(layout.type)
    known = values[~np.isnan(values)]
    return bool(((known > limits.min) & (known <= limits.max)).all())


def _to_bytes(layout: _ValueLayout, values: Array) -> bytes:
    if layout.type.kind == 'i':
        missing = float(np.iinfo(layout.type).min)
        values = np.where(np.isnan(values), missing, np.round(values))
    return values.astype(layout.type).tobytes()
