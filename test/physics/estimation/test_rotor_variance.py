# SPDX-License-Identifier: Apache-2.0
"""How far waves beside the orbit keep a wall from being steady."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.estimation.measurement import FrameLikelihood
from soliton_linkage.estimation.noise import ResidualVariance
from soliton_linkage.estimation.settings import DEFAULTS

NOISE, SWING, ROTORS = 0.01, 2.0, 40


def beside(wave: float) -> ResidualVariance:
    """That of a wall whose rotors stand waves [rad] off the orbit, with the noise."""
    random = np.random.default_rng(5)
    variance = ResidualVariance(SWING, NOISE, DEFAULTS)
    likelihood = FrameLikelihood(SWING, DEFAULTS.likelihood)
    tangent = np.exp(-0.5 * (np.arange(ROTORS) - ROTORS / 2) ** 2)
    standing = wave * math.sqrt(2) * np.sin(2.4 * np.arange(ROTORS))
    for _ in range(200):
        off = standing + NOISE * random.standard_normal(ROTORS)
        variance.learn(likelihood.linearise(2.0, 0, tangent, off, NOISE**2 + wave**2))
    return variance


def test_without_waves_a_wall_is_calm_at_any_speed() -> None:
    assert beside(0.0).calm(0.1) > 0.9
    assert ResidualVariance(SWING, NOISE, DEFAULTS).calm(0.0) == 1.0


def test_waves_disturb_a_wall_by_their_share_of_its_motion_and_of_the_noise() -> None:
    def odds(wave: float, rate: float) -> float:
        return 1 / beside(wave).calm(rate) - 1

    for wave in (0.01, 0.03):
        assert odds(wave, 0.2) == pytest.approx(4 * odds(wave, 0.4))
    # Squares of waves where these are less than the noise, and their squares where they are more.
    assert odds(0.016, 0.3) / odds(0.008, 0.3) > 4
    assert odds(0.2, 0.3) / odds(0.1, 0.3) == pytest.approx(16, rel=0.1)


def test_a_wall_at_rest_among_waves_is_never_steady() -> None:
    assert beside(0.02).calm(0.0) == 0.0
