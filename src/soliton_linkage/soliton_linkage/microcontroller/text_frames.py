# SPDX-License-Identifier: Apache-2.0
"""Frames as lines of text, which a person can type: words, and perhaps a checksum."""

from __future__ import annotations

import math
import re
import zlib

import numpy as np

from soliton_linkage.microcontroller.frames import (
    CLOCK_RANGE,
    SEQUENCES,
    FrameKind,
    SerialFrame,
)

END_OF_LINE = b'\n'
"""Of a frame; a carriage return before it is passed over."""
_KINDS = {kind.value: kind for kind in FrameKind}
_CHECKSUM = re.compile(rb'\*([0-9A-Fa-f]{8})')
"""CRC-32 of all that stands before it."""
_NUMBER = re.compile(r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?')
_WHOLE = re.compile(r'[-+]?\d{1,15}')
"""Number that a double holds exactly."""
_TIME = re.compile(r'\d{1,20}')
"""Number of 64 bits at most."""
_UNKNOWN = f'a line begins with none of {", ".join(_KINDS)}; see docs/serial.md'
_MISSING = '-'
_NOT_A_NUMBER = ('-', 'nan')
"""For a missing value: what a person types, and what the libraries of controllers print."""


def encode_text(frame: SerialFrame) -> bytes:
    """Line of a frame, with its checksum and its end."""
    format_ = '.0f' if frame.kind is FrameKind.COUNTS else '.9g'
    words = [frame.kind.value]
    words += [_MISSING if each is None else str(each) for each in (frame.sequence, frame.time)]
    words += [
        _MISSING if math.isnan(value) else format(value, format_)
        for value in frame.values.tolist()
    ]
    line = ' '.join(words).encode()
    return b'%b*%08X%b' % (line, zlib.crc32(line), END_OF_LINE)


def is_remark(line: bytes) -> bool:
    """Whether a line is none of the protocol, but meant for people."""
    return not line.strip() or line.startswith(b'#')


def decode_text(line: bytes) -> tuple[SerialFrame, bool]:
    """Frame of a line, and whether a checksum vouches for it; ValueError where it is none."""
    line = line.removesuffix(b'\r')
    content, checked = line, len(line) > 9 and _CHECKSUM.fullmatch(line, len(line) - 9)
    if checked:
        content = line[:-9]
        if zlib.crc32(content) != int(checked[1], 16):
            raise ValueError('the checksum of a line is wrong')
    try:
        words = content.decode('ascii').split()
        kind = _KINDS[words[0]]
    except (ValueError, LookupError):
        raise ValueError(_UNKNOWN) from None
    sequence, time = ([*words[1:3], _MISSING, _MISSING])[:2]
    read = _whole_number if kind is FrameKind.COUNTS else _real_number
    values = np.array([read(word) for word in words[3:]], dtype=np.float64)
    numbers = _counter(sequence, SEQUENCES), _counter(time, CLOCK_RANGE)
    return SerialFrame(kind, *numbers, values), bool(checked)


def _counter(word: str, period: int) -> int | None:
    if word == _MISSING:
        return None
    if not _TIME.fullmatch(word):
        raise ValueError(f'{word!r} is no number of a frame and no time; send - for none')
    return int(word) % period


def _whole_number(word: str) -> float:
    if word.lower() in _NOT_A_NUMBER:
        return math.nan
    if not _WHOLE.fullmatch(word):
        raise ValueError(f'{word!r} is no whole number; send - for a missing rotor')
    return float(word)


def _real_number(word: str) -> float:
    if word.lower() in _NOT_A_NUMBER:
        return math.nan
    if not _NUMBER.fullmatch(word) or math.isinf(float(word)):
        raise ValueError(f'{word!r} is no number; send - for a missing rotor')
    return float(word)
