# SPDX-License-Identifier: Apache-2.0
"""Frames are found in any bytes, however these are cut, in whichever protocol."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage.microcontroller.frame_decoder import (
    LONGEST_FRAME,
    FrameDecoder,
    Protocol,
    encode,
)
from soliton_linkage.microcontroller.frames import FrameKind, SerialFrame
from soliton_linkage.microcontroller.text_frames import encode_text

PIECES = st.sampled_from(
    [
        *(
            encode(SerialFrame(FrameKind.COUNTS, number, 10 * number, np.arange(3.0)), protocol)
            for number in (1, 10, 300)
            for protocol in Protocol
        ),
        b'counts 1 2 3\n',
        b'counts 1 2 x\n',
        b'# said for people\n',
        b'\0',
        b'\n',
        b'noise',
        b'#' * (LONGEST_FRAME + 1),
    ]
)


def written(frames: list[SerialFrame]) -> list[bytes]:
    return [encode_text(frame) for frame in frames]


def seen(chunks: list[bytes]) -> tuple[list[bytes], int, Protocol | None]:
    decoder = FrameDecoder()
    frames = [frame for chunk in chunks for frame in decoder.feed(chunk)]
    assert decoder.frames == len(frames)
    return written(frames), decoder.corrupted, decoder.protocol


@given(st.binary(max_size=300))
def test_any_bytes_are_taken_and_none_of_them_is_a_frame(noise: bytes) -> None:
    assert seen([noise])[0] == []


@given(st.lists(PIECES | st.binary(max_size=20), max_size=8), st.randoms(use_true_random=False))
def test_it_does_not_matter_how_a_stream_is_cut(
    pieces: list[bytes], chance: random.Random
) -> None:
    stream = b''.join(pieces)
    cuts = sorted(chance.randrange(len(stream) + 1) for _ in range(5))
    chunks = [stream[a:b] for a, b in itertools.pairwise([0, *cuts, len(stream)])]
    assert seen(chunks) == seen([stream])


@pytest.mark.parametrize('protocol', Protocol)
def test_the_protocol_is_recognised_in_the_middle_of_a_frame(protocol: Protocol) -> None:
    frames = [SerialFrame(FrameKind.COUNTS, n, n, np.full(10, 10.0 * n)) for n in range(20)]
    stream = b''.join(encode(frame, protocol) for frame in frames)
    whole = written(frames)
    for begin in range(1, len(encode(frames[0], protocol))):
        assert seen([stream[begin:]]) == (whole[1:], 0, protocol)


def test_frames_that_are_broken_are_counted_and_never_given() -> None:
    frames = [SerialFrame(FrameKind.COUNTS, n, n, np.full(40, 1000.0 * n)) for n in range(200)]
    chance = np.random.default_rng(0)
    for protocol in Protocol:
        pieces = [encode(frame, protocol) for frame in frames]
        broken = [bytearray(piece) for piece in pieces]
        hit = set(chance.choice(np.arange(1, 200), 50, replace=False).tolist())
        for number in hit:
            place = int(chance.integers(len(broken[number]) - 1))
            broken[number][place] ^= 1 << int(chance.integers(8))
        found, corrupted, _ = seen([b''.join(map(bytes, broken))])
        assert found == written([f for n, f in enumerate(frames) if n not in hit])
        assert corrupted >= len(hit)


def test_once_lines_had_checksums_all_must() -> None:
    checked = encode_text(SerialFrame(FrameKind.COUNTS, 1, 2, np.array([3.0])))
    decoder = FrameDecoder()
    assert len(decoder.feed(b'counts 0 1 2\n' + checked + b'counts 2 3 4\n')) == 2
    assert (decoder.corrupted, decoder.complaint) == (
        1,
        'a line has no checksum, as those before it had',
    )
    decoder.begin_anew()
    assert len(decoder.feed(b'counts 2 3 4\n')) == 1


def test_noise_without_an_end_does_not_fill_the_memory() -> None:
    decoder = FrameDecoder()
    decoder.feed(b'counts 0 1 2\n')
    for _ in range(5):
        decoder.feed(b'x' * LONGEST_FRAME)
    assert decoder.corrupted == 1
    assert len(decoder.feed(b'\ncounts 1 2 3\n')) == 1
