# SPDX-License-Identifier: Apache-2.0
"""Weights of readings by their stated deviations."""

import math
from functools import lru_cache

import numpy as np
import pytest
from chains import FLIPPER
from orbits import uniform_orbit

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.measurement import ReadingScales
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.linkage.chain import Array, Chain

PERIOD, RATE, START = 1e-3, 9.6, 6.0
NOISE = 0.005
"""Noise of every second rotor [rad]; the others have ten times as much."""
DEVIATIONS = np.where(np.arange(14) % 2, 10 * NOISE, NOISE)


def normalised_and_errors(
    seed: int, weighted: bool, noise: float | None
) -> tuple[float, float, float]:
    """Return normalised error of the arc [1], error [rad], and estimated noise [rad]."""
    orbit = uniform_orbit(FLIPPER, 14)
    random, tracker = np.random.default_rng(seed), OrbitFilter(orbit, noise)
    for time in (PERIOD * np.arange(120)).tolist():
        angles = orbit.configuration(START + RATE * time)
        angles = angles + DEVIATIONS * random.standard_normal(len(angles))
        estimate = tracker.update(time, angles, DEVIATIONS if weighted else None)
    error = math.remainder(estimate.arc - START - RATE * estimate.time, orbit.length)
    return error / estimate.arc_deviation, error, estimate.noise


@lru_cache
def runs(weighted: bool, noise: float | None = None, count: int = 20) -> Array:
    """Return normalised errors, errors and noises, shape (3, runs)."""
    return np.transpose([normalised_and_errors(seed, weighted, noise) for seed in range(count)])


@pytest.mark.parametrize('noise', [None, NOISE])
def test_stated_deviations_of_readings_reduce_the_error(noise):
    normalised, errors, noises = runs(weighted=True, noise=noise)
    assert 0.7 < np.sqrt(np.mean(normalised**2)) < 1.3
    unknown = runs(weighted=False)[1]
    assert np.sqrt(np.mean(unknown**2)) > 2 * np.sqrt(np.mean(errors**2))
    usual = noise or 1 / math.sqrt(np.mean(DEVIATIONS**-2))
    # The prior deformation equalises the readings at first.
    assert (noises > 0.9 * usual).all()
    assert (noises < 0.5 * np.sqrt(np.mean(DEVIATIONS**2))).all()


def test_equal_and_unknown_deviations_have_no_effect():
    random = np.random.default_rng(1)
    chain = Chain(number_of_rotors=14)
    analysers = [Analyser(chain) for _ in range(3)]
    weighted = [None, np.full(14, 0.02), np.full(14, np.nan)]
    for number in range(30):
        angles = uniform_orbit(FLIPPER, 14).configuration(START + RATE * PERIOD * number)
        angles = angles + 0.02 * random.standard_normal(14)
        stamp = number * 10**6
        found = [
            each.analyse(stamp, angles, None, deviations)
            for each, deviations in zip(analysers, weighted, strict=True)
        ]
        estimates = [None if each is None else each.estimate for each in found]
        assert estimates[2] == estimates[0]
        assert estimates[1] is not None
        assert estimates[0] is not None
        assert estimates[1].arc == pytest.approx(estimates[0].arc, abs=1e-12)


def test_the_usual_deviation_preserves_the_information():
    scales = ReadingScales()
    scales.set_deviations(np.array([0.01, 0.02, np.nan]))
    scaled = scales.of_frame(1e-4, 1e-4)
    assert scaled is not None
    assert np.mean(scaled[:2] ** -2) == pytest.approx(1.0)
    assert scaled[2] == 1.0
    scales.set_deviations(np.array([0.1, np.nan, np.nan]))
    later = scales.of_frame(1e-4, 1e-4)
    assert later is not None
    assert later[0] == pytest.approx(10 * scaled[0])
    for none in (np.full(3, np.nan), None):
        scales.set_deviations(none)
        assert scales.of_frame(1e-4, 1e-4) is None


def test_residuals_beside_the_orbit_equalise_the_readings():
    scales = ReadingScales(0.01)
    scales.set_deviations(np.array([0.01, 0.1]))
    noise, beside = 0.01**2, 0.2**2
    scaled = scales.of_frame(noise, noise + beside)
    assert scaled is not None
    np.testing.assert_allclose(scaled**2 * (noise + beside), [noise + beside, 0.1**2 + beside])


def test_invalid_deviations_are_rejected():
    for wrong in [0.0, -0.1, np.inf]:
        analyser = Analyser(Chain(number_of_rotors=14))
        deviations = np.full(14, 0.01)
        deviations[3] = wrong
        with pytest.raises(ValueError, match=rf'rotor 3 = {wrong:g} rad .* above 0'):
            analyser.analyse(0, np.zeros(14), None, deviations)
        with pytest.raises(ValueError, match='14'):
            analyser.analyse(0, np.zeros(14), None, np.ones(13))
