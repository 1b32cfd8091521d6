# SPDX-License-Identifier: Apache-2.0
"""The noise of readings, while a soliton passes a few of the rotors at a time."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.identification.residuals import noise_of
from soliton_linkage.linkage.chain import Array

TIMES = np.arange(1000)[:, None]
SPREADS = np.full((1000, 12), 2.0)


def passing() -> Array:
    """Angles of rotors that turn one after the other [rad], (T, N)."""
    return np.asarray(0.97 * np.tanh((TIMES - 80 * np.arange(12)) / 10))


def test_noise_is_told_though_rotors_turn() -> None:
    noise = 0.01 * np.random.default_rng(0).standard_normal(SPREADS.shape)
    assert noise_of(passing() + noise, SPREADS) == pytest.approx(0.01 / 2, rel=0.03)


@pytest.mark.parametrize('step', [2 * np.pi / 4096, 0.01])
def test_of_rounded_readings_it_is_that_of_rounding_though_rotors_rest(step: float) -> None:
    rounded = step * np.rint(passing() / step)
    assert noise_of(rounded, SPREADS) == pytest.approx(step / np.sqrt(12) / 2, rel=1e-9)
    assert noise_of(rounded[:40, 6:], SPREADS[:40, 6:]) == 0
