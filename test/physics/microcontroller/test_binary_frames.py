# SPDX-License-Identifier: Apache-2.0
"""Frames in bytes come back as they were, and not where a bit of them was flipped."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.microcontroller.binary_frames import (
    decode_binary,
    encode_binary,
    stuff,
    unstuff,
)
from soliton_linkage.microcontroller.frames import FrameKind, SerialFrame

ROTORS = 40
LAST_ONES = 254


def frame(kind: FrameKind = FrameKind.COUNTS) -> SerialFrame:
    values = np.random.default_rng(0).integers(-(10**6), 10**6, ROTORS).astype(float)
    return SerialFrame(kind, 12, 3456, values)


@pytest.mark.parametrize(
    ('data', 'stuffed'),
    [
        (b'', b'\x01'),
        (b'\x00', b'\x01\x01'),
        (b'\x11\x22\x00\x33', b'\x03\x11\x22\x02\x33'),
        (b'\x11\x00\x00\x00', b'\x02\x11\x01\x01\x01'),
        (bytes([1] * 255), b'\xff' + bytes([1] * 254) + b'\x02\x01'),
    ],
)
def test_stuffing_is_that_of_cheshire_and_baker(data: bytes, stuffed: bytes) -> None:
    assert stuff(data) == stuffed


@given(st.lists(st.sampled_from([b'', b'\0', b'\0\0', b'\x01', bytes([7] * 253)]), max_size=6))
def test_stuffed_bytes_have_no_zero_and_come_back(parts: list[bytes]) -> None:
    data = b'\0'.join(parts)
    assert 0 not in stuff(data)
    assert unstuff(stuff(data)) == data


def test_a_run_may_end_with_the_code_of_nothing_or_without() -> None:
    run = bytes([1] * LAST_ONES)
    assert unstuff(b'\xff' + run) == unstuff(b'\xff' + run + b'\x01') == run


@pytest.mark.parametrize(
    ('kind', 'values', 'size'),
    [
        (FrameKind.COUNTS, [1.0, -32767.0, np.nan], 2),
        (FrameKind.COUNTS, [1.0, -32768.0, np.nan], 4),
        (FrameKind.COUNTS, [2.0**31 - 1, 0.0], 4),
        (FrameKind.RADIANS, [0.5, -0.25, np.nan], 4),
        (FrameKind.TORQUES, [0.5], 4),
        (FrameKind.HELLO, [], 0),
    ],
)
def test_values_come_back_in_the_shortest_form_that_holds_them(
    kind: FrameKind, values: list[float], size: int
) -> None:
    written = encode_binary(SerialFrame(kind, 65535, 2**32 - 1, np.array(values)))
    read = decode_binary(written[:-1])
    assert (read.kind, read.sequence, read.time) == (kind, 65535, 2**32 - 1)
    np.testing.assert_array_equal(read.values, values)
    assert len(unstuff(written[:-1])) == 8 + size * len(values) + 4


def test_every_pattern_of_up_to_four_flipped_bits_has_a_checksum_of_its_own() -> None:
    # CRCs are linear: a pattern goes unnoticed where the syndromes of its bits add up to zero.
    size = 8 + 4 * ROTORS
    nothing = zlib.crc32(bytes(size))
    of_bits = [
        zlib.crc32((1 << bit).to_bytes(size, 'little')) ^ nothing for bit in range(8 * size)
    ]
    single = np.array([*of_bits, *(1 << bit for bit in range(32))], dtype=np.uint32)
    first, second = np.triu_indices(len(single), 1)
    pairs = single[first] ^ single[second]
    syndromes = np.sort(np.concatenate([pairs, single, np.zeros(1, dtype=np.uint32)]))
    assert (np.diff(syndromes) > 0).all()


def test_no_bit_of_a_frame_on_the_line_can_be_flipped_unnoticed() -> None:
    piece = encode_binary(frame())[:-1]
    for bit in range(8 * len(piece)):
        flipped = bytearray(piece)
        flipped[bit // 8] ^= 1 << bit % 8
        for part in bytes(flipped).split(b'\0'):
            with pytest.raises(ValueError, match=r'checksum|short'):
                decode_binary(part)


@pytest.mark.parametrize(
    ('content', 'complaint'),
    [
        (b'x\x01\0\0\0\0\0\0', 'kind'),
        (b'c\x02\0\0\0\0\0\0', 'version 2'),
        (b'C\x01\0\0\0\0\0\0\1\2', 'multiple of 4'),
        (b'r\x01\0\0\0\0\0\0\0\0\x80\x7f', 'infinite'),
    ],
)
def test_a_whole_frame_of_something_else_is_refused(content: bytes, complaint: str) -> None:
    checksum = zlib.crc32(content).to_bytes(4, 'little')
    with pytest.raises(ValueError, match=complaint):
        decode_binary(stuff(content + checksum))
