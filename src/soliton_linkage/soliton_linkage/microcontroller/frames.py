# SPDX-License-Identifier: Apache-2.0
"""Text and binary frames on a serial line to a microcontroller (docs/serial.md).

A binary frame consists of a header, values, and the CRC-32 of zlib. Consistent overhead byte
stuffing removes the zero bytes of the frame (Cheshire and Baker, IEEE/ACM Transactions on
Networking 7, 159, 1999, doi:10.1109/90.769765). A zero byte ends the frame.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from soliton_linkage.linkage.chain import Array

SEQUENCES = 2**16
"""Number of different frame numbers (uint16_t); after the last one, numbers restart at 0."""
CLOCK_RANGE = 2**32
"""Period of a controller's clock [us]: 71.6 minutes, as for micros() of an Arduino."""
VERSION = 1
"""Version of the binary layout; other versions are rejected."""
LONGEST_FRAME = 2**16
"""Longest accepted frame [bytes]; it suffices for 2500 rotors in text."""
_LINE_END, _FRAME_END = b'\n', b'\0'
_HEADER = struct.Struct('<cBHI')
"""Binary header of 8 bytes: letter of the frame kind, version, frame number, time [us]."""
_CHECKSUM = struct.Struct('<I')
_LONGEST_BLOCK = 254
"""Largest number of bytes without a zero byte that byte stuffing encodes as one block [bytes]."""
_TEXT_CHECKSUM = re.compile(rb'\*([0-9A-Fa-f]{8})')
_REAL = re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?')
_WHOLE = re.compile(r'[-+]?\d{1,15}')
"""Pattern of the integers that a floating-point number of 64 bits represents exactly."""
_COUNTER = re.compile(r'\d{1,20}')
_MISSING = '-'


class FrameKind(Enum):
    """Kind of a frame: encoder counts [1], encoder angles [rad], a message, or a command."""

    COUNTS = 'counts'
    RADIANS = 'radians'
    HELLO = 'hello'
    """Message that the controller has started or restarted; it has no values."""
    TORQUES = 'torques'
    """Torques that the valves shall apply to the rotors [N m]."""
    PRESSURES = 'pressures'
    """Pressures that the valves shall set [Pa]."""


READINGS = frozenset({FrameKind.COUNTS, FrameKind.RADIANS})
"""Kinds of frames with readings, which a controller sends."""
COMMANDS = frozenset({FrameKind.TORQUES, FrameKind.PRESSURES})
"""Kinds of frames with commands, which a controller receives."""
_KINDS = {kind.value: kind for kind in FrameKind}
_LAYOUTS: dict[bytes, tuple[FrameKind, np.dtype[Any]]] = {
    b'c': (FrameKind.COUNTS, np.dtype('<i2')),
    b'C': (FrameKind.COUNTS, np.dtype('<i4')),
    b'r': (FrameKind.RADIANS, np.dtype('<f4')),
    b'h': (FrameKind.HELLO, np.dtype('<i2')),
    b't': (FrameKind.TORQUES, np.dtype('<f4')),
    b'p': (FrameKind.PRESSURES, np.dtype('<f4')),
}


class Protocol(Enum):
    """Encoding of frames on the serial line."""

    TEXT = 'text'
    BINARY = 'binary'


@dataclass(frozen=True, eq=False)
class SerialFrame:
    """One frame on the serial line."""

    kind: FrameKind
    sequence: int | None = None
    """Frame number modulo `SEQUENCES`; None if the frame contains no number."""
    time: int | None = None
    """Time of a measurement by the controller's clock, modulo `CLOCK_RANGE` [us]. In a command,
    duration for which the command is valid [us]. None if the frame contains no time."""
    values: Array = field(default_factory=lambda: np.zeros(0))
    """One value per rotor, NaN if missing."""
    checked: bool = False
    """Whether a checksum proves that the frame was transmitted without an error."""


def encode(frame: SerialFrame, protocol: Protocol) -> bytes:
    """Return the bytes of a frame, including the byte that marks the end."""
    return encode_binary(frame) if protocol is Protocol.BINARY else encode_text(frame)


