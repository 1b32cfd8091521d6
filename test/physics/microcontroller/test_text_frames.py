# SPDX-License-Identifier: Apache-2.0
"""Lines that a person can type, and none that a person cannot have meant."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.microcontroller.frames import FrameKind, SerialFrame
from soliton_linkage.microcontroller.text_frames import decode_text, encode_text


@pytest.mark.parametrize(
    ('line', 'sequence', 'time', 'values'),
    [
        (b'counts 7 1250000 512 - -3', 7, 1250000, [512, np.nan, -3]),
        (b'counts - - 512 nan', None, None, [512, np.nan]),
        (b'radians 65536 4294967297 .5 -1e-3 NaN\r', 0, 1, [0.5, -1e-3, np.nan]),
        (b'hello', None, None, []),
        (b'torques 1 100000 0.01', 1, 100000, [0.01]),
    ],
)
def test_lines_as_they_are_typed(
    line: bytes, sequence: int | None, time: int | None, values: list[float]
) -> None:
    frame, checked = decode_text(line)
    assert (frame.sequence, frame.time, checked) == (sequence, time, False)
    np.testing.assert_array_equal(frame.values, values)


@pytest.mark.parametrize(
    'line',
    [
        b'angles 1 2 3',
        b'counts 1 2 1.5',
        b'counts 1 2 1_0',
        b'counts -1 2 3',
        b'counts 1 2.5 3',
        b'radians 1 2 inf',
        b'radians 1 2 1e999',
        b'radians 1 2 0x10',
        'radians 1 2 ٣'.encode(),
        b'counts 1 2 ' + b'9' * 5000,
        b'counts 1 2 3*00000000',
        b'\xff\xfe',
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(line: bytes) -> None:
    with pytest.raises(ValueError, match=r'.') as raised:
        decode_text(line)
    assert '\n' not in str(raised.value)


def test_a_checksum_vouches_for_every_character() -> None:
    written = encode_text(SerialFrame(FrameKind.COUNTS, 3, 40, np.array([1.0, np.nan, -20.0])))
    line = written[:-1]
    assert line.startswith(b'counts 3 40 1 - -20*')
    assert decode_text(line)[1]
    for place in range(len(line) - 9):
        for bit in range(8):
            flipped = bytearray(line)
            flipped[place] ^= 1 << bit
            with pytest.raises(ValueError, match=r'checksum'):
                decode_text(bytes(flipped))
