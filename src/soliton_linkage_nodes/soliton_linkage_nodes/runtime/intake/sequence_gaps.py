# SPDX-License-Identifier: Apache-2.0
"""What never arrived, from the sequence numbers that publishers give their messages."""

from __future__ import annotations


class SequenceGaps:
    """Counts the messages of a topic that were published and never taken.

    Each publisher numbers its messages 1, 2, 3, ...; a taken message does not say whose it is.
    It is put down to the publisher whose number it continues, or else to the one that is
    closest behind. A publisher that begins anew takes the place of the one that has been silent
    for longest. What a publisher sent before it was first heard does not count.
    """

    def __init__(self) -> None:
        """Start with no publisher heard."""
        self.lost = 0
        self._last: list[int] = []

    def take(self, number: int, publishers: int) -> None:
        """Account for a message, on a topic with so many publishers."""
        if self._last == [number - 1]:
            self._last[0] = number
            return
        behind = [last for last in self._last if last < number]
        new_publisher = not behind or (
            number - 1 not in behind and len(self._last) < max(publishers, 1)
        )
        if not new_publisher:
            self.lost += number - max(behind) - 1
            self._last.remove(max(behind))
        elif len(self._last) >= max(publishers, 1):
            del self._last[0]
        self._last.append(number)
