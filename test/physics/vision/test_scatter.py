# SPDX-License-Identifier: Apache-2.0
"""What dots scatter more than their pixels say is learnt, of all and of those that move."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.vision.scatter import Scatter

STILL, FAST = np.zeros(30), np.full(10, 2.0)
NEW = np.zeros(1, dtype=bool)


def test_pixels_are_believed_to_begin_with() -> None:
    assert Scatter().factors(np.array([0.0, 2.0]), NEW).tolist() == [1.0, 1.0]


def test_the_scatter_of_all_dots_and_of_those_that_move_is_found() -> None:
    random, scatter = np.random.default_rng(1), Scatter()
    for _ in range(400):
        errors = np.concatenate([0.5 * random.normal(size=30), 2.0 * random.normal(size=10)])
        scatter.take(errors, np.concatenate([STILL, FAST]))
    of_all, of_moving = scatter.factors(np.array([0.0, 2.0]), NEW)
    assert of_all == pytest.approx(np.sqrt((30 * 0.5**2 + 10 * 2.0**2) / 40), rel=0.1)
    assert of_moving == pytest.approx(2.0, rel=0.1)


def test_a_dot_of_another_rotor_counts_for_little() -> None:
    random, scatter = np.random.default_rng(2), Scatter()
    for _ in range(100):
        errors = random.normal(size=30)
        errors[0] = 1e6
        scatter.take(errors, STILL)
    assert scatter.factors(np.zeros(1), NEW)[0] < 1.5


def test_dots_that_were_repeated_for_long_are_off_by_what_they_jump() -> None:
    random, scatter = np.random.default_rng(3), Scatter()
    for _ in range(200):
        scatter.take(random.normal(size=30), STILL)
        scatter.take_jumps(3.0 * random.normal(size=4), np.full(4, 10.0))
    ways, repeated = np.zeros(2), np.array([False, True])
    assert scatter.factors(ways, repeated) == pytest.approx([1.0, 3.0], rel=0.1)
