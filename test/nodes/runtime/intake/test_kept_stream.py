# SPDX-License-Identifier: Apache-2.0
"""The messages of the first publisher are kept, those of others are not, losses are counted."""

from __future__ import annotations

import heapq
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_nodes.runtime.intake import kept_stream
from soliton_linkage_nodes.runtime.intake.kept_stream import KeptStream

MILLISECOND = 10**6
PERIODS = st.integers(1, 20)


def stream(who: str, first: int, begin: int, period: int, count: int) -> Iterator[tuple]:
    """Messages in order of time: when [ms], whose, their number."""
    return ((begin + period * n, who, first + n) for n in range(count))


@given(st.integers(1, 10_000), st.integers(1, 10_000), PERIODS, PERIODS, st.integers(1, 300))
def test_of_two_publishers_the_first_is_kept_whatever_their_numbers(
    first: int, second: int, period: int, other_period: int, later: int
) -> None:
    kept = KeptStream()
    both = heapq.merge(
        stream('first', first, 0, 2 * period, 400),
        stream('second', second, 2 * max(later, 2 * period) + 1, 2 * other_period, 100),
    )
    taken = [who for at, who, number in both if kept.take(number, at * MILLISECOND, lambda: 2)]
    # Where numbers and times say the same, one or two may be taken for the other's.
    assert taken.count('second') <= 2
    assert taken.count('first') >= 398
    assert kept.lost <= 2


@given(st.lists(st.booleans(), min_size=1, max_size=200))
def test_what_never_came_of_one_publisher_is_lost(came: list[bool]) -> None:
    kept = KeptStream()
    numbers = [number for number, here in enumerate([True, *came, True]) if here]
    for number in numbers:
        assert kept.take(number, 2 * MILLISECOND * number, lambda: 1)
    assert kept.lost == len(came) + 2 - len(numbers)


@given(st.lists(st.tuples(st.integers(1, 50), st.integers(0, 400)), min_size=1, max_size=50))
def test_one_that_is_alone_is_kept_to_however_unevenly_its_messages_come(
    steps: list[tuple[int, int]],
) -> None:
    kept = KeptStream()
    number = sent = 0
    for ahead, elapsed in [*[(1, 2)] * 20, *steps]:
        number, sent = number + ahead, sent + elapsed
        assert kept.take(number, sent * MILLISECOND, lambda: 1)
    assert (kept.successions, kept.foreign) == (0, 0)
    assert kept.lost == sum(ahead - 1 for ahead, _ in steps)


def test_one_that_falls_silent_is_succeeded_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr(kept_stream.time, 'monotonic', lambda: now[0])
    kept = KeptStream()
    for number in range(1, 100):
        assert kept.take(number, 2 * MILLISECOND * number, lambda: 2)
    taken = []
    for number in range(1, 1000):
        now[0] += 0.002
        taken.append(kept.take(number, 10**9 + 2 * MILLISECOND * number, lambda: 2))
    assert 0.4 < 0.002 * taken.index(True) < 0.6
    assert all(taken[taken.index(True) :])
    assert (kept.successions, kept.lost) == (1, 0)
    assert kept.foreign == taken.index(True)


def test_one_that_is_gone_is_succeeded_at_once() -> None:
    kept = KeptStream()
    for number in range(5000, 5100):
        assert kept.take(number, 2 * MILLISECOND * number, lambda: 1)
    for number in range(1, 100):
        assert kept.take(number, 10**12 + 2 * MILLISECOND * number, lambda: 1)
    assert (kept.lost, kept.foreign, kept.successions) == (0, 0, 1)
