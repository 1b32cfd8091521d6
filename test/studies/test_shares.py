# SPDX-License-Identifier: Apache-2.0
"""The limits of a proportion interval are the stated number of standard deviations away."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_studies.figures.disorder import score_interval


@given(st.integers(1, 1000), st.floats(0, 1), st.floats(0.5, 3))
def test_a_proportion_is_the_given_number_of_standard_deviations_from_its_limits(
    count, part, deviations
):
    share = round(part * count) / count
    low, high = score_interval(np.array(share), count, deviations)
    assert 0 <= low <= share <= high <= 1
    assert high - low > 1 / (count / deviations**2 + 1) - 1e-15
    for limit in (low, high):
        # A limit has the rounding error of numbers near 1, which is squared near 0 and 1.
        expected = deviations**2 * limit * (1 - limit) / count
        assert (limit - share) ** 2 == pytest.approx(expected, rel=1e-9, abs=1e-13)
