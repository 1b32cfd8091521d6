# SPDX-License-Identifier: Apache-2.0
"""Windows lie between impulses, and priors are drawn as wide as they state."""

import numpy as np
import pytest
from passages import FLIPPER, WOBBLER, unequal
from scipy.linalg import eigvalsh

from soliton_linkage.identification.free_motion import FreeMotion, states_at, unknown_slices
from soliton_linkage.identification.lengths import Tolerances, chain_lengths
from soliton_linkage.identification.motion_equations import (
    Record,
    StampErrors,
    inflated_covariance,
    window_gradient,
    window_matrix,
)
from soliton_linkage.identification.windows import (
    FreeWindow,
    MotionPrior,
    free_intervals,
    initial_windows,
    merge_windows,
)

TIMES = np.arange(1000) / 250
NOTHING = np.zeros(10)
MOTION = FreeMotion(chain_lengths(FLIPPER), np.ones(9), np.ones(10), 0.0, NOTHING, NOTHING)


def test_free_intervals_begin_after_the_arrival_of_impulses():
    first, second = free_intervals(TIMES, [2.0, 1.8, 1.9])
    assert first.stop == 450
    assert TIMES[second.start] > 2.0
    assert second.stop == 1000
    assert free_intervals(TIMES, []) == [slice(0, 1000)]


def test_windows_grow_until_impulses_separate_them():
    slopes = np.arange(10.0)
    windows = initial_windows(TIMES, TIMES[:, None] * slopes, MOTION, [2.0])
    np.testing.assert_allclose(windows[7].motion.rates, slopes, atol=1e-9)
    np.testing.assert_allclose(windows[7].motion.angles, TIMES[175] * slopes, atol=1e-9)
    covered = [frame for window in windows for frame in range(1000)[window.frames]]
    while (longer := merge_windows(windows, lambda *_: True)) != tuple(windows):
        windows = list(longer)
    assert [frame for window in windows for frame in range(1000)[window.frames]] == covered
    assert len(windows) == 2


def test_windows_do_not_extend_over_gaps():
    some = np.concatenate([np.arange(0, 40_000, 20), np.arange(40_000, 40_400)])
    windows = initial_windows(some / 250, np.zeros((len(some), 10)), MOTION, [])
    assert windows[0].frames.start >= 2000
    assert windows[-1].frames.stop == len(some)
    assert len(windows) > 10
    kicked = np.concatenate([some, np.arange(40_400, 40_800)])
    impulse = 40_100 / 250
    parts = initial_windows(kicked / 250, np.zeros((len(kicked), 10)), MOTION, [impulse])
    assert parts[0].frames.start == 2000
    lost = np.delete(TIMES, slice(500, 503))
    windows = initial_windows(lost, np.zeros((len(lost), 10)), MOTION, [])
    assert sum(window.frames.stop - window.frames.start for window in windows) == len(lost)


