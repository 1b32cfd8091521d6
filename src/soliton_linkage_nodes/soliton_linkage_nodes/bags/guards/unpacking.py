# SPDX-License-Identifier: Apache-2.0
"""Packed data come out piece by piece, and no more of them than a limit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol, cast

import lz4.frame
from backports import zstd

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_PIECE_IN = 4096
"""Size of what is given to an unpacker [B]: what is before damage comes out, to the last piece."""
_PIECE_OUT = 2**20
"""Size of what it may answer at one go [B]."""


class _Unpacker(Protocol):
    """What both libraries offer."""

    eof: bool
    needs_input: bool
    unused_data: bytes | None

    def decompress(self, data: bytes | memoryview, max_length: int = -1) -> bytes:
        """What comes out of the next of the data."""


def pieces(
    packed: bytes | bytearray | memoryview, codec: str, whole: bool = False
) -> Iterator[bytes]:
    """Yield what comes out of zstd or lz4; ends with the data, ValueError where they are damaged.

    No more is kept than one piece; who takes them stops at a limit. Data that must be `whole` end
    with a frame.
    """
    packed = memoryview(packed)
    begin, unpacker, at_end = 0, _unpacker(codec), False
    while begin < len(packed):
        given: bytes | memoryview = packed[begin : begin + _PIECE_IN]
        begin += len(given)
        try:
            while given or not (unpacker.needs_input or unpacker.eof):
                if piece := unpacker.decompress(given, _PIECE_OUT):
                    yield piece
                given = b''
            at_end = unpacker.eof
            if at_end:
                # Frames may follow each other.
                begin -= len(unpacker.unused_data or b'')
                unpacker = _unpacker(codec)
        except (zstd.ZstdError, RuntimeError, EOFError) as error:
            raise ValueError(f'its compression is damaged: {error}') from error
    if whole and not at_end:
        raise ValueError('its compression is cut short')


def unpacked_begin(packed: bytes | bytearray | memoryview, codec: str, most: int) -> bytearray:
    """What comes out before damage, the end or the limit [B], of which there is one byte more."""
    out = bytearray()
    try:
        for piece in pieces(packed, codec):
            out += piece
            if len(out) > most:
                del out[most + 1 :]
                break
    except ValueError:
        pass
    return out


def unpacked_message(data: bytes, most: int) -> bytes:
    """A message that may be packed with zstd by itself; ValueError where that is damaged."""
    if not data.startswith(ZSTD_MAGIC):
        return data
    out = bytearray()
    for piece in pieces(data, 'zstd', whole=True):
        out += piece
        if len(out) > most:
            raise ValueError(f'a message unpacks to more than most_unpacked = {most} bytes')
    return bytes(out)


def _unpacker(codec: str) -> _Unpacker:
    unpacker: Any = (
        zstd.ZstdDecompressor() if codec == 'zstd' else lz4.frame.LZ4FrameDecompressor()
    )
    return cast('_Unpacker', unpacker)
