# SPDX-License-Identifier: Apache-2.0
"""Splines against those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from soliton_linkage.orbit.orbit_loops import spline


def test_splines_are_those_of_scipy() -> None:
    random = np.random.default_rng(1)
    places = np.cumsum(0.1 + random.random(40))
    expected = make_interp_spline(places, random.standard_normal((40, 3)), k=7)
    found = np.empty(3)
    for at in [*places, *random.uniform(places[0], places[-1], 50)]:
        spline(expected.t, expected.c, float(at), found)
        assert found == pytest.approx(expected(at), rel=1e-9, abs=1e-9)
