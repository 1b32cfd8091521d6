# SPDX-License-Identifier: Apache-2.0
"""Detection of lost messages, lag and several publishers by sequence numbers and source times."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass

from soliton_linkage_nodes.runtime.stamps import SECOND

_SILENCE = 0.5
"""If a topic has several publishers, a node uses only one, the selected publisher. If the selected
publisher has sent nothing for at least this time [s], another publisher replaces it. This time
limit is necessary, because the ROS graph still lists a killed publisher for 20 s."""
_SILENT_PERIODS = 5
"""Another publisher replaces the selected one only if the selected one has also sent nothing for
this number of its mean message periods [1]."""
_MEMORY = 20
"""The period of a publisher is averaged over about this many messages [1]."""
_GAP_RATIO = 3.0
"""A message probably does not come from a publisher if the time since the publisher's last message
differs from the expected time by more than this factor [1]. The expected time is the mean period
of the publisher times the increase of the sequence number."""
_NANOSECOND = 1e-9
"""One nanosecond [s]."""
_OFFSET_WINDOW = 10.0
"""Length of a time window of `Lag` [s]. In each window, `Lag` determines the smallest delay of a
message, which includes the offset between the clocks of two machines. The windows are short,
because this offset changes with time."""


class SequenceGaps:
    """Counter of the messages of a topic that were published and never received.

    Each publisher numbers its messages 1, 2, 3, ... Normally, message n belongs to the publisher
    whose last received number is the largest one below n. The message belongs to a new publisher
    if no last number is below n. It also belongs to a new publisher if no last number is n - 1 and
    the ROS graph lists more publishers than have sent messages.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._last: list[int] = []

    def take(self, number: int, publishers: int) -> bool:
        """Count the messages missing before this one; return whether its publisher is new."""
        if self._last == [number - 1]:
            self._last[0] = number
            return False
        behind, full = [last for last in self._last if last < number], max(publishers, 1)
        new_publisher = not behind or (number - 1 not in behind and len(self._last) < full)
        if not new_publisher:
            self.lost += number - max(behind) - 1
            self._last.remove(max(behind))
        elif len(self._last) >= full:
            del self._last[0]
        self._last.append(number)
        return new_publisher


@dataclass
class _Newcomer:
    """Sequence number and source time [ns] of the first received message of a publisher.

    `elapsed` is the time from the start of the recorder to the arrival of this message [ns].
    `period` is the mean time between messages of the publisher [ns], infinite while unknown.
    """

    number: int
    sent: int
    elapsed: int
    period: float = math.inf


class MissedStarts:
    """Counter of the messages that new publishers sent before their first received message.

    A recorder uses it, because a recording should contain all messages since its start.
    """

    def __init__(self) -> None:
        self._newcomers: list[_Newcomer] = []

    @property
    def missed(self) -> int:
        """Number of messages sent after the recorder started and before the first received one.

        If the first received message of a publisher has the number n, the publisher contributes
        n - 1. It contributes 0 if its period is unknown. It also contributes 0 if n - 1 periods
        are longer than the time from the start of the recorder to this message, because the
        publisher then probably started before the recorder.
        """
        before = ((each.number - 1, each) for each in self._newcomers)
        return sum(count for count, each in before if count * each.period <= each.elapsed)

    def add(self, number: int, sent: int, elapsed: int) -> None:
        """Record the first received message of a publisher.

        `sent` is its source time [ns]. `elapsed` is the time from the start of the recorder to
        the arrival of the message [ns].
        """
        if number > 1:
            self._newcomers.append(_Newcomer(number, sent, elapsed))

    def take(self, number: int, sent: int) -> None:
        """Use a later message to estimate the message period of its publisher.

        `number` is the sequence number of the message, and `sent` its source time [ns]. Messages
        do not name their publisher. The message is therefore used for each new publisher whose
        first received number is lower by 1 to 20.
        """
        for each in self._newcomers:
            if each.number < number <= each.number + _MEMORY:
                each.period = (sent - each.sent) / (number - each.number)


