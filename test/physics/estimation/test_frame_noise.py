# SPDX-License-Identifier: Apache-2.0
"""What a frame shows beside the orbit, and how its noise is told from what lasts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.estimation.measurement import FrameLikelihood, LinearisedMeasurement
from soliton_linkage.estimation.noise import FrameNoise
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.linkage.chain import Array

TANGENT = np.array([0.1, 0.5, 0.7, -0.5, 0.05])
FIRST, ROTORS = 3, 12


def view_of(differences: Array, variance: float = 1.0) -> LinearisedMeasurement:
    likelihood = FrameLikelihood(2.0, DEFAULTS.likelihood)
    return likelihood.linearise(2.0, FIRST, TANGENT, differences.copy(), variance)


@pytest.mark.parametrize(('wave', 'angle'), [(0.0, 0.0), (0.1, 0.05), (0.1, 0.5)])
@pytest.mark.parametrize('given', [None, 0.02])
def test_noise_is_told_from_waves(wave: float, angle: float, given: float | None) -> None:
    random, noise = np.random.default_rng(3), FrameNoise(given)
    phases = random.uniform(0, 2 * math.pi, ROTORS)
    for frame in range(3000):
        differences = wave * np.sin(angle * frame + phases)
        differences += 0.02 * random.standard_normal(ROTORS)
        noise.update(view_of(differences))
    # At half a radian a frame an eightieth of the waves' amplitude is taken for noise.
    rel = 0.05 if angle < 0.1 else 0.2
    assert noise.deviation == pytest.approx(0.02, rel=rel)
    assert math.sqrt(noise.lasting) == pytest.approx(wave / math.sqrt(2), rel=0.1, abs=1e-9)
    expected = math.hypot(0.02, wave / math.sqrt(2))
    assert math.sqrt(noise.scatter) == pytest.approx(expected, rel=0.25)


def test_a_noise_that_is_given_too_small_is_overruled() -> None:
    random, noise = np.random.default_rng(4), FrameNoise(0.01)
    for _ in range(500):
        noise.update(view_of(0.02 * random.standard_normal(ROTORS)))
    assert noise.deviation == pytest.approx(0.02, rel=0.1)
    assert noise.degrees_of_freedom > 1000


def test_the_misfit_is_of_the_last_60_frames() -> None:
    random, noise = np.random.default_rng(5), FrameNoise(0.01)
    for _ in range(3000):
        noise.update(view_of(0.01 * random.standard_normal(ROTORS)))
    for _ in range(60):
        noise.update(view_of(0.1 * random.standard_normal(ROTORS)))
    share = 1 - math.exp(-1)
    assert noise.scatter == pytest.approx(share * 0.01 + (1 - share) * 1e-4, rel=0.2)
