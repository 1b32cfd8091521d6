# SPDX-License-Identifier: Apache-2.0
"""Filters of arc and rate against a naive twin, a fitted line, and by Monte Carlo."""

import math

import numpy as np
import pytest
from scipy import stats

from soliton_linkage.estimation.multiple_model_filter import MultipleModelFilter
from soliton_linkage.estimation.settings import DEFAULTS, FilterSettings
from soliton_linkage.linkage.chain import Array

PERIOD, RATE, SITE_ARC = 1e-3, 9.6, 0.99


def measured(frames: int, noise: float, seed: int) -> Array:
    random = np.random.default_rng(seed)
    return RATE * PERIOD * np.arange(frames) + noise * random.standard_normal(frames)


def followed(arcs: Array, noise: float, exchange: float = 0.0) -> tuple[MultipleModelFilter, int]:
    motion = MultipleModelFilter(float(arcs[0]), noise**2, 50.0, SITE_ARC)
    for arc in arcs[1:].tolist():
        motion.predict(PERIOD, exchange)
        motion.update(arc, noise**2)
    return motion, motion.impulses


class Twin:
    def __init__(
        self, variance: float, share: float, error: float, disturbance: float, damping: float
    ) -> None:
        self.state = np.zeros(4)
        self.spread = np.diag([variance, 2500.0, error**2, disturbance**2 + damping**2])
        self.share, self.error, self.is_damping = share, error, disturbance == 0

    def predict(self, elapsed: float, speed: float, acceleration: float, wander: Array) -> None:
        # The time unit of the chain is 1/50 s, and the bias persists for 50 time units.
        kept = math.exp(-speed * elapsed / (0.5 * SITE_ARC) - elapsed)
        gained = np.array([elapsed**2 / 2, elapsed, 0, 0])
        step = np.array([[1, elapsed, 0, 0], [0, 1, 0, 0], [0, 0, kept, 0], [0, 0, 0, 1]])
        lever = self.state[1] if self.is_damping else 1.0
        state = step @ self.state + (acceleration + lever * self.state[3]) * gained
        step[:, 3] += lever * gained
        step[1, 1] += elapsed * self.state[3] * self.is_damping
        of_rate = self.share**2 * speed**3 / SITE_ARC
        added = np.zeros((4, 4))
        added[:2, :2] = of_rate * np.array(
            [[elapsed**3 / 3, elapsed**2 / 2], [elapsed**2 / 2, elapsed]]
        )
        added[2, 2] = self.error**2 * (1 - kept**2)
        self.state = state
        self.spread = step @ (self.spread + np.diag(wander)) @ step.T + added

    def correct(self, arc: float, variance: float) -> None:
        looked = np.array([1.0, 0.0, 1.0, 0.0])
        gain = self.spread @ looked / (looked @ self.spread @ looked + variance)
        self.state = self.state + gain * (arc - looked @ self.state)
        self.spread = (np.eye(4) - np.outer(gain, looked)) @ self.spread


def steadiness(motion: MultipleModelFilter) -> float:
    """Return the weight of the steady filter among those without an impulse."""
    return float(motion.filters['weight'][0] / motion.filters['weight'][:21].sum())


def test_filters_agree_with_a_naive_kalman_filter():
    for disturbance in [0.0, 1.0]:
        for exchange in [0.0, 0.03]:
            # The limit of the odds is too large for the other filter to gain weight.
            settings = FilterSettings(
                rate_changes=(0.02,),
                biases=(0.01,),
                restart_odds=600.0,
                disturbance=disturbance / 2500.0,
            )
            acceleration, bandwidth = 3.0 * disturbance, 4.0 * disturbance
            wander = (
                4e-4 * (bandwidth * PERIOD) ** 2 * np.array([3, 3 * bandwidth**2, 0, bandwidth**4])
            )
            arcs = measured(200, 0.02, 1)
            motion = MultipleModelFilter(0.0, 4e-4, 50.0, SITE_ARC, settings)
            error = 0.01 * SITE_ARC
            twins = [
                Twin(4e-4, 0.0, 0.0, disturbance, 0.0),
                Twin(4e-4, 0.02, error, disturbance, 0.02 * 50.0 * (disturbance == 0)),
            ]
            for arc in arcs[1:].tolist():
                speed = abs(motion.rate)
                known = 2 * exchange * speed > motion.rate_deviation
                twins[1].share = 0.02 + exchange * known
                motion.predict(PERIOD, exchange, 1.0, acceleration, bandwidth)
                motion.update(arc, 4e-4)
                for twin in twins:
                    twin.predict(PERIOD, speed, acceleration, wander)
                    twin.correct(arc, 4e-4)
            for number, twin in enumerate(twins):
                found = motion.filters[number]
                assert found['state'] == pytest.approx(twin.state, rel=1e-8, abs=1e-12)
                assert found['covariance'] == pytest.approx(twin.spread, rel=1e-8, abs=1e-14)


