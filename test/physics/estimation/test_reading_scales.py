# SPDX-License-Identifier: Apache-2.0
"""Readings count by their stated deviations: places are told better, and their own are true."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage.estimation.analyser import Analyser
from soliton_linkage.estimation.measurement import ReadingScales
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

ORBIT = UniformOrbit(Chain(number_of_rotors=14))
PERIOD, RATE, START = 1e-3, 9.6, 6.0
NOISE = 0.005
"""Of every second rotor [rad]; that of the others is ten times it."""
DEVIATIONS = np.where(np.arange(14) % 2, 10 * NOISE, NOISE)


def normalised_and_errors(
    seed: int, told: bool, noise: float | None
) -> tuple[float, float, float]:
    """Error of the arc over what is stated [1], that error [rad], and the noise found [rad]."""
    random, tracker = np.random.default_rng(seed), OrbitFilter(ORBIT, noise)
    for time in (PERIOD * np.arange(120)).tolist():
        angles = ORBIT.configuration(START + RATE * time)
        angles = angles + DEVIATIONS * random.standard_normal(len(angles))
        estimate = tracker.update(time, angles, DEVIATIONS if told else None)
    error = math.remainder(estimate.arc - START - RATE * estimate.time, ORBIT.length)
    return error / estimate.arc_deviation, error, estimate.noise


def runs(told: bool, noise: float | None = None, count: int = 30) -> Array:
    """Normalised errors, errors and noises, shape (3, runs)."""
    return np.transpose([normalised_and_errors(seed, told, noise) for seed in range(count)])


@pytest.mark.parametrize('noise', [None, NOISE])
def test_errors_are_as_stated_and_smaller_where_half_the_readings_have_ten_times_the_noise(
    noise: float | None,
) -> None:
    normalised, errors, noises = runs(told=True, noise=noise)
    assert 0.7 < np.sqrt(np.mean(normalised**2)) < 1.3
    untold = runs(told=False)[1]
    assert np.sqrt(np.mean(untold**2)) > 2 * np.sqrt(np.mean(errors**2))
    usual = noise or 1 / math.sqrt(np.mean(DEVIATIONS**-2))
    # What may be beside the orbit at first has all readings count alike.
    assert (noises > 0.9 * usual).all()
    assert (noises < 0.5 * np.sqrt(np.mean(DEVIATIONS**2))).all()


def test_equal_deviations_and_those_that_are_not_known_change_nothing() -> None:
    random = np.random.default_rng(1)
    chain = Chain(number_of_rotors=14)
    analysers = [Analyser(chain) for _ in range(3)]
    told = [None, np.full(14, 0.02), np.full(14, np.nan)]
    for number in range(30):
        angles = ORBIT.configuration(START + RATE * PERIOD * number)
        angles = angles + 0.02 * random.standard_normal(14)
        stamp = number * 10**6
        found = [
            each.analyse(stamp, angles, None, deviations)
            for each, deviations in zip(analysers, told, strict=True)
        ]
        estimates = [None if each is None else each.estimate for each in found]
        assert estimates[2] == estimates[0]
        assert estimates[1] is not None
        assert estimates[0] is not None
        assert estimates[1].arc == pytest.approx(estimates[0].arc, abs=1e-12)


def test_a_usual_deviation_is_that_with_which_readings_would_tell_as_much() -> None:
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


def test_what_is_beside_the_orbit_makes_readings_alike() -> None:
    scales = ReadingScales(0.01)
    scales.set_deviations(np.array([0.01, 0.1]))
    noise, beside = 0.01**2, 0.2**2
    scaled = scales.of_frame(noise, noise + beside)
    assert scaled is not None
    np.testing.assert_allclose(scaled**2 * (noise + beside), [noise + beside, 0.1**2 + beside])


@pytest.mark.parametrize('wrong', [0.0, -0.1, np.inf])
def test_deviations_that_are_none_are_refused(wrong: float) -> None:
    analyser = Analyser(Chain(number_of_rotors=14))
    deviations = np.full(14, 0.01)
    deviations[3] = wrong
    with pytest.raises(ValueError, match=rf'rotor 3 = {wrong:g} rad .* above 0'):
        analyser.analyse(0, np.zeros(14), None, deviations)
    with pytest.raises(ValueError, match='14'):
        analyser.analyse(0, np.zeros(14), None, np.ones(13))