@pytest.mark.parametrize('variance', [0.0, 1e-4])
@pytest.mark.parametrize('interval', [0.004, 0.012])
def test_gradient_and_matrix_agree_with_finite_differences(
    variance: float, interval: float
) -> None:
    random, lengths = np.random.default_rng(1), chain_lengths(unequal(WOBBLER, 3))
    angles = 0.5 + random.random(10)
    drag = {'damping': 1e-3, 'friction': 5e-3, 'gravity': 5.0, 'tilt': 0.2}
    motion = FreeMotion(
        lengths, 900 + 0 * TIMES[:9], 1 + angles / 9, angles=angles, rates=3 * angles, **drag
    )
    readings = angles + random.standard_normal((40, 10))
    readings[random.random(readings.shape) < 0.1] = np.nan
    stamps = StampErrors(variance, 0.001 * random.standard_normal(40))
    record = Record(interval * np.arange(40), readings, 1 + random.random(readings.shape), stamps)
    window = FreeWindow(slice(5, 40), motion)
    _, pulls, errors = record.weighted(window)
    residuals = record.whitened(window.frames, pulls, errors)

    def column(unknown: np.ndarray) -> np.ndarray:
        ends = (motion.changed(change * unknown) for change in (1e-6, -1e-6))
        after, before = (record.weighted(window._replace(motion=end))[2] for end in ends)
        return stamps.whitened(pulls, (before - after) / 2e-6).ravel()

    slopes = np.array([column(unknown) for unknown in np.eye(motion.size)])
    expected, matrix = slopes @ residuals.ravel(), slopes @ slopes.T
    states = states_at(motion, record.times[window.frames])
    found = window_gradient(window, record, states)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    found = window_matrix(window, record, 1)
    if interval < 0.01:
        np.testing.assert_allclose(found, matrix, atol=1e-6 * np.abs(matrix).max())
    # Sensitivities are integrated with coarse steps in longer intervals.
    prior = np.diag(np.diag(matrix)) * 1e-3 + np.eye(len(matrix))
    ratios = eigvalsh(found + prior, matrix + prior)
    assert 0.7 < ratios.min() <= ratios.max() < 1.4


def test_errors_of_stamps_leave_no_residuals_across_the_rates():
    angles = 0.5 + np.random.default_rng(1).random(10)
    lengths = chain_lengths(unequal(WOBBLER, 3))
    motion = FreeMotion(lengths, np.full(9, 900.0), np.ones(10), 0.0, angles, 3 * angles)
    states = states_at(motion, TIMES[:40])
    readings = states[:, 0] + lengths.offsets + 0.01 * states[:, 1]
    exact = StampErrors(0.0, np.zeros(40))
    record = Record(TIMES[:40], readings, np.ones((40, 10)), exact)
    window = FreeWindow(slice(0, 40), motion)
    errors = record.weighted(window)[2]
    assert np.abs(record.across_rates(window)).max() < 1e-5 * np.abs(errors).max()


AT = unknown_slices(10)
SIZE = AT.forces.stop


def test_the_covariance_is_inflated_to_the_spread_of_samples():
    random = np.random.default_rng(1)
    mixed = random.standard_normal((SIZE, SIZE)) / 10 + np.eye(SIZE)
    covariance = mixed @ mixed.T
    samples = random.standard_normal((400, SIZE)) @ mixed.T
    samples[:, AT.stiffnesses] *= 2
    samples[:, AT.masses] /= 2
    over = np.sqrt(np.diag(inflated_covariance(covariance, samples, AT)) / np.diag(covariance))
    assert over[AT.lengths] == pytest.approx(1.0, abs=0.05)
    assert over[AT.stiffnesses] == pytest.approx(2.0, rel=0.05)
    assert over[AT.masses].tolist() == [1.0] * 10
    assert over[AT.forces].tolist() == [1.0] * 3


def test_sampled_means_have_the_covariance_of_the_prior():
    chain, alike = unequal(WOBBLER, 1), np.ones(10)
    lengths = chain_lengths(chain).scaled(1.0)
    motion = FreeMotion(lengths, 2500 * alike[1:], alike, 0.0, 0 * alike, 0 * alike)
    prior, random = MotionPrior(0.0, Tolerances(0.05, 0.05)), np.random.default_rng(2)
    information, _ = prior.evaluate(motion)
    shifts = np.array([prior.sampled(motion, random).shift for _ in range(300)])
    np.testing.assert_allclose(prior.sampled(motion, random).evaluate(motion)[0], information)
    squares = np.einsum('si,ij,sj->s', shifts, information, shifts)
    known = np.linalg.matrix_rank(information, tol=1e-6)
    assert known == SIZE - 4
    assert squares.mean() == pytest.approx(known, rel=5 * np.sqrt(2 / known / 300))
    assert np.abs(shifts[:, AT.stiffnesses].mean(axis=1)).max() < 1e-6