def test_the_stated_deviations_include_a_change_of_the_rate_at_an_edge():
    noise, scores, random = 0.01, [], np.random.default_rng(5)
    for change in 3 * [0.001, 0.01, 0.03]:
        motion, arc, rate = MultipleModelFilter(0.0, noise**2, 1.0, 1.0), 0.0, 0.5
        for frame in range(960):
            motion.predict(0.2, 0.03 * (800 <= frame < 860))
            rate *= 1 + change * (frame == 830)
            arc += 0.2 * rate
            motion.update(arc + noise * random.standard_normal(), noise**2)
            if frame >= 830:
                errors = motion.arc - arc, motion.rate - rate
                scores.append(np.divide(errors, (motion.arc_deviation, motion.rate_deviation)))
    assert (np.sqrt(np.mean(np.square(scores), axis=0)) < 1.2).all()
    assert np.abs(scores).max() < 5


def test_a_steady_wall_uses_all_measurements():
    noise, frames = 0.05, 1500
    arcs = measured(frames, noise, 2)
    motion, _ = followed(arcs, noise)
    slope, end = np.polyfit(PERIOD * (np.arange(frames) - frames + 1), arcs, 1)
    assert steadiness(motion) > 0.99
    assert motion.arc == pytest.approx(end, abs=0.1 * motion.arc_deviation)
    assert motion.rate == pytest.approx(slope, abs=0.1 * motion.rate_deviation)
    assert motion.arc_deviation == pytest.approx(2 * noise / math.sqrt(frames), rel=0.01)


def test_a_wall_among_waves_is_not_assumed_to_be_steady():
    for calm in [0.0, 0.1]:
        noise, settings = 0.05, FilterSettings()
        arcs = measured(1500, noise, 2)
        motion = MultipleModelFilter(float(arcs[0]), noise**2, 50.0, SITE_ARC, settings)
        for arc in arcs[1:].tolist():
            motion.predict(PERIOD, False)
            motion.update(arc, noise**2, calm=calm)
        most = 1 / (1 + math.exp(-calm * DEFAULTS.filter.impulse_rarity))
        assert 0.4 < steadiness(motion) <= most * (1 + 1e-9)


def test_white_noise_causes_no_detection_and_deviations_are_correct():
    scores = []
    for run in range(40):
        noise = [0.002, 0.01, 0.05, 0.2][run % 4]
        motion, kicks = followed(measured(300, noise, run), noise)
        assert kicks == 0
        end = RATE * PERIOD * 299
        scores.append((motion.arc - end) / motion.arc_deviation)
        scores.append((motion.rate - RATE) / motion.rate_deviation)
    # The limits are five standard deviations of the mean square of 80 normal numbers.
    squares = np.square(scores).reshape(10, 4, 2)
    assert squares.mean() == pytest.approx(1, abs=5 * math.sqrt(2 / 80))
    assert squares.max() < 4.5**2
    # For each noise there are 20 numbers; 1 in 10,000 is beyond either end.
    of_noises = squares.sum(axis=(0, 2))
    assert of_noises.min() > stats.chi2.ppf(1e-4, 20)
    assert of_noises.max() < stats.chi2.ppf(1 - 1e-4, 20)


