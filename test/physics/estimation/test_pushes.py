# SPDX-License-Identifier: Apache-2.0
"""A push acts from the first frame that is not earlier, whenever it is told before that."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from soliton_linkage.estimation.frames import WaitingPushes
from soliton_linkage.linkage.chain import Array

SECOND = 10**9
DAY = 24 * 3600 * SECOND
ONE, OTHER, LAST = (np.full(3, float(number)) for number in range(3))


def due(waiting: WaitingPushes, stamp: int) -> list[tuple[Array, int]]:
    """Which act from a frame on, and how long ago they did [ns]."""
    return [(push.impulses, round(push.ago * SECOND)) for push in waiting.due(stamp)]


@pytest.mark.parametrize('told', list(permutations([(15, ONE), (20, OTHER), (31, LAST)])))
def test_each_acts_from_the_first_frame_that_is_not_earlier(told: list[tuple[int, Array]]) -> None:
    waiting = WaitingPushes()
    assert waiting.due(10) == []
    for stamp, impulses in told:
        waiting.add(stamp, impulses)
    assert sorted(ago for _, ago in due(waiting, 20)) == [0, 5]
    assert waiting.due(30) == []
    assert due(waiting, 40) == [(LAST, 9)]
    assert waiting.due(50) == []
    assert waiting.late == 0


@pytest.mark.parametrize('stamp', [19, 20])
def test_one_that_comes_after_its_frame_is_counted_and_does_nothing(stamp: int) -> None:
    waiting = WaitingPushes()
    waiting.due(20)
    waiting.add(stamp, ONE)
    assert waiting.due(30) == []
    assert waiting.late == 1


@pytest.mark.parametrize('stamp', [None, 0, 2 * DAY])
def test_one_of_no_clock_or_another_acts_from_the_next_frame(stamp: int | None) -> None:
    waiting = WaitingPushes()
    waiting.due(DAY)
    waiting.add(stamp, ONE)
    assert due(waiting, DAY + 1) == [(ONE, 0)]
    assert waiting.late == 0


@pytest.mark.parametrize('behind', [1, 5 * SECOND, 600 * SECOND])
def test_one_is_no_earlier_for_who_is_behind(behind: int) -> None:
    waiting = WaitingPushes()
    waiting.due(DAY)
    waiting.add(DAY + behind + 1, ONE)
    assert waiting.due(DAY + behind) == []
    assert due(waiting, DAY + behind + 1) == [(ONE, 0)]


def test_none_outlives_a_clock_that_is_set_back() -> None:
    waiting = WaitingPushes()
    waiting.due(50 * SECOND)
    waiting.add(50 * SECOND + 1, ONE)
    assert waiting.due(SECOND) == []
    assert waiting.due(51 * SECOND) == []
