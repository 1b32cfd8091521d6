# SPDX-License-Identifier: Apache-2.0
"""Files of a bag that rosbag2 packed whole, unpacked as far as they are intact."""

from __future__ import annotations

from pathlib import Path

from backports import zstd

PACKED = '.zstd'
_PIECE = 2**20
"""Size of what is unpacked at one go [B], which is all that has to fit into memory."""


def unpack_file(file: Path, plain: Path) -> str | None:
    """Unpack a file as far as it can be; return what is wrong with it."""
    unpacker = zstd.ZstdDecompressor()
    with file.open('rb') as packed, plain.open('wb') as out:
        try:
            while piece := packed.read(_PIECE):
                while piece:
                    unpacker = zstd.ZstdDecompressor() if unpacker.eof else unpacker
                    out.write(unpacker.decompress(piece))
                    piece = unpacker.unused_data if unpacker.eof else b''
        except zstd.ZstdError as error:
            return f'its compression is damaged: {error}'
    return None if unpacker.eof else 'its compression is cut short'
