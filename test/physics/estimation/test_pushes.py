# SPDX-License-Identifier: Apache-2.0
"""A push acts from the first frame that is later than it, whenever it is told before that."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from soliton_linkage.estimation.pushes import Push, WaitingPushes, pushed_rate

SECOND = 10**9
ONE, OTHER, LAST = (Push(np.full(3, float(number))) for number in range(3))


@pytest.mark.parametrize('told', list(permutations([(15, ONE), (20, OTHER), (31, LAST)])))
def test_each_acts_from_the_first_frame_that_is_later(told: list[tuple[int, Push]]) -> None:
    waiting = WaitingPushes()
    assert waiting.due(10) == []
    for stamp, push in told:
        waiting.add(stamp, push)
    assert waiting.due(20) == [ONE]
    assert waiting.due(30) == [OTHER]
    assert waiting.due(40) == [LAST]
    assert waiting.due(50) == []
    assert waiting.late == 0


def test_one_that_comes_after_its_frame_is_counted_and_does_nothing() -> None:
    waiting = WaitingPushes()
    waiting.due(20)
    waiting.add(19, ONE)
    assert waiting.due(30) == []
    assert waiting.late == 1


@pytest.mark.parametrize('stamp', [None, 0, 100 * SECOND])
def test_one_of_no_clock_or_another_acts_from_the_next_frame(stamp: int | None) -> None:
    waiting = WaitingPushes()
    waiting.due(50 * SECOND)
    waiting.add(stamp, ONE)
    assert waiting.due(50 * SECOND + 1) == [ONE]
    assert waiting.late == 0


def test_none_outlives_a_clock_that_is_set_back() -> None:
    waiting = WaitingPushes()
    waiting.due(50 * SECOND)
    waiting.add(50 * SECOND, ONE)
    assert waiting.due(SECOND) == []
    assert waiting.due(51 * SECOND) == []


@pytest.mark.parametrize('rate', [-3.0, 0.0, 0.5])
@pytest.mark.parametrize('added', [-2.0, 0.0, 7.0])
def test_momentum_adds_up(rate: float, added: float) -> None:
    mu = 0.03
    pushed = pushed_rate(rate, added, mu)
    before, after = (each + 2 * mu * each**3 for each in (rate, pushed))
    assert after == pytest.approx(before + added)
