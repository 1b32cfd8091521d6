# SPDX-License-Identifier: Apache-2.0
"""Losses are counted from sequence numbers alone, whatever publishers come, go and begin anew."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_nodes.runtime.intake.sequence_gaps import SequenceGaps


def lost(numbers: Iterable[int], publishers: int = 1) -> int:
    gaps = SequenceGaps()
    for number in numbers:
        gaps.take(number, publishers)
    return gaps.lost


@given(st.sets(st.integers(1, 200), min_size=1))
def test_of_one_publisher_every_missing_number_after_the_first_is_lost(numbers: set[int]) -> None:
    missing = max(numbers) - min(numbers) + 1 - len(numbers)
    assert lost(sorted(numbers)) == missing


def test_what_was_sent_before_the_publisher_was_heard_does_not_count() -> None:
    assert lost([1000, 1001]) == 0


@given(st.lists(st.integers(0, 2), max_size=100), st.tuples(*[st.integers(1, 50)] * 3))
def test_of_several_publishers_nothing_is_lost_where_each_goes_on(
    turns: list[int], first: tuple[int, int, int]
) -> None:
    latest = list(first)
    numbers = list(first)
    for publisher in turns:
        latest[publisher] += 1
        numbers.append(latest[publisher])
    assert lost(numbers, publishers=3) == 0


def test_a_loss_is_put_down_to_the_publisher_that_is_closest_behind() -> None:
    # One at 10, 11, the other at 500, 501, [502 and 503 lost], 504.
    assert lost([10, 500, 11, 501, 504, 12, 505], publishers=2) == 2


@pytest.mark.parametrize('at', [1, 7])
def test_a_publisher_that_begins_anew_loses_nothing(at: int) -> None:
    assert lost([5, 6, 7, 8, *range(at, at + 20)]) == 0


def test_one_of_several_that_begins_anew_takes_the_place_of_the_silent_one() -> None:
    # Three nodes report in turns; the one at 9 dies, comes back and begins at 1.
    before = [10, 12, 9, 11, 13, 10, 12, 14]
    after = [1, 13, 15, 2, 14, 16, 3]
    assert lost([*before, *after], publishers=3) == 0


def test_a_publisher_that_died_hides_no_loss_of_the_others() -> None:
    gaps = SequenceGaps()
    for number in (100, 7, 8, 9):
        gaps.take(number, 2)
    for number in (10, 13):
        gaps.take(number, 1)
    assert gaps.lost == 2
