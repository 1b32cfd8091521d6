# SPDX-License-Identifier: Apache-2.0
"""Encoder offsets and unmodelled deviations against least squares and by Monte Carlo."""

import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of
from scipy import stats
from scipy.optimize import brentq

from soliton_linkage.estimation.encoder_offsets import EncoderOffsets
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.settings import OffsetSettings
from soliton_linkage.linear.bands import gap
from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

NOISE, REST = 0.05, 0.03
SETTINGS = OffsetSettings(rest_angle_deviation=REST)


def test_offsets_agree_with_a_least_squares_fit_with_priors():
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


def test_an_offset_is_separated_from_a_rest_angle_after_the_wall_has_passed():
    for passed in [False, True]:
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


def test_unknown_angles_and_rotors_about_the_wall_have_no_information():
    offsets = EncoderOffsets(3)
    before = offsets.deviations.copy()
    offsets.update(np.array([np.nan, 1.0, 1.0]), np.array([1, 0, -1]), NOISE**2)
    assert offsets.deviations[:2] == pytest.approx(before[:2])
    assert offsets.deviations[2] < 0.1


def test_only_significant_offsets_are_corrected():
    random, offsets = np.random.default_rng(3), EncoderOffsets(50, SETTINGS)
    true = np.zeros(50)
    true[7] = 0.5
    for frame in range(200):
        side = np.full(50, 1 if frame % 2 else -1)
        offsets.update(true + random.normal(0, NOISE, 50), side, NOISE**2)
    assert np.flatnonzero(offsets.corrections).tolist() == [7]
    assert offsets.corrections[7] == offsets.values[7]


ROTORS, SMALL_NOISE, BOND = 20, 0.005, 9
DRAWS, FRAMES = 25, 18


def resting(orbit: UniformOrbit, seed: int, share: float) -> Array:
    """Return angles of a deviating chain with half of its zero mode left of the bond."""
    drawn = drawn_deviations(ROTORS, seed, spacing=share, rotor_length=share)
    chain = replace(orbit.chain, deviations=drawn)

    def angles(arc: float) -> Array:
        return unstretched(chain, orbit.configuration(arc))

    def beyond_half(arc: float) -> float:
        return float(np.sum(zero_mode(chain, angles(arc))[: BOND + 1] ** 2)) - 0.5

    low, high = (orbit.arc_at(site, 0) for site in (BOND - 0.5, BOND + 1.5))
    return angles(float(brentq(beyond_half, low, high, xtol=1e-4)))


@pytest.mark.parametrize(('example', 'share'), [(FLIPPER, 0.03), (WOBBLER, 0.03), (SPINNER, 0.03)])
def test_stated_deviations_include_unmodelled_deviations_from_the_first_frame(example, share):
    orbit = UniformOrbit(chain_of(example, ROTORS))
    scores, fresh = np.empty((DRAWS, FRAMES)), OrbitFilter(orbit)
    for seed in range(DRAWS):
        random, angles = np.random.default_rng(seed), resting(orbit, seed, share)
        tracker = deepcopy(fresh)
        for frame in range(FRAMES):
            noisy = angles + SMALL_NOISE * random.standard_normal(ROTORS)
            reported = tracker.update(0.004 * frame, noisy)
            scores[seed, frame] = (reported.site - BOND - 0.5) / reported.site_deviation
    squares = np.sum(scores**2, axis=0)
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], DRAWS)
    assert squares.max() < high
    assert low < squares[-1]


def test_a_persistent_outlier_in_an_even_chain_is_a_wrong_reading():
    orbit, off = UniformOrbit(chain_of(WOBBLER, ROTORS)), 1.2
    angles, random = resting(orbit, 0, 0.0), np.random.default_rng(0)
    angles[BOND + 2] += off
    tracker = OrbitFilter(orbit)
    for frame in range(40):
        noisy = angles + SMALL_NOISE * random.standard_normal(ROTORS)
        reported = tracker.update(0.004 * frame, noisy)
    stated = reported.site_deviation * orbit.site_arc
    assert stated < 0.1 * off


@pytest.mark.parametrize('period', [47, 200])
def test_a_rotor_that_oscillates_far_from_the_wall_has_no_offset(period):
    orbit, random = UniformOrbit(chain_of(SPINNER, ROTORS)), np.random.default_rng(7)
    angles = orbit.configuration(orbit.arc_at(float(BOND), 0))
    tracker, corrected = OrbitFilter(orbit), 0
    for frame in range(1500):
        noisy = angles + SMALL_NOISE * random.standard_normal(ROTORS)
        noisy[1] += math.sin(2 * math.pi * frame / period)
        tracker.update(0.004 * frame, noisy)
        corrected += bool(tracker.offsets.corrections[1])
    assert not corrected


def test_waves_are_no_unmodelled_deviations():
    orbit, random = UniformOrbit(chain_of(FLIPPER, ROTORS)), np.random.default_rng(9)
    angles = orbit.configuration(orbit.arc_at(float(BOND), 0))
    waves = gap(orbit.chain) * (1 + 0.1 * random.random(ROTORS))
    phases, tracker = random.uniform(-math.pi, math.pi, ROTORS), OrbitFilter(orbit)
    for time in 0.004 * np.arange(400):
        noisy = angles + SMALL_NOISE * random.standard_normal(ROTORS)
        noisy += 0.05 * np.sin(waves * time + phases) * (np.abs(np.arange(ROTORS) - BOND) > 6)
        reported = tracker.update(time, noisy)
    assert reported.site_deviation * orbit.site_arc < 0.3 * SMALL_NOISE


def test_the_offset_of_an_encoder_that_slips_is_found():
    orbit, random = UniformOrbit(chain_of(SPINNER, ROTORS)), np.random.default_rng(8)
    angles = orbit.configuration(orbit.arc_at(float(BOND), 0))
    tracker = OrbitFilter(orbit)
    for frame in range(800):
        noisy = angles + SMALL_NOISE * random.standard_normal(ROTORS)
        noisy[1] += 0.3 * (frame > 300)
        tracker.update(0.004 * frame, noisy)
    assert tracker.offsets.corrections[1] == pytest.approx(0.3, abs=SMALL_NOISE)


def test_an_offset_near_an_edge_does_not_drag_the_wall():
    orbit = UniformOrbit(chain_of(FLIPPER, 33))
    rate = 4.0 * orbit.site_arc
    for seed in range(4):
        random, tracker = np.random.default_rng(seed), OrbitFilter(orbit)
        start, scores = orbit.arc_at(28.0, 0), []
        for frame in range(300):
            arc = start + rate * 0.002 * frame
            angles = orbit.configuration(arc) + random.normal(0, 0.01, 33)
            angles[::10] += 0.1
            found = tracker.update(0.002 * frame, angles)
            scores.append((found.site - orbit.site(arc)) / found.site_deviation)
        assert orbit.site(arc) > 30.3
        assert np.abs(scores[20:]).max() < 4
