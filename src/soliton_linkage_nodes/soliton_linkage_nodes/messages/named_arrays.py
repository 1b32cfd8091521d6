# SPDX-License-Identifier: Apache-2.0
"""Serialized messages of a header, names, and arrays of one double a name."""

from __future__ import annotations

import struct

import numpy as np

from soliton_linkage.linkage.chain import Array

_LITTLE_ENDIAN = b'\x00\x01'
_STAMP = struct.Struct('<4xiI')
_COUNT = struct.Struct('<I')
_NOTHING = np.zeros(0)


class Layout:
    """Where in its bytes a message with a certain frame and names has its arrays of doubles.

    CDR writes a string as the length of its bytes with the final zero, and them; a sequence as
    its count and the elements. Counts begin at multiples of 4 bytes, doubles at multiples of 8,
    from the end of the 4 bytes of the encapsulation header. What lies between can be anything.
    """

    def __init__(self, frame_id: str, name: tuple[str, ...]) -> None:
        """Lay out what stands between the stamp and the arrays."""
        self.frame_id, self.name = frame_id, name
        texts = [text.encode() + b'\x00' for text in (frame_id, *name)]
        head = [_COUNT.pack(len(text)) + text + bytes(-len(text) % 4) for text in texts]
        meant = [b'\xff' * (4 + len(text)) + bytes(-len(text) % 4) for text in texts]
        head.insert(1, _COUNT.pack(len(name)))
        meant.insert(1, b'\xff' * 4)
        self._head = np.frombuffer(b''.join(head), '<u4')
        self._meant = np.frombuffer(b''.join(meant), '<u4')
        self._end = _STAMP.size + self._head.nbytes
        self._fitted = self._head.tobytes()

    def fits(self, serialized: bytes) -> bool:
        """Whether a message has the frame and the names."""
        if len(serialized) < self._end or not serialized.startswith(_LITTLE_ENDIAN):
            return False
        if serialized.startswith(self._fitted, _STAMP.size):
            return True
        head = np.frombuffer(serialized, '<u4', len(self._head), _STAMP.size)
        if ((head ^ self._head) & self._meant).any():
            return False
        self._fitted = head.tobytes()
        return True

    def stamp(self, serialized: bytes) -> tuple[int, int]:
        """Seconds and nanoseconds since the epoch of a message that fits."""
        seconds, nanoseconds = _STAMP.unpack_from(serialized)
        return seconds, nanoseconds

    def arrays(self, serialized: bytes, number: int) -> list[Array]:
        """The first arrays of a message that fits, maybe unaligned views of it."""
        arrays, end = [], self._end
        for _ in range(number):
            array, end = _doubles(serialized, end)
            arrays.append(array)
        return arrays


def _doubles(serialized: bytes, begin: int) -> tuple[Array, int]:
    """A sequence of doubles and where it ends."""
    (count,) = _COUNT.unpack_from(serialized, begin)
    if not count:
        return _NOTHING, begin + 4
    first = begin + 4 + -begin % 8
    return np.frombuffer(serialized, '<f8', count, first), first + 8 * count