@dataclass
class _Publisher:
    """Newest sequence number and source time [ns] of a publisher.

    `period` is the mean time between its messages [ns], or NaN after only one message.
    """

    number: int
    sent: int
    period: float = math.nan

    @property
    def silence(self) -> float:
        """Time without messages after which the publisher counts as silent [s]."""
        if math.isnan(self.period):
            return _SILENCE
        return max(_SILENCE, _SILENT_PERIODS * self.period * _NANOSECOND)

    def advance(self, number: int, sent: int) -> int:
        """Record a message and return the number of messages missing before it."""
        apart = (sent - self.sent) / (number - self.number)
        if math.isnan(self.period):
            self.period = apart
        self.period += (min(apart, 2 * self.period) - self.period) / _MEMORY
        missing = number - self.number - 1
        self.number, self.sent = number, sent
        return missing

    def time_mismatch(self, number: int, sent: int) -> float:
        """Return |log(t / t0)| for a message that may come from this publisher.

        t is the time since the last message of the publisher. The expected time t0 is `period`
        times the increase of the sequence number. The result is infinite if the number does not
        increase. If `period` is unknown, or t or t0 is not positive, t and t0 cannot be compared.
        The result is then 0 for the next number. For a later number it is log(`_GAP_RATIO`), the
        largest value of a probable message.
        """
        count, took = number - self.number, sent - self.sent
        if count <= 0:
            return math.inf
        expected = count * self.period
        if not (expected > 0 and took > 0):
            return 0.0 if count == 1 else math.log(_GAP_RATIO)
        return abs(math.log(took / expected))


@dataclass
class Counts:
    """Counters of a `PublisherArbitration`. Several arbitrations may share one object."""

    lost: int = 0
    """Number of messages that were published and never received."""
    foreign: int = 0
    """Number of messages from publishers that were not selected."""
    successions: int = 0
    """Number of times that another publisher replaced a silent one."""


class PublisherArbitration:
    """Filter that keeps only the messages of one selected publisher of a topic.

    The publisher of the first message is selected. When it becomes silent, another one replaces
    it. Messages do not name their publisher. Each message is assigned to the publisher whose last
    sequence number and message period fit best.
    """

    def __init__(self, counts: Counts) -> None:
        self.counts = counts
        self._selected: _Publisher | None = None
        self._others: list[_Publisher] = []
        self._others_since: float | None = None

    def take(self, number: int, sent: int, publishers: Callable[[], int]) -> bool:
        """Return whether to keep a message with a sequence number and a source time `sent` [ns].

        `publishers()` returns the number of publishers.
        """
        selected = self._selected
        if selected is None:
            self._selected = _Publisher(number, sent)
            return True
        if number == selected.number + 1 and not self._others:
            selected.advance(number, sent)
            return True
        return self._assign(selected, number, sent, publishers())

    def _assign(self, selected: _Publisher, number: int, sent: int, publishers: int) -> bool:
        owner = self._owner(selected, number, sent, publishers)
        if owner is selected:
            self.counts.lost += selected.advance(number, sent)
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
        if publishers >= 2 and now - self._others_since < selected.silence:
            self.counts.foreign += 1
            return False
        self.counts.successions += 1
        self._selected, self._others_since = owner, None
        self._others = [other for other in self._others if other is not owner]
        return True

    def _owner(
        self, selected: _Publisher, number: int, sent: int, publishers: int
    ) -> _Publisher | None:
        alone = publishers < 2 and not self._others
        recent = (sent - selected.sent) * _NANOSECOND < selected.silence
        if alone and recent and number > selected.number:
            return selected
        known = [selected, *self._others]
        following = [each for each in known if number == each.number + 1] or known
        best = min(following, key=lambda each: each.time_mismatch(number, sent))
        unlikely = best.time_mismatch(number, sent) > math.log(_GAP_RATIO)
        if number == best.number + 1 and (len(known) >= publishers or not unlikely):
            return best
        return None if unlikely else best


