# SPDX-License-Identifier: Apache-2.0
"""Estimators are scored by the truth: exact frames have no error, the bound is sigma / Lambda."""

import math

import numpy as np
import pytest
from chains import CLASSES, EXAMPLES, FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.solitons.static_wall import static_wall
from soliton_linkage_studies.accuracy import estimators as accuracy_estimators
from soliton_linkage_studies.accuracy.estimators import (
    ORBIT_COLD,
    ORBIT_NEAR,
    TANH_FIT,
    ZERO_CROSSING,
    Estimate,
    EstimatorTrial,
    bias_by_position,
    bound,
    errors,
    estimators_of,
)
from soliton_linkage_studies.accuracy.frames import FrameStudy

ROTORS = 16


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_bound_is_the_noise_over_the_angle_change_per_spacing(example):
    chain = chain_of(example, 60)
    step = 1e-3
    for position in (29.5, 29.8, 30.0):
        ahead, behind = (static_wall(chain, position + side * step / 2) for side in (1, -1))
        change = float(np.linalg.norm(np.sin(ahead - behind))) / step
        # The angles and their derivatives change by a few rad per spacing, so that the error of a
        # finite difference is a few times the square of the step.
        assert bound(chain, 0.03) == pytest.approx(0.03 / change, rel=10 * step**2)


@pytest.mark.parametrize('example', CLASSES)
def test_the_orbit_estimator_has_no_error_in_exact_frames(example):
    chain = chain_of(example, ROTORS)
    trial = EstimatorTrial(frames=30, noise=0.0, coarse_start=0.5, cold_every=6)
    found = errors(chain, trial, np.random.default_rng(1))
    # A fit converges at a step of 1e-10 rad.
    limit = 1e-9 / UniformOrbit(chain).site_arc
    for name, count in ((ORBIT_NEAR, 30), (ORBIT_COLD, 5)):
        assert found[name].shape == (count, 2)
        assert np.abs(found[name][:, 0]).max() < limit
        assert np.abs(found[name][:, 1]).max() < 1e-6
    assert np.abs(found[ZERO_CROSSING][:, 0]).max() > 1e-3


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_the_orbit_estimator_reaches_the_bound_with_correct_coverage(example):
    chain = chain_of(example, ROTORS)
    trial = EstimatorTrial(frames=500, noise=0.01, coarse_start=0.5, cold_every=500)
    found, margins = errors(chain, trial, np.random.default_rng(2))[ORBIT_NEAR].T
    least = bound(chain, 0.01)
    # The tolerance is four standard errors.
    assert abs(found.mean()) < 4 * least / math.sqrt(500)
    assert found.std() / least == pytest.approx(1, abs=4 / math.sqrt(2 * 500))
    covered = float((np.abs(found) <= margins).mean())
    assert covered == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 500))


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER])
def test_biases_between_rotors_are_odd_about_the_middle_of_a_bond(example):
    """Flipper walls on the two sides of the middle are mirror images."""
    chain = chain_of(example, 28)
    positions, found = bias_by_position(chain, 21)
    assert positions[[0, 10, 20]].tolist() == [0, 1, 2]
    for name in (ZERO_CROSSING, TANH_FIT):
        bias = found[name]
        assert bias[:11] == pytest.approx(-bias[10::-1], abs=1e-9)
        assert bias[:11] == pytest.approx(bias[10:], abs=1e-9)
        assert np.abs(bias).max() > 1e-4
    # The wall built bar by bar has the same position on the orbit.
    for name in (ORBIT_NEAR, ORBIT_COLD):
        assert np.abs(found[name]).max() < 1e-7


@pytest.mark.parametrize(
    ('off_by_widths', 'other_leg', 'failed'),
    [(1.9, False, False), (-2.1, False, True), (0.0, True, True), (math.nan, False, True)],
)
def test_a_lost_estimate_is_a_failure(off_by_widths, other_leg, failed, monkeypatch):
    chain = chain_of(FLIPPER, ROTORS)
    width = chain.wall_width / chain.spacing

    def estimate(orbit: UniformOrbit, _angles: Array, guess: float) -> Estimate:
        leg = orbit.leg(guess)
        return Estimate(orbit.site(guess) + off_by_widths * width, 0.5, (leg + other_leg) % 4)

    monkeypatch.setattr(accuracy_estimators, 'ESTIMATORS', {'mine': estimate})
    trial = EstimatorTrial(frames=20, noise=0.01, coarse_start=0.0, cold_every=1)
    found = errors(chain, trial, np.random.default_rng(3))['mine']
    assert np.isnan(found[:, 0]).tolist() == [failed] * 20
    if not failed:
        assert found[:, 0] == pytest.approx(off_by_widths * width)
        assert found[:, 1].tolist() == [0.5] * 20


CHAINS = (chain_of(FLIPPER, 10), chain_of(SPINNER, 16))


def study(frames: int, seed: int = 7) -> FrameStudy:
    trial = EstimatorTrial(frames=frames, noise=np.nan, coarse_start=0.2, cold_every=100)
    return FrameStudy(CHAINS, (0.01, 0.02), trial, seed)


def test_a_chunk_depends_only_on_the_seed_and_its_index():
    few, many = study(300), study(600)
    again = few.sample(0, 1, 0)
    for name, pairs in many.sample(0, 1, 0).items():
        np.testing.assert_array_equal(pairs, again[name])
    others = [few.sample(0, 1, 1), few.sample(0, 0, 0), study(300, seed=8).sample(0, 1, 0)]
    for other in others:
        assert other[ORBIT_NEAR][0, 0] != again[ORBIT_NEAR][0, 0]


def test_every_frame_is_in_one_chunk():
    for frames in [20, 250, 260]:
        tasks = study(frames).tasks()
        chunks = (len(tasks) - len(CHAINS)) // 4
        sizes = [len(study(frames).sample(0, 0, chunk)[ORBIT_NEAR]) for chunk in range(chunks)]
        assert sum(sizes) == frames
        assert min(sizes) > 0


def test_lines_belong_to_their_chain_and_noise():
    """Samples marked by chain, noise and chunk are assigned to the right line."""
    mine = study(500)
    samples = []
    for chain in CHAINS:
        for noise in mine.noises:
            for chunk in range(2):
                value = 100 * CHAINS.index(chain) + noise + 2 * chunk
                samples.append({name: np.full((3, 2), value) for name in estimators_of(chain)})
    lines = mine.lines(samples)
    for line in lines:
        assert line.accuracy.bias == pytest.approx(100 * CHAINS.index(line.chain) + line.noise + 1)
        assert line.accuracy.frames == 6
        assert line.accuracy.bound == bound(line.chain, line.noise)
    assert len(lines) == 2 * (4 + 5)
    assert lines[3].estimator == ORBIT_COLD
