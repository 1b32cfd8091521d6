# SPDX-License-Identifier: Apache-2.0
"""Likelihood of frames, noise of angles, and variance of residuals."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from soliton_linkage.estimation.likelihood import frame_likelihood
from soliton_linkage.estimation.measurement import FrameLikelihood, LinearisedMeasurement
from soliton_linkage.estimation.noise import FrameNoise, ResidualVariance, StampJitter
from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.linkage.chain import Array

GIVEN = DEFAULTS.likelihood
TANGENT = np.array([0.1, 0.5, 0.7, -0.5, 0.05])
FIRST, ROTORS = 3, 12


def likelihood() -> FrameLikelihood:
    return FrameLikelihood(2.0, GIVEN)


def test_the_density_integrates_to_one():
    for sigma in [0.01, 0.1]:
        floor = likelihood().floor(sigma**2)

        def density(apart: float, sigma: float = sigma, floor: float = floor) -> float:
            return math.exp(frame_likelihood(np.array([apart]), sigma**2, GIVEN.bound, floor))

        whole = quad(density, -math.pi, math.pi, points=(-3 * sigma, 0, 3 * sigma), limit=200)[0]
        of_nothing = 2 * math.pi * math.exp(floor)
        assert of_nothing / whole == pytest.approx(GIVEN.wrong, rel=0.05)


def test_the_step_agrees_with_weighted_least_squares():
    differences = np.random.default_rng(1).normal(0, 0.1, ROTORS)
    differences[[0, 5]] = np.nan
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences.copy(), 0.1**2)
    used = np.array([True, True, False, True, True])
    about, weights = differences[FIRST : FIRST + 5][used], view.weights[FIRST : FIRST + 5][used]
    ahead = weights * TANGENT[used] @ about / (weights @ TANGENT[used] ** 2)
    assert view.arc == pytest.approx(2.0 + ahead)
    assert view.information == pytest.approx(weights @ TANGENT[used] ** 2)
    left = view.inlying[FIRST : FIRST + 5]
    assert left[used] == pytest.approx(about - ahead * TANGENT[used])
    assert left[2] == 0
    assert view.known == 10
    assert view.degrees_of_freedom == 3
    assert np.isnan(view.residuals).nonzero()[0].tolist() == [0, 5]


def test_no_single_reading_moves_the_arc_by_more_than_the_bound():
    for rotor in [1, 2, 3]:
        sigma = 0.01
        for size in np.geomspace(0.001, 3.0, 60).tolist():
            differences = np.zeros(ROTORS)
            differences[FIRST + rotor] = size
            view = likelihood().linearise(2.0, FIRST, TANGENT, differences, sigma**2)
            moved = abs(view.arc - 2.0) * math.sqrt(view.information) / sigma
            assert moved < GIVEN.bound


def test_an_uncertain_arc_does_not_turn_moving_rotors_into_outliers():
    differences = np.zeros(ROTORS)
    differences[FIRST : FIRST + 5] = 0.3 * TANGENT
    assert likelihood().linearise(2.0, FIRST, TANGENT, differences.copy(), 0.01**2).outliers
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences, 0.01**2, spread=0.15**2)
    assert not view.outliers
    assert view.arc == pytest.approx(2.3)


def test_doubtful_rotors_do_not_count():
    differences = np.full(ROTORS, 0.001)
    doubtful = np.zeros(ROTORS, dtype=np.bool_)
    doubtful[FIRST + 2] = True
    view = likelihood().linearise(2.0, FIRST, TANGENT, differences, 0.01**2, doubtful=doubtful)
    assert view.weights[FIRST + 2] == 0
    assert view.information == pytest.approx(TANGENT @ TANGENT - TANGENT[2] ** 2)


def test_the_rate_of_false_rejections_is_as_stated():
    random, reported = np.random.default_rng(2), likelihood()
    refused = 0
    for _ in range(3000):
        differences = 0.01 * random.standard_normal(ROTORS)
        wrong = random.random(ROTORS) < 0.03
        differences[wrong] = random.uniform(-math.pi, math.pi, int(wrong.sum()))
        view = reported.linearise(2.0, FIRST, TANGENT, differences, 0.01**2)
        refused += not reported.explains(view, 0.1)
    assert refused < 10
    for _ in range(100):
        differences = random.uniform(-math.pi, math.pi, ROTORS)
        view = reported.linearise(2.0, FIRST, TANGENT, differences, 0.1**2)
        assert not reported.explains(view, 0.2**2)


def view_of(differences: Array, variance: float = 1.0) -> LinearisedMeasurement:
    likelihood = FrameLikelihood(2.0, DEFAULTS.likelihood)
    return likelihood.linearise(2.0, FIRST, TANGENT, differences.copy(), variance)


@pytest.mark.parametrize(('wave', 'angle'), [(0.0, 0.0), (0.1, 0.05), (0.1, 0.5)])
def test_noise_is_separated_from_waves(wave, angle):
    for given in [None, 0.02]:
        random, noise = np.random.default_rng(3), FrameNoise(given)
        phases = random.uniform(0, 2 * math.pi, ROTORS)
        for frame in range(3000):
            differences = wave * np.sin(angle * frame + phases)
            differences += 0.02 * random.standard_normal(ROTORS)
            noise.update(view_of(differences))
        # At half a radian a frame an eightieth of the wave amplitude counts as noise.
        rel = 0.05 if angle < 0.1 else 0.2
        assert noise.deviation == pytest.approx(0.02, rel=rel)
        assert math.sqrt(noise.persistent) == pytest.approx(wave / math.sqrt(2), rel=0.1, abs=1e-9)
        expected = math.hypot(0.02, wave / math.sqrt(2))
        assert math.sqrt(noise.scatter) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize('least', [1e-5, 0.04])
@pytest.mark.parametrize('jump', [0.0, 1.0])
def test_the_jitter_of_stamps_is_found_in_a_hundred_frames(least, jump):
    random, jitter = np.random.default_rng(9), StampJitter()
    for frame in range(100):
        time = frame + 0.2 * random.standard_normal()
        arc = 0.1 * frame + jump * (frame > 30) + 0.003 * random.standard_normal()
        # The noise is unknown in the first frames.
        jitter.update(time, arc, (least if frame < 3 else 0.003) ** 2, 0.1)
    assert math.sqrt(jitter.variance) == pytest.approx(0.2, rel=0.35)


def test_a_given_noise_that_is_too_small_is_corrected():
    random, noise = np.random.default_rng(4), FrameNoise(0.01)
    for _ in range(500):
        noise.update(view_of(0.02 * random.standard_normal(ROTORS)))
    assert noise.deviation == pytest.approx(0.02, rel=0.1)
    assert noise.degrees_of_freedom > 1000


def test_the_misfit_is_averaged_over_60_frames():
    random, noise = np.random.default_rng(5), FrameNoise(0.01)
    for _ in range(3000):
        noise.update(view_of(0.01 * random.standard_normal(ROTORS)))
    for _ in range(60):
        noise.update(view_of(0.1 * random.standard_normal(ROTORS)))
    share = 1 - math.exp(-1)
    assert noise.scatter == pytest.approx(share * 0.01 + (1 - share) * 1e-4, rel=0.2)


NOISE, SWING, MANY_ROTORS = 0.01, 2.0, 40


def beside(wave: float, wrong: float = 0.0) -> ResidualVariance:
    """Return the variance of a wall among standing waves, noise and wrong readings [rad]."""
    random = np.random.default_rng(5)
    variance = ResidualVariance(SWING, NOISE, DEFAULTS)
    likelihood = FrameLikelihood(SWING, DEFAULTS.likelihood)
    tangent = np.exp(-0.5 * (np.arange(MANY_ROTORS) - MANY_ROTORS / 2) ** 2)
    standing = wave * math.sqrt(2) * np.sin(2.4 * np.arange(MANY_ROTORS))
    for frame in range(200):
        off = standing + NOISE * random.standard_normal(MANY_ROTORS)
        off[MANY_ROTORS // 2 + 1] += wrong * (frame % 5 == 0)
        variance.learn_outliers(likelihood.linearise(2.0, 0, tangent, off.copy(), NOISE**2))
        variance.learn(likelihood.linearise(2.0, 0, tangent, off, NOISE**2 + wave**2))
    return variance


def test_without_waves_a_wall_is_calm_at_any_rate():
    assert beside(0.0).calm(0.1) > 0.9
    assert ResidualVariance(SWING, NOISE, DEFAULTS).calm(0.0) == 1.0


def test_waves_disturb_a_wall_in_proportion_to_motion_and_noise():
    def odds(wave: float, rate: float) -> float:
        return 1 / beside(wave).calm(rate) - 1

    for wave in (0.01, 0.03):
        assert odds(wave, 0.2) == pytest.approx(4 * odds(wave, 0.4))
    # The odds follow the square of weak waves and the fourth power of strong ones.
    assert odds(0.016, 0.3) / odds(0.008, 0.3) > 4
    assert odds(0.2, 0.3) / odds(0.1, 0.3) == pytest.approx(16, rel=0.1)


def test_waves_that_look_like_outliers_move_a_wall_but_wrong_readings_do_not():
    assert beside(0.0).excluded == 0.0
    assert abs(beside(0.0, 0.5).excluded) < 0.01 * NOISE**2
    assert beside(0.05).excluded > 0.3 * NOISE**2
    assert beside(0.05, 0.5).excluded < 2 * beside(0.05).excluded


def test_a_wall_at_rest_among_waves_is_never_steady():
    assert beside(0.02).calm(0.0) == 0.0


def test_a_broken_wall_does_not_fit_but_one_wrong_reading_does():
    likelihood = FrameLikelihood(1.8, DEFAULTS.likelihood)
    residuals = 0.01 * np.ones(20)
    assert likelihood.fits(residuals, 0, 10.0, 0.01)
    residuals[9] = 3.0
    assert likelihood.fits(residuals, 0, 10.0, 0.01)
    residuals[11] = -0.5
    assert not likelihood.fits(residuals, 0, 10.0, 0.01)
