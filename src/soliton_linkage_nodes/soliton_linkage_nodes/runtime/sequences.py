# SPDX-License-Identifier: Apache-2.0
"""Sequence numbers and times of received messages: lost ones, their publisher, and the lag."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from soliton_linkage_nodes.runtime.stamps import SECOND

_SILENCE = 0.5
"""Of the publisher that is kept to while another speaks, after which that takes its place [s]:
one that was killed is known to the graph for 20 s more."""
_SILENT_PERIODS = 5
"""The same in periods of its messages, of one that speaks seldom [1]."""
_MEMORY = 20
"""Messages over which the period of a publisher is averaged [1]."""
_UNLIKE = 3.0
"""How many times longer or shorter than its messages take a gap may last to be its own [1]."""
_NANOSECOND = 1e-9
"""[s]."""
_CLOCKS_MEMORY = 10.0
"""How long the quickest message tells the difference of two clocks [s], which drift apart."""


class SequenceGaps:
    """Counts the messages of a topic that were published and never taken.

    Each publisher numbers its messages 1, 2, 3, ...; a taken message does not say whose it is.
    It is put down to the publisher whose number it continues, or else to the one that is
    closest behind. A publisher that begins anew takes the place of the one that has been silent
    for longest. What a publisher sent before it was first heard does not count.
    """

    def __init__(self) -> None:
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


@dataclass
class _Publisher:
    """The number of its last message, when it was sent [ns], and the time between two [ns]."""

    number: int
    sent: int
    period: float = math.nan

    @property
    def silence(self) -> float:
        """After which it counts as silent [s]."""
        if math.isnan(self.period):
            return _SILENCE
        return max(_SILENCE, _SILENT_PERIODS * self.period * _NANOSECOND)

    def advance(self, number: int, sent: int) -> int:
        """Go on to a message, and return how many before it are missing."""
        apart = (sent - self.sent) / (number - self.number)
        if math.isnan(self.period):
            self.period = apart
        self.period += (min(apart, 2 * self.period) - self.period) / _MEMORY
        missing = number - self.number - 1
        self.number, self.sent = number, sent
        return missing

    def unlikeness(self, number: int, sent: int) -> float:
        """How little a message fits behind the last, 0 for the next at its time."""
        count, took = number - self.number, sent - self.sent
        if count <= 0:
            return math.inf
        expected = count * self.period
        if not (expected > 0 and took > 0):
            return 0.0 if count == 1 else math.log(_UNLIKE)
        return abs(math.log(took / expected))


class PublisherArbitration:
    """Tells the messages of the publisher that was heard first from those of others.

    Each publisher numbers its messages 1, 2, 3, ...; a message does not say whose it is. It is
    that of the publisher whose number it continues, or, after a gap, of the one that has taken
    as long for so many; one that is alone may take any time short of silence. What is missing of
    the one that is kept to is counted.
    """

    def __init__(self) -> None:
        self.lost = 0
        """Messages that were sent and never came."""
        self.foreign = 0
        """Messages of other publishers."""
        self.successions = 0
        """How often another publisher took the place of one that fell silent."""
        self._kept: _Publisher | None = None
        self._others: list[_Publisher] = []
        self._others_since: float | None = None

    def take(self, number: int, sent: int, publishers: Callable[[], int]) -> bool:
        """Whether to keep a message of a number, sent at an instant [ns]; others are counted.

        `publishers` tells how many there are, and is asked only where that matters.
        """
        kept = self._kept
        if kept is None:
            self._kept = _Publisher(number, sent)
            return True
        if number == kept.number + 1 and not self._others:
            kept.advance(number, sent)
            return True
        return self._sort(kept, number, sent, publishers())

    def _sort(self, kept: _Publisher, number: int, sent: int, publishers: int) -> bool:
        owner = self._owner(kept, number, sent, publishers)
        if owner is kept:
            self.lost += kept.advance(number, sent)
            self._others_since = None
            if publishers < 2:
                self._others.clear()
            return True
        if owner is None:
            owner = _Publisher(number, sent)
            self._others = [*self._others, owner][-max(publishers - 1, 1) :]
        else:
            owner.advance(number, sent)
        now = time.monotonic()
        if self._others_since is None:
            self._others_since = now
        if publishers >= 2 and now - self._others_since < kept.silence:
            self.foreign += 1
            return False
        self.successions += 1
        self._kept, self._others_since = owner, None
        self._others = [other for other in self._others if other is not owner]
        return True

    def _owner(
        self, kept: _Publisher, number: int, sent: int, publishers: int
    ) -> _Publisher | None:
        """Publisher that a message fits best, None where it is that of another."""
        alone = publishers < 2 and not self._others
        if alone and number > kept.number and (sent - kept.sent) * _NANOSECOND < kept.silence:
            return kept
        known = [kept, *self._others]
        following = [each for each in known if number == each.number + 1] or known
        best = min(following, key=lambda each: each.unlikeness(number, sent))
        unlikely = best.unlikeness(number, sent) > math.log(_UNLIKE)
        if number == best.number + 1 and (len(known) >= publishers or not unlikely):
            return best
        return None if unlikely else best


class Lag:
    """Tells whether a node has been behind its messages for too long.

    The quickest message of the last seconds tells how the clocks of both ends differ.
    """

    def __init__(self, longest: float) -> None:
        """Being behind by `longest` [s], for as long, is too long; 0 for never."""
        self._longest = longest or math.inf
        self._least: list[int] = []
        self._since = 0.0
        self._behind_since: float | None = None

    def too_long(self, sent: int) -> bool:
        """Whether, by a message that was sent at an instant [ns], it is behind for too long."""
        now = time.monotonic()
        apart = time.time_ns() - sent
        if not self._least or now - self._since > _CLOCKS_MEMORY:
            self._since = now
            self._least = [*self._least[-1:], apart]
        self._least[-1] = min(self._least[-1], apart)
        if (apart - min(self._least)) / SECOND < self._longest:
            self._behind_since = None
        elif self._behind_since is None:
            self._behind_since = now
        return self._behind_since is not None and now - self._behind_since > self._longest
