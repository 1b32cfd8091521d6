# SPDX-License-Identifier: Apache-2.0
"""How much the files of a bag may ask for: a few bytes can stand for all the memory there is."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage.linkage.quantities import quantity

_MEBIBYTE = 2**20
"""Bytes in 1 MiB."""
_LARGEST_RATIO = 25
"""Times that a large file may unpack to: joint states of a machine at rest shrink to a tenth."""


@dataclass(frozen=True)
class BagLimits:
    """What a bag is read with; what asks for more is left out or refused, by the limit's name."""

    most_unpacked: int = quantity(
        64 * _MEBIBYTE,
        'size that one message or chunk of a bag may have, unpacked',
        'B',
        1024,
        2**31,
    )
    most_unpacked_file: int = quantity(
        512 * _MEBIBYTE,
        'size that one file of a bag may have, unpacked, or 25 times its size if that is more',
        'B',
        1024,
        2**40,
    )

    def for_file(self, size: int) -> int:
        """What a file of a size [B] may unpack to in all [B]."""
        return max(self.most_unpacked_file, _LARGEST_RATIO * size)


DEFAULT_LIMITS = BagLimits()