@dataclass
class _Share:
    """Group of publishers that send the same parts of a stream, such as the same joints.

    `parts` are the names of all parts in their kept messages. `taken_at` is the time when the last
    kept message arrived [s].
    """

    arbitration: PublisherArbitration
    parts: set[str]
    taken_at: float


_ABSENCE = 5.0
"""Time without a kept message after which a group of publishers may be discarded [s]. Such groups
are discarded when a message arrives that has no part in common with any group. The message begins
a new group only if there are fewer groups than publishers; if not, it is assigned to the first
group. If groups whose publishers have ended were not discarded, no new group could begin."""


class StreamArbitration:
    """Filter for a stream whose parts, such as joints, may come from different publishers.

    Publishers that send the same parts form a group. From each group, the filter keeps only the
    messages of one publisher, as `PublisherArbitration` does.
    """

    def __init__(self, counts: Counts) -> None:
        self.counts = counts
        self._shares = [_Share(PublisherArbitration(counts), set(), 0.0)]
        self._latest: Callable[[], Collection[str]] = tuple

    def take(
        self,
        number: int,
        sent: int,
        publishers: Callable[[], int],
        parts: Callable[[], Collection[str]] | None = None,
    ) -> bool:
        """Return whether to keep a message with a sequence number and a source time `sent` [ns].

        `publishers()` returns the number of publishers of the topic. `parts()` returns the names
        of the parts in this message, such as joint names. If `parts` is None, all publishers are
        one group.
        """
        first = self._shares[0]
        if parts is None:
            return first.arbitration.take(number, sent, publishers)
        count, now = publishers(), time.monotonic()
        if count < 2 and len(self._shares) == 1:
            kept = first.arbitration.take(number, sent, lambda: count)
            if kept:
                self._latest, first.taken_at = parts, now
            return kept
        first.parts = first.parts or set(self._latest())
        given = parts()
        share = self._share_of(given, count, now)
        others = len(self._shares) - 1
        kept = share.arbitration.take(number, sent, lambda: max(count - others, 1))
        if kept:
            share.parts.update(given)
            share.taken_at = now
        return kept

    def _share_of(self, parts: Collection[str], count: int, now: float) -> _Share:
        for share in self._shares:
            if not share.parts or not share.parts.isdisjoint(parts):
                return share
        self._shares = [each for each in self._shares if now - each.taken_at <= _ABSENCE]
        if self._shares and len(self._shares) >= count:
            return self._shares[0]
        self._shares.append(_Share(PublisherArbitration(self.counts), set(), now))
        return self._shares[-1]


class Lag:
    """Monitor of the lag behind a publisher.

    The lag is the delay of the newest message minus the smallest delay in the last 10 to 20 s. The
    delay of a message is the time from its source time to its arrival.
    """

    def __init__(self, longest: float) -> None:
        """Set the limit `longest` of the lag [s]; at 0, no lag is too long."""
        self._longest = longest or math.inf
        self._least: list[int] = []
        self._since = 0.0
        self._behind_since: float | None = None

    def too_long(self, sent: int) -> bool:
        """Add a message with source time `sent` [ns]; return whether the lag is too long.

        The argument `longest` of the constructor is both a limit and a duration. With 0.5 s, the
        lag is too long if it has stayed at or above 0.5 s for more than 0.5 s.
        """
        now = time.monotonic()
        apart = time.time_ns() - sent
        if not self._least or now - self._since > _OFFSET_WINDOW:
            self._since = now
            self._least = [*self._least[-1:], apart]
        self._least[-1] = min(self._least[-1], apart)
        if (apart - min(self._least)) / SECOND < self._longest:
            self._behind_since = None
        elif self._behind_since is None:
            self._behind_since = now
        return self._behind_since is not None and now - self._behind_since > self._longest
