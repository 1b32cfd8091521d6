# SPDX-License-Identifier: Apache-2.0
"""Frames of both protocols are decoded from any stream, and no corrupted frame is accepted."""

import itertools
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.microcontroller.frames import (
    LONGEST_FRAME,
    FrameDecoder,
    FrameKind,
    Protocol,
    SerialFrame,
    decode_binary,
    decode_text,
    encode,
    encode_binary,
    encode_text,
    stuff,
    unstuff,
)

ROTORS = 40
PIECES = st.sampled_from(
    [
        *(
            encode(SerialFrame(FrameKind.COUNTS, number, 10 * number, np.arange(3.0)), protocol)
            for number in (1, 10, 300)
            for protocol in Protocol
        ),
        b'counts 1 2 3\n',
        b'counts 1 2 x\n',
        b'# comment\n',
        b'\0',
        b'\n',
        b'noise',
        b'#' * (LONGEST_FRAME + 1),
    ]
)


def test_stuffing_agrees_with_cheshire_and_baker():
    for data, stuffed in [
        (b'', b'\x01'),
        (b'\x00', b'\x01\x01'),
        (b'\x11\x22\x00\x33', b'\x03\x11\x22\x02\x33'),
        (b'\x11\x00\x00\x00', b'\x02\x11\x01\x01\x01'),
        (bytes([1] * 255), b'\xff' + bytes([1] * 254) + b'\x02\x01'),
    ]:
        assert stuff(data) == stuffed


@given(st.lists(st.sampled_from([b'', b'\0', b'\0\0', b'\x01', bytes([7] * 253)]), max_size=6))
def test_stuffed_bytes_have_no_zero_and_are_restored(parts):
    data = b'\0'.join(parts)
    assert 0 not in stuff(data)
    assert unstuff(stuff(data)) == data
    run = bytes([1] * 254)
    assert unstuff(b'\xff' + run) == unstuff(b'\xff' + run + b'\x01') == run


def test_values_are_encoded_in_the_shortest_form_and_restored():
    for kind, values, size in [
        (FrameKind.COUNTS, [1.0, -32767.0, np.nan], 2),
        (FrameKind.COUNTS, [1.0, -32768.0, np.nan], 4),
        (FrameKind.COUNTS, [2.0**31 - 1, 0.0], 4),
        (FrameKind.RADIANS, [0.5, -0.25, np.nan], 4),
        (FrameKind.TORQUES, [0.5], 4),
        (FrameKind.HELLO, [], 0),
    ]:
        written = encode_binary(SerialFrame(kind, 65535, 2**32 - 1, np.array(values)))
        read = decode_binary(written[:-1])
        assert (read.kind, read.sequence, read.time) == (kind, 65535, 2**32 - 1)
        np.testing.assert_array_equal(read.values, values)
        assert len(unstuff(written[:-1])) == 8 + size * len(values) + 4


