# SPDX-License-Identifier: Apache-2.0
"""White noise of rates is told from the motion of phonons, where frames are close enough."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.estimation.noise import RateNoise
from soliton_linkage.linear.bands import band_edges
from soliton_linkage.linear.normal_modes import normal_modes
from soliton_linkage.linkage.chain import Array, Chain

CHAIN = Chain(number_of_rotors=30)
PERIOD = 0.1 / band_edges(CHAIN)[1]


def phonons(times: Array, generator: np.random.Generator) -> Array:
    """Rates of all phonons at once, of a mean square of 1 rad^2/s^2, shape (T, N)."""
    modes = normal_modes(CHAIN, CHAIN.uniform_state(1))
    phases = generator.uniform(0, 2 * math.pi, len(modes.frequencies))
    waves = np.cos(np.outer(times, modes.frequencies) + phases)
    rates = waves @ modes.shapes.T
    return np.asarray(rates / rates.std())


def noise_of(times: Array, rates: Array) -> float:
    noise = RateNoise(CHAIN)
    for time, frame in zip(times.tolist(), rates, strict=True):
        noise.update(time, frame)
    return noise.deviation


@pytest.mark.parametrize('deviation', [0.01, 1.0])
def test_white_noise_is_measured(deviation: float) -> None:
    generator = np.random.default_rng(5)
    times = PERIOD * np.arange(4000)
    rates = deviation * generator.standard_normal((4000, 30))
    rates[:, 7] = np.nan
    assert noise_of(times, rates) == pytest.approx(deviation, rel=0.02)


def test_phonons_are_no_noise() -> None:
    generator = np.random.default_rng(6)
    times = PERIOD * np.arange(500)
    waves = phonons(times, generator)
    assert noise_of(times, waves) < 0.01
    noisy = waves + 0.1 * generator.standard_normal(waves.shape)
    assert noise_of(times, noisy) == pytest.approx(0.1, rel=0.05)


def test_what_cannot_be_told_is_none() -> None:
    generator = np.random.default_rng(7)
    rates = generator.standard_normal((100, 30))
    assert math.isnan(noise_of(10 * PERIOD * np.arange(100), rates))
    uneven = noise_of(PERIOD * np.cumsum(np.arange(100) % 2 + 1), rates)
    assert uneven == pytest.approx(1, rel=0.1)
    assert math.isnan(noise_of(PERIOD * np.arange(2), rates[:2]))
    assert math.isnan(noise_of(PERIOD * np.arange(100), np.full((100, 30), np.nan)))


def test_a_restart_forgets() -> None:
    noise = RateNoise(CHAIN)
    for number in range(10):
        noise.update(PERIOD * number, np.full(30, (-1.0) ** number))
    assert noise.deviation > 1
    noise.restart()
    assert math.isnan(noise.deviation)