def encode_text(frame: SerialFrame) -> bytes:
    """Return a frame as a line of text with a checksum."""
    format_ = '.0f' if frame.kind is FrameKind.COUNTS else '.9g'
    words = [frame.kind.value]
    words += [_MISSING if each is None else str(each) for each in (frame.sequence, frame.time)]
    words += [
        _MISSING if math.isnan(value) else format(value, format_)
        for value in frame.values.tolist()
    ]
    line = ' '.join(words).encode()
    return b'%b*%08X%b' % (line, zlib.crc32(line), _LINE_END)


def decode_text(line: bytes) -> SerialFrame:
    """Return the frame that a line of text encodes; raise ValueError if it is invalid."""
    content = line = line.removesuffix(b'\r')
    checksum = _TEXT_CHECKSUM.fullmatch(line, len(line) - 9) if len(line) > 9 else None
    if checksum:
        content = line[:-9]
        if zlib.crc32(content) != int(checksum[1], 16):
            raise ValueError('the checksum of a line is wrong; check the wiring and the baud rate')
    try:
        words = content.decode('ascii').split()
        kind = _KINDS[words[0]]
    except (ValueError, LookupError):
        raise ValueError(
            f'a line must begin with one of {", ".join(_KINDS)}; see docs/serial.md'
        ) from None
    sequence, time = [*words[1:3], _MISSING, _MISSING][:2]
    values = np.array([_value(word, kind) for word in words[3:]], dtype=np.float64)
    numbers = _counter(sequence, SEQUENCES), _counter(time, CLOCK_RANGE)
    return SerialFrame(kind, *numbers, values, checksum is not None)


def _counter(word: str, period: int) -> int | None:
    if word == _MISSING:
        return None
    if not _COUNTER.fullmatch(word):
        raise ValueError(f'{word!r} is not a frame number or a time; send - if it is unknown')
    return int(word) % period


def _value(word: str, kind: FrameKind) -> float:
    if word.lower() in (_MISSING, 'nan'):
        return math.nan
    pattern, what = (_WHOLE, 'a whole') if kind is FrameKind.COUNTS else (_REAL, 'a finite')
    if not pattern.fullmatch(word) or math.isinf(float(word)):
        raise ValueError(f'{word!r} is not {what} number; send - for a missing rotor')
    return float(word)


def encode_binary(frame: SerialFrame) -> bytes:
    """Return a frame as bytes; counts have the shortest integer type that can hold them."""
    for letter, (kind, type_) in _LAYOUTS.items():
        packed = _packed(frame.values, type_) if kind is frame.kind else None
        if packed is not None:
            sequence, time = (frame.sequence or 0) % SEQUENCES, (frame.time or 0) % CLOCK_RANGE
            content = _HEADER.pack(letter, VERSION, sequence, time) + packed
            return stuff(content + _CHECKSUM.pack(zlib.crc32(content))) + _FRAME_END
    raise ValueError(
        f'{frame.kind.value} exceed the range of 32-bit integers; send smaller numbers'
    )


def _packed(values: Array, type_: np.dtype[Any]) -> bytes | None:
    if type_.kind == 'i':
        limits, missing = np.iinfo(type_), np.isnan(values)
        known = values[~missing]
        if not ((known > limits.min) & (known <= limits.max)).all():
            return None
        values = np.where(missing, float(limits.min), np.round(values))
    return values.astype(type_).tobytes()


def decode_binary(piece: bytes) -> SerialFrame:
    """Return the frame that `piece` (without the end byte) encodes; ValueError if invalid."""
    whole = unstuff(piece)
    if len(whole) < _HEADER.size + _CHECKSUM.size:
        least = _HEADER.size + _CHECKSUM.size
        raise ValueError(f'a frame of {len(whole)} bytes is too short; send {least} or more')
    content, checksum = whole[: -_CHECKSUM.size], whole[-_CHECKSUM.size :]
    if _CHECKSUM.pack(zlib.crc32(content)) != checksum:
        raise ValueError('the checksum of a frame is wrong; check the wiring and the baud rate')
    letter, version, sequence, time = _HEADER.unpack_from(content)
    if letter not in _LAYOUTS or version != VERSION:
        raise ValueError(
            f'frames of kind {letter!r} and version {version} are unknown; see docs/serial.md'
        )
    kind, type_ = _LAYOUTS[letter]
    data = content[_HEADER.size :]
    if len(data) % type_.itemsize:
        raise ValueError(
            f'{len(data)} bytes of values are not a multiple of {type_.itemsize} bytes each'
        )
    values = np.frombuffer(data, type_).astype(np.float64)
    if type_.kind == 'i':
        values[values == np.iinfo(type_).min] = np.nan
    elif np.isinf(values).any():
        raise ValueError(f'a value of {kind.value} is infinite; send NaN for a missing value')
    return SerialFrame(kind, sequence, time, values, checked=True)