def test_no_single_frame_delays_the_detection_of_a_kick():
    noise, rotor = 0.01, round(SITE_ARC / RATE / PERIOD)
    for share in (0.2, -0.2, 0.5, -2.0):
        arcs = measured(900, noise, 4)
        arcs[600:] += share * RATE * PERIOD * np.arange(300)
        true = RATE * PERIOD * (np.arange(900) + share * np.maximum(np.arange(900) - 600, 0))
        motion = MultipleModelFilter(float(arcs[0]), noise**2, 50.0, SITE_ARC)
        scores = []
        for frame, arc in enumerate(arcs[1:].tolist(), start=1):
            motion.predict(PERIOD, False)
            motion.update(arc, noise**2)
            scores.append((motion.arc - true[frame]) / motion.arc_deviation)
        assert np.abs(scores[599 + rotor :]).max() < 6
        assert motion.impulses == 1


def test_a_random_walk_of_the_rate_is_tracked_with_correct_deviations():
    share, scores = 0.05, []
    for seed in range(8):
        random = np.random.default_rng(seed)
        steps = share * RATE * math.sqrt(RATE * PERIOD / SITE_ARC) * random.standard_normal(1200)
        rates = RATE + np.cumsum(steps)
        true = np.cumsum(rates) * PERIOD
        arcs = true + 0.01 * random.standard_normal(1200)
        for frames in (600, 1200):
            motion, _ = followed(arcs[:frames], 0.01)
            scores.append((motion.arc - true[frames - 1]) / motion.arc_deviation)
            scores.append((motion.rate - rates[frames - 1]) / motion.rate_deviation)
    assert np.abs(scores).max() < 4.5
    assert 0.5 < np.mean(np.square(scores)) < 1.6


def test_a_rate_ratio_scales_the_deviation_of_the_rate():
    motion, _ = followed(measured(200, 0.02, 1), 0.02)
    before = motion.rate, motion.rate_deviation, motion.summary[3], motion.arc_deviation
    motion.predict(0.0, False, 1.5)
    after = motion.rate, motion.rate_deviation, motion.summary[3], motion.arc_deviation
    assert after == pytest.approx((1.5 * before[0], 1.5 * before[1], 1.5 * before[2], before[3]))


def test_the_rate_of_a_damped_wall_agrees_with_its_stated_deviation():
    random, decay, scores = np.random.default_rng(8), 0.5, []
    times = PERIOD * np.arange(1, 1500)
    for _ in range(8):
        motion = MultipleModelFilter(0.0, 1e-4, 50.0, SITE_ARC)
        arcs = 9.0 / decay * (1 - np.exp(-decay * times)) + 0.01 * random.standard_normal(1499)
        for arc in arcs.tolist():
            motion.predict(PERIOD, False)
            motion.update(arc, 1e-4)
        scores.append((motion.rate - 9.0 * math.exp(-decay * times[-1])) / motion.rate_deviation)
    assert np.sqrt(np.mean(np.square(scores))) < 1.7


def test_a_resting_wall_that_waves_start_to_move_is_tracked():
    acceleration, noise, scores = 1.0, 0.01, []
    for seed in range(10):
        random = np.random.default_rng(seed)
        motion = MultipleModelFilter(0.0, noise**2, 50.0, SITE_ARC)
        for frame in range(1000):
            time = 0.004 * (frame - 700)
            arc = acceleration / 2 * max(time, 0.0) ** 2
            motion.set_wave_acceleration(acceleration if time > 0 else 0.0, 0.3)
            motion.predict(0.004)
            motion.update(arc + noise * random.standard_normal(), noise**2, calm=float(time < 0))
            rate_error = motion.rate - acceleration * time
            if time > 0:
                scores.append(
                    ((motion.arc - arc) / motion.arc_deviation, rate_error / motion.rate_deviation)
                )
    of_seeds = np.reshape(scores, (10, -1, 2))
    assert (np.sqrt(np.mean(of_seeds**2, axis=(0, 1))) < 2).all()
    assert (np.sqrt(np.mean(of_seeds[:, 75:] ** 2, axis=(0, 1))) < 1.2).all()