@pytest.mark.parametrize('protocol', Protocol)
def test_a_flipped_bit_on_the_line_is_detected(protocol):
    counts = np.random.default_rng(0).integers(-(10**6), 10**6, ROTORS).astype(float)
    counts[3] = np.nan
    written = encode(SerialFrame(FrameKind.COUNTS, 12, 3456, counts), protocol)
    for bit in range(8 * (len(written) - 1)):
        flipped = bytearray(written)
        flipped[bit // 8] ^= 1 << bit % 8
        decoder = FrameDecoder()
        assert len(decoder.feed(written)) == 1
        # Checksums in text may have small letters.
        assert [encode(frame, protocol) for frame in decoder.feed(bytes(flipped))] in (
            [],
            [written],
        )
        assert bytes(flipped).upper() == written.upper() or decoder.frames == 1


def test_valid_frames_of_unknown_content_are_rejected():
    for content, complaint in [
        (b'x\x01\0\0\0\0\0\0', 'kind'),
        (b'c\x02\0\0\0\0\0\0', 'version 2'),
        (b'C\x01\0\0\0\0\0\0\1\2', 'multiple of 4'),
        (b'r\x01\0\0\0\0\0\0\0\0\x80\x7f', 'infinite'),
    ]:
        checksum = zlib.crc32(content).to_bytes(4, 'little')
        with pytest.raises(ValueError, match=complaint):
            decode_binary(stuff(content + checksum))


def test_lines_of_text_are_decoded():
    for line, sequence, time, values in [
        (b'counts 7 1250000 512 - -3', 7, 1250000, [512, np.nan, -3]),
        (b'counts - - 512 nan', None, None, [512, np.nan]),
        (b'radians 65536 4294967297 .5 -1e-3 NaN\r', 0, 1, [0.5, -1e-3, np.nan]),
        (b'hello', None, None, []),
        (b'torques 1 100000 0.01', 1, 100000, [0.01]),
    ]:
        frame = decode_text(line)
        assert (frame.sequence, frame.time, frame.checked) == (sequence, time, False)
        np.testing.assert_array_equal(frame.values, values)


def test_invalid_lines_are_rejected_in_one_line():
    for line in [
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
    ]:
        with pytest.raises(ValueError, match=r'.') as raised:
            decode_text(line)
        assert '\n' not in str(raised.value)


def written(frames: list[SerialFrame]) -> list[bytes]:
    return [encode_text(frame) for frame in frames]


def seen(chunks: list[bytes]) -> tuple[list[bytes], int, Protocol | None]:
    decoder = FrameDecoder()
    frames = [frame for chunk in chunks for frame in decoder.feed(chunk)]
    assert decoder.frames == len(frames)
    return written(frames), decoder.corrupted, decoder.protocol


@given(st.binary(max_size=300))
def test_random_bytes_contain_no_frame(noise):
    assert seen([noise])[0] == []


@given(st.lists(PIECES | st.binary(max_size=20), max_size=8), st.randoms(use_true_random=False))
def test_decoding_does_not_depend_on_chunks(pieces, chance):
    stream = b''.join(pieces)
    cuts = sorted(chance.randrange(len(stream) + 1) for _ in range(5))
    chunks = [stream[a:b] for a, b in itertools.pairwise([0, *cuts, len(stream)])]
    assert seen(chunks) == seen([stream])


@pytest.mark.parametrize('protocol', Protocol)
def test_the_protocol_is_recognised_from_the_middle_of_a_frame(protocol):
    frames = [SerialFrame(FrameKind.COUNTS, n, n, np.full(10, 10.0 * n)) for n in range(20)]
    stream = b''.join(encode(frame, protocol) for frame in frames)
    encoded = written(frames)
    for begin in range(1, len(encode(frames[0], protocol))):
        assert seen([stream[begin:]]) == (encoded[1:], 0, protocol)


def test_corrupted_frames_are_counted_and_not_returned():
    frames = [SerialFrame(FrameKind.COUNTS, n, n, np.full(40, 1000.0 * n)) for n in range(200)]
    chance = np.random.default_rng(0)
    for protocol in Protocol:
        pieces = [encode(frame, protocol) for frame in frames]
        broken = [bytearray(piece) for piece in pieces]
        hit = set(chance.choice(np.arange(1, 200), 50, replace=False).tolist())
        for number in hit:
            index = int(chance.integers(len(broken[number]) - 1))
            broken[number][index] ^= 1 << int(chance.integers(8))
        found, corrupted, _ = seen([b''.join(map(bytes, broken))])
        assert found == written([f for n, f in enumerate(frames) if n not in hit])
        assert corrupted >= len(hit)


def test_lines_without_checksum_are_rejected_after_one_with_checksum():
    checked = encode_text(SerialFrame(FrameKind.COUNTS, 1, 2, np.array([3.0, np.nan])))
    assert checked.startswith(b'counts 1 2 3 -*')
    decoder = FrameDecoder()
    assert len(decoder.feed(b'counts 0 1 2\n' + checked + b'counts 2 3 4\n')) == 2
    assert (decoder.corrupted, decoder.complaint) == (
        1,
        'a line has no checksum, unlike an earlier line; send a checksum with each line',
    )
    decoder.reset()
    assert len(decoder.feed(b'counts 2 3 4\n')) == 1


def test_input_without_an_end_is_discarded():
    decoder = FrameDecoder()
    decoder.feed(b'counts 0 1 2\n')
    for _ in range(5):
        decoder.feed(b'x' * LONGEST_FRAME)
    assert decoder.corrupted == 1
    assert len(decoder.feed(b'\ncounts 1 2 3\n')) == 1