def stuff(data: bytes) -> bytes:
    """Return bytes that encode `data` and contain no zero byte."""
    stuffed = bytearray()
    for block in data.split(b'\0'):
        while len(block) >= _LONGEST_BLOCK:
            stuffed.append(_LONGEST_BLOCK + 1)
            stuffed += block[:_LONGEST_BLOCK]
            block = block[_LONGEST_BLOCK:]
        stuffed.append(len(block) + 1)
        stuffed += block
    return bytes(stuffed)


def unstuff(stuffed: bytes) -> bytes:
    """Return the bytes that a stuffed frame encodes; raise ValueError if it is invalid."""
    data = bytearray()
    at, size = 0, len(stuffed)
    while at < size:
        code = stuffed[at]
        following = at + code
        if code == 0 or following > size:
            raise ValueError('a frame is truncated; check the wiring and the baud rate')
        data += stuffed[at + 1 : following]
        if code <= _LONGEST_BLOCK and following < size:
            data.append(0)
        at = following
    return bytes(data)


class FrameDecoder:
    """Decoder of text or binary frames in a stream of chunks; other input is ignored.

    The last valid frame determines the protocol. After a text line with a checksum, lines without
    a checksum are rejected.
    """

    def __init__(self) -> None:
        self.protocol: Protocol | None = None
        self.frames = 0
        self.corrupted = 0
        """Number of invalid frames so far.

        Input is not counted if its protocol differs from the protocol of the last valid frame at
        that time, nor before the first valid frame.
        """
        self.complaint = ''
        """Error message about the last invalid frame."""
        self.reset()

    def reset(self) -> None:
        """Prepare for another controller, but keep the numbers of valid and invalid frames."""
        self.protocol = None
        self._checked = False
        self._lines, self._pieces = _Splitter(_LINE_END), _Splitter(_FRAME_END)

    def feed(self, chunk: bytes) -> list[SerialFrame]:
        """Return the frames whose last byte is in `chunk`, in the order of these bytes."""
        ended = [(end, Protocol.TEXT, line) for end, line in self._lines.feed(chunk)]
        ended += [(end, Protocol.BINARY, piece) for end, piece in self._pieces.feed(chunk)]
        ended.sort(key=lambda each: each[0])
        decoded = (self._decoded(protocol, written) for _, protocol, written in ended)
        frames = [frame for frame in decoded if frame is not None]
        self.frames += len(frames)
        return frames

    def _decoded(self, protocol: Protocol, written: bytes | None) -> SerialFrame | None:
        try:
            if written is None:
                raise ValueError(
                    f'{LONGEST_FRAME} bytes arrived without the end of a frame; end each frame'
                )
            if protocol is Protocol.TEXT:
                if not written.strip() or written.startswith(b'#'):
                    return None
                frame = decode_text(written)
                if self._checked and not frame.checked:
                    raise ValueError(
                        'a line has no checksum, unlike an earlier line; send a checksum with '
                        'each line'
                    )
                self._checked = frame.checked
            elif written:
                frame = decode_binary(written)
            else:
                return None
        except ValueError as error:
            if protocol is self.protocol:
                self.corrupted += 1
                self.complaint = str(error)
            return None
        self.protocol = protocol
        return frame


class _Splitter:
    def __init__(self, end: bytes) -> None:
        self._end = end
        self._rest = b''
        self._begin = 0
        self._too_long = False

    def feed(self, chunk: bytes) -> list[tuple[int, bytes | None]]:
        found: list[tuple[int, bytes | None]] = []
        *whole, rest = (self._rest + chunk).split(self._end)
        for piece in whole:
            if not self._too_long:
                short = len(piece) <= LONGEST_FRAME
                end = self._begin + (len(piece) if short else LONGEST_FRAME)
                found.append((end, piece if short else None))
            self._begin += len(piece) + 1
            self._too_long = False
        self._rest = rest
        if self._too_long or len(rest) > LONGEST_FRAME:
            if not self._too_long:
                found.append((self._begin + LONGEST_FRAME, None))
            self._too_long = True
            self._begin += len(rest)
            self._rest = b''
        return found
