# SPDX-License-Identifier: Apache-2.0
"""Medians against those of numpy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from soliton_linkage.estimation.robust import clipped_deviation, median, robust_deviation
from soliton_linkage.linkage.chain import Array


@pytest.mark.parametrize('count', [1, 2, 5, 8, 101, 1000])
def test_the_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).standard_normal(count)
    assert median(values.copy()) == np.median(values)


@pytest.mark.parametrize('deviation', [robust_deviation, clipped_deviation])
def test_the_deviation_of_normal_noise_is_found_in_spite_of_outliers(
    deviation: Callable[[Array], float],
) -> None:
    noise = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    assert deviation(np.abs(noise)) == pytest.approx(0.3, rel=0.02)
    noise[:200] = 1e3
    assert deviation(np.abs(noise)) == pytest.approx(0.3, rel=0.04)
    assert deviation(np.zeros(0)) == 0.0


def test_sizes_that_are_clipped_tell_more_than_their_median() -> None:
    noise = np.abs(np.random.default_rng(2).standard_normal((2000, 30)))
    scatter = [
        np.std([each(row.copy()) for row in noise])
        for each in (robust_deviation, clipped_deviation)
    ]
    assert scatter[1] < 0.7 * scatter[0]
