# SPDX-License-Identifier: Apache-2.0
"""Offsets of encoders against a naive least squares fit and by Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets
from soliton_linkage.estimation.settings import OffsetSettings

NOISE, REST = 0.05, 0.03
SETTINGS = OffsetSettings(rest_angle_deviation=REST)


def test_offsets_are_those_of_a_least_squares_fit_with_priors() -> None:
    random = np.random.default_rng(1)
    residuals = random.normal(0.2, NOISE, (30, 1))
    sides = random.choice([-1, 0, 1], (30, 1))
    offsets = EncoderOffsets(1, SETTINGS)
    for each, side in zip(residuals, sides, strict=True):
        offsets.update(each, side, NOISE**2)
    seen = sides[:, 0] != 0
    rows = np.column_stack([np.ones(30), sides[:, 0]])[seen] / NOISE
    matrix = np.concatenate([rows, np.diag([math.sqrt(3) / math.pi, 1 / REST])])
    right = np.concatenate([residuals[seen, 0] / NOISE, [0, 0]])
    covariance = np.linalg.inv(matrix.T @ matrix)
    assert offsets.values[0] == pytest.approx((covariance @ matrix.T @ right)[0], rel=1e-9)
    assert offsets.deviations[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)


@pytest.mark.parametrize('passed', [False, True])
def test_an_offset_is_told_from_a_rest_angle_once_the_wall_has_passed(passed: bool) -> None:
    random, rotors, frames = np.random.default_rng(2), 400, 100
    true, rest = random.normal(0, 0.3, rotors), random.normal(0, REST, rotors)
    offsets = EncoderOffsets(rotors, SETTINGS)
    for frame in range(frames):
        side = -1 if passed and frame >= frames // 2 else 1
        noisy = true + side * rest + random.normal(0, NOISE, rotors)
        offsets.update(noisy, np.full(rotors, side), NOISE**2)
    of_noise = NOISE / np.sqrt(frames)
    expected = of_noise if passed else np.hypot(of_noise, REST)
    assert offsets.deviations == pytest.approx(np.full(rotors, expected), rel=0.01)
    scores = (offsets.values - true) / offsets.deviations
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], rotors)
    assert low < scores @ scores < high


def test_unknown_angles_and_rotors_about_the_wall_teach_nothing() -> None:
    offsets = EncoderOffsets(3)
    before = offsets.deviations.copy()
    offsets.update(np.array([np.nan, 1.0, 1.0]), np.array([1, 0, -1]), NOISE**2)
    assert offsets.deviations[:2] == pytest.approx(before[:2])
    assert offsets.deviations[2] < 0.1


def test_only_sure_offsets_are_corrected() -> None:
    random, offsets = np.random.default_rng(3), EncoderOffsets(50, SETTINGS)
    true = np.zeros(50)
    true[7] = 0.5
    for frame in range(200):
        side = np.full(50, 1 if frame % 2 else -1)
        offsets.update(true + random.normal(0, NOISE, 50), side, NOISE**2)
    assert np.flatnonzero(offsets.corrections).tolist() == [7]
    assert offsets.corrections[7] == offsets.values[7]
