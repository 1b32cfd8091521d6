# SPDX-License-Identifier: Apache-2.0
"""Files of a bag that rosbag2 packed whole, unpacked as far as they are intact."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import BinaryIO

from soliton_linkage_nodes.bags.guards.limits import BagLimits
from soliton_linkage_nodes.bags.guards.unpacking import pieces

PACKED = '.zstd'


def unpack_file(packed: BinaryIO, plain: Path, limits: BagLimits) -> str | None:
    """Unpack a file as far as it can be; return what is wrong with it."""
    size = packed.seek(0, 2)
    most = limits.for_file(size)
    if not size:
        return 'its compression is cut short'
    with (
        mmap.mmap(packed.fileno(), 0, access=mmap.ACCESS_READ) as data,
        memoryview(data) as view,
        plain.open('wb') as out,
    ):
        try:
            for piece in pieces(view, 'zstd', whole=True):
                if out.tell() + len(piece) > most:
                    return f'it unpacks to more than most_unpacked_file = {most} bytes: cut there'
                out.write(piece)
        except ValueError as error:
            return str(error)
    return None
