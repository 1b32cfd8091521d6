# SPDX-License-Identifier: Apache-2.0
"""Medians against those of numpy."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.estimation.noise import FREEDOMS_OF_MEDIAN, median, robust_deviation


@pytest.mark.parametrize('count', [1, 2, 5, 8, 101, 1000])
def test_the_median_is_that_of_numpy(count: int) -> None:
    values = np.random.default_rng(count).standard_normal(count)
    assert median(values.copy()) == np.median(values)


def test_the_deviation_of_normal_noise_is_found_in_spite_of_outliers() -> None:
    noise = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    noise[:200] = 1e3
    assert robust_deviation(np.abs(noise)) == pytest.approx(0.3, rel=0.03)
    assert robust_deviation(np.zeros(0)) == 0.0


def test_the_deviation_by_the_median_is_as_sure_as_that_of_fewer_errors() -> None:
    noise = np.abs(np.random.default_rng(2).standard_normal((1000, 1001)))
    scatter = np.std([robust_deviation(row) for row in noise])
    assert scatter == pytest.approx(1 / np.sqrt(2 * FREEDOMS_OF_MEDIAN * 1001), rel=0.1)
