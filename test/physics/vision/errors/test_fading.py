# SPDX-License-Identifier: Apache-2.0
"""Mean squares of what was seen of late."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.vision.errors.fading import FadingSquare


def test_it_goes_from_what_is_expected_to_what_is_seen_and_passes_over_others() -> None:
    random, square = np.random.default_rng(1), FadingSquare()
    assert square.square(4.0) == 4.0
    for _ in range(100):
        square.take(np.append(2.0 * random.normal(size=40), [np.nan, 1e6]))
    assert square.square() == pytest.approx(4.0, rel=0.1)


def test_numbers_count_for_as_many_pictures_as_they_are_for() -> None:
    square = FadingSquare()
    for _ in range(1000):
        square.take_for(np.array([1.0, 3.0]), np.array([30.0, 10.0]))
    assert square.square() == pytest.approx((30 * 1 + 10 * 9) / 40, rel=0.01)
