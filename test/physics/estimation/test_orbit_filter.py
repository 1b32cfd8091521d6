# SPDX-License-Identifier: Apache-2.0
"""Filter along the orbit: its bound, its stated deviations, and irregular streams."""

import math

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER
from orbits import uniform_orbit
from scipy import stats

from soliton_linkage.estimation.estimates import OrbitEstimate, TrackingStatus
from soliton_linkage.estimation.orbit_filter import OrbitFilter
from soliton_linkage.estimation.orbit_model import ComplianceCorrection
from soliton_linkage.estimation.settings import DEFAULTS, EstimationSettings, FilterSettings
from soliton_linkage.linkage.chain import Array
from soliton_linkage.orbit.uniform_orbit import UniformOrbit

PERIOD = 1e-3
RATE = 9.6
EXAMPLES = [(FLIPPER, 14), (WOBBLER, 14), (SPINNER, 14)]


class Stream:
    """Frames of a chain with a constant rate on its orbit."""

    def __init__(
        self, orbit: UniformOrbit, noise: float, start: float = 6.0, seed: int = 1
    ) -> None:
        self.orbit = orbit
        self.noise = noise
        self.start = start
        self.random = np.random.default_rng(seed)

    def arc(self, time: float) -> float:
        return self.start + RATE * time

    def frame(self, time: float) -> Array:
        angles = self.orbit.configuration(self.arc(time))
        return angles + self.noise * self.random.standard_normal(len(angles))

    def feed(self, tracker: OrbitFilter, times: Array) -> OrbitEstimate:
        for time in times.tolist():
            tracker.update(time, self.frame(time))
        return tracker.estimate

    def error(self, estimate: OrbitEstimate) -> float:
        """Error of the arc without whole cycles [rad]."""
        return math.remainder(estimate.arc - self.arc(estimate.time), self.orbit.length)


def tracked(seed: int = 1, frames: int = 400, rotors: int = 14) -> tuple[Stream, OrbitFilter]:
    stream = Stream(uniform_orbit(FLIPPER, rotors), 0.05, seed=seed)
    tracker = OrbitFilter(stream.orbit, 0.05)
    stream.feed(tracker, PERIOD * np.arange(frames))
    return stream, tracker


def normalised(estimate: OrbitEstimate, stream: Stream) -> Array:
    """Return uncorrelated normalised errors of arc and rate."""
    mixed = estimate.covariance
    spread = [[estimate.arc_deviation**2, mixed], [mixed, estimate.rate_deviation**2]]
    errors = [stream.error(estimate), estimate.rate - RATE]
    return np.linalg.solve(np.linalg.cholesky(np.array(spread)), errors)


@pytest.mark.parametrize(('example', 'rotors'), [(FLIPPER, 40), (SPINNER, 24), (WOBBLER, 24)])
def test_a_steady_wall_uses_the_whole_record(example, rotors):
    frames = 1000
    stream = Stream(uniform_orbit(example, rotors), 0.05)
    tracker = OrbitFilter(stream.orbit, 0.05)
    estimate = stream.feed(tracker, PERIOD * np.arange(frames))
    # The bound belongs to a straight line through n points. The ripple of a wall on springs adds
    # noise with the same integral of its correlation.
    arc = stream.orbit.site_arc
    bias = ComplianceCorrection(stream.orbit).ripple_bias(RATE) * arc**2
    correlated = 2 * DEFAULTS.filter.bias_way * arc / (RATE * PERIOD)
    most = math.hypot(1.0, math.sqrt(bias * correlated) / 0.05)
    least = 2 * 0.05 / math.sqrt(frames)
    assert 0.99 * least < estimate.arc_deviation < 1.01 * most * least
    slope = 0.05 * math.sqrt(12) / (frames**1.5 * PERIOD)
    assert slope < estimate.rate_deviation < 1.05 * most * slope
    assert np.abs(normalised(estimate, stream)).max() < 4.5
    assert estimate.site_deviation < 0.005
    assert estimate.site_rate_deviation < 1e-3 * abs(estimate.site_rate)
    assert estimate.site == pytest.approx(
        stream.orbit.site(stream.arc(estimate.time)), abs=4.5 * estimate.site_deviation
    )


@pytest.mark.parametrize('site', [1.3, 15.3])
@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_a_resting_wall_uses_the_whole_record(example, site):
    frames, orbit = 300, uniform_orbit(example, 30)
    period, random = 0.2 * orbit.chain.time_unit, np.random.default_rng(3)
    tracker = OrbitFilter(
        orbit, settings=EstimationSettings(filter=FilterSettings(impulse_ages=0))
    )
    angles = orbit.configuration(orbit.arc_at(site, 0))
    for time in period * np.arange(frames):
        estimate = tracker.update(time, angles + 0.01 * random.standard_normal(30))
    # The bound belongs to a straight line through n points.
    assert estimate.arc_deviation < 1.1 * 2 * 0.01 / math.sqrt(frames)
    assert estimate.rate_deviation < 1.1 * 0.01 * math.sqrt(12) / (frames**1.5 * period)


def test_stated_deviations_are_correct_and_errors_are_normal():
    orbit = uniform_orbit(FLIPPER, 40)
    times = 0.01 * np.arange(25)
    scores = []
    for run in range(60):
        noise, given = [(0.01, True), (0.05, True), (0.2, True), (0.05, False)][run % 4]
        stream = Stream(orbit, noise, start=5 + 0.37 * run, seed=run)
        tracker = OrbitFilter(orbit, noise if given else None)
        scores.append(normalised(stream.feed(tracker, times), stream))
    scored = np.concatenate(scores)
    # The limits of the sums of squares have a false-alarm rate of one in a thousand.
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], len(scored))
    assert low < scored @ scored < high
    assert stats.kstest(scored, 'norm').pvalue > 1e-3
    assert np.abs(scored).max() < 4.5


def test_an_unknown_noise_is_estimated_on_the_way():
    for noise in [0.01, 0.2]:
        stream = Stream(uniform_orbit(FLIPPER, 14), noise)
        tracker = OrbitFilter(stream.orbit)
        estimate = stream.feed(tracker, PERIOD * np.arange(500))
        assert estimate.noise == pytest.approx(noise, rel=5 / math.sqrt(2 * 500 * 13))
        assert estimate.misfit == pytest.approx(noise, rel=5 / math.sqrt(2 * 500 * 13))


def test_missing_rotors_lose_only_their_information():
    for share in [0.3, 0.6]:
        orbit = uniform_orbit(FLIPPER, 40)
        scores, ratios = [], []
        for run in range(8):
            stream = Stream(orbit, 0.05, start=5 + 3 * run, seed=run)
            tracker = OrbitFilter(orbit, 0.05)
            times = PERIOD * np.arange(150)
            for time in times.tolist():
                frame = stream.frame(time)
                frame[stream.random.random(40) < share] = np.nan
                tracker.update(time, frame)
            estimate = tracker.estimate
            scores.append(normalised(estimate, stream))
            since = len(times) if tracker.starts == 1 else math.nan
            ratios.append(estimate.arc_deviation / (0.1 / math.sqrt((1 - share) * since)))
        scored = np.concatenate(scores)
        assert scored @ scored < stats.chi2.ppf(1 - 5e-4, len(scored))
        assert np.nanmedian(ratios) == pytest.approx(1, rel=0.05)
        assert np.nanmax(ratios) < 1.25


@pytest.mark.parametrize(('example', 'rotors'), EXAMPLES)
def test_a_chain_assembled_upside_down_moves_on_the_image_of_the_orbit(example, rotors):
    stream = Stream(uniform_orbit(example, rotors), 0.05)
    tracker = OrbitFilter(stream.orbit, 0.05)
    for time in (PERIOD * np.arange(50)).tolist():
        tracker.update(time, math.pi - stream.frame(time))
    assert tracker.estimate.upside_down
    assert abs(stream.error(tracker.estimate)) < 4.5 * tracker.estimate.arc_deviation


def test_the_uncertainty_grows_in_a_gap_with_that_of_the_rate():
    stream, tracker = tracked(rotors=40)
    before = tracker.estimate
    empty = np.full(40, np.nan)
    for time in (before.time + 0.05 * np.arange(1, 21)).tolist():
        estimate = tracker.update(time, empty)
        assert estimate.status is TrackingStatus.COASTING
    # An unmodelled damping may slow the wall by a small part of its uncertainty.
    allowed = 1e-3 * estimate.arc_deviation
    assert estimate.arc - before.arc == pytest.approx(before.rate * 1.0, abs=allowed)
    expected = before.arc_deviation**2 + 2 * before.covariance + before.rate_deviation**2
    # An unsteady wall may have changed its rate meanwhile.
    assert math.sqrt(expected) < estimate.arc_deviation < 3 * math.sqrt(expected)
    assert abs(stream.error(estimate)) < 4.5 * estimate.arc_deviation
    after = tracker.update(estimate.time + PERIOD, stream.frame(estimate.time + PERIOD))
    assert after.status is TrackingStatus.TRACKING
    assert abs(stream.error(after)) < 4.5 * after.arc_deviation
    assert tracker.starts == 1


def test_after_a_long_gap_the_chain_is_searched_again():
    stream, tracker = tracked()
    estimate = tracker.update(1e6, stream.frame(1e6))
    assert estimate.status is TrackingStatus.ACQUIRED
    assert 0 <= estimate.arc < stream.orbit.length
    assert abs(stream.error(estimate)) < 4.5 * estimate.arc_deviation
    # The clock comes back.
    estimate = stream.feed(tracker, 0.4 + PERIOD * np.arange(100))
    assert estimate.status is TrackingStatus.TRACKING
    assert abs(stream.error(estimate)) < 4.5 * estimate.arc_deviation


def test_stamps_that_are_not_finite_are_ignored():
    for time in [math.nan, math.inf, -math.inf]:
        stream, tracker = tracked()
        before = tracker.estimate
        assert tracker.update(time, stream.frame(0.0)) is before


def test_frames_without_the_chain_are_skipped():
    stream, tracker = tracked()
    times = PERIOD * np.arange(400, 440)
    for time in times.tolist():
        estimate = tracker.update(time, stream.random.uniform(-3, 3, 14))
        assert estimate.status is TrackingStatus.COASTING
    assert tracker.rejected == 40
    estimate = stream.feed(tracker, PERIOD * np.arange(440, 450))
    assert estimate.status is TrackingStatus.TRACKING
    assert abs(stream.error(estimate)) < 4.5 * estimate.arc_deviation


def test_without_frames_of_the_chain_it_is_lost():
    tracker = OrbitFilter(uniform_orbit(FLIPPER, 14))
    assert tracker.estimate.status is TrackingStatus.LOST
    estimate = tracker.update(0.0, np.full(14, np.nan))
    assert estimate.status is TrackingStatus.LOST
    assert estimate.time == 0.0
    assert math.isnan(estimate.arc)
    stream = Stream(tracker.orbit, 0.05)
    assert tracker.update(1.0, stream.frame(1.0)).status is TrackingStatus.ACQUIRED


def test_the_view_contains_the_residuals_from_the_orbit():
    stream, tracker = tracked()
    time = tracker.estimate.time + PERIOD
    frame = stream.frame(time)
    frame[3] = np.nan
    tracker.update(time, frame + 2 * math.pi)
    view = tracker.view
    assert view is not None
    residuals = frame - stream.orbit.configuration(view.arc)
    # To first order in the way from where the frame was looked for.
    assert view.residuals == pytest.approx(residuals, abs=1e-3, nan_ok=True)
    assert np.isnan(view.residuals).nonzero()[0].tolist() == [3]
    tracker.update(time + PERIOD, np.full(14, np.nan))
    assert tracker.view is None
    tracker.update(0.0, np.full(14, np.nan))
    assert OrbitFilter(stream.orbit).view is None


def test_the_misfit_of_a_frame_shows_that_it_is_off_the_orbit():
    stream, tracker = tracked(frames=1500, rotors=40)
    aside = 0.15 * np.where(np.arange(40) % 4 < 2, 1, -1)
    start = tracker.estimate.time
    for time in (start + PERIOD * np.arange(1, 251)).tolist():
        estimate = tracker.update(time, stream.frame(time) + aside)
        assert estimate.frame_misfit == pytest.approx(math.hypot(0.15, 0.05), rel=0.5)
    assert estimate.misfit > 0.1
    assert tracker.update(start + 1.0, np.full(40, np.nan)).frame_misfit is not None
    assert math.isnan(tracker.estimate.frame_misfit)


def test_the_leg_of_a_flipper_is_known_once_both_edges_were_seen():
    for unseen in [0, 13]:
        stream = Stream(uniform_orbit(FLIPPER, 14), 0.02)
        tracker = OrbitFilter(stream.orbit, 0.02)
        for time in (PERIOD * np.arange(50)).tolist():
            frame = stream.frame(time)
            frame[unseen] = np.nan
            assert not tracker.update(time, frame).leg_known
        estimate = stream.feed(tracker, PERIOD * np.arange(50, 60))
        assert estimate.leg_known
        assert abs(stream.error(estimate)) < 4.5 * estimate.arc_deviation
        tracker.update(0.1, np.full(14, np.nan))
        assert tracker.estimate.leg_known


def test_the_wall_of_a_spinner_determines_its_leg():
    stream = Stream(uniform_orbit(SPINNER, 24), 0.02)
    frame = stream.frame(0.0)
    frame[[0, -1]] = np.nan
    assert OrbitFilter(stream.orbit).update(0.0, frame).leg_known


def test_an_invalid_noise_is_rejected():
    for noise in [0.0, -1.0, math.nan, math.inf]:
        with pytest.raises(ValueError, match=r'noise = .* rad must be finite and above 0'):
            OrbitFilter(uniform_orbit(FLIPPER, 14), noise)


@pytest.mark.parametrize('example', [FLIPPER, SPINNER])
def test_an_offset_beside_the_wall_at_the_start_loses_its_weight(example):
    stream = Stream(uniform_orbit(example, 24), 0.01)
    stream.start = stream.orbit.arc_at(12.0, 0)
    tracker, scores = OrbitFilter(stream.orbit, 0.01), []
    offset = np.zeros(24)
    offset[12] = 0.1
    for frame in range(300):
        angles = stream.orbit.configuration(stream.start)
        noise = 0.01 * stream.random.standard_normal(24)
        estimate = tracker.update(PERIOD * frame, angles + noise + offset)
        off = math.remainder(estimate.arc - stream.start, stream.orbit.length)
        scores.append(off / estimate.arc_deviation)
    assert np.sqrt(np.mean(np.square(scores[100:]))) < 1.5


def test_the_jitter_of_stamps_is_estimated_and_stated():
    stream = Stream(uniform_orbit(FLIPPER, 40), 0.002)
    tracker, scores = OrbitFilter(stream.orbit, 0.002), []
    period, jitter = 4e-3, 8e-4
    for time in (period * np.arange(800)).tolist():
        late = jitter * stream.random.standard_normal()
        estimate = tracker.update(time + late, stream.frame(time))
        off = math.remainder(estimate.arc - stream.arc(time), stream.orbit.length)
        scores.append(off / estimate.arc_deviation)
    assert math.sqrt(tracker.jitter.variance) == pytest.approx(jitter, rel=0.2)
    assert np.sqrt(np.mean(np.square(scores[100:]))) == pytest.approx(1.0, abs=0.2)


def test_exact_stamps_have_no_jitter():
    _, tracker = tracked(rotors=40)
    assert tracker.jitter.variance == 0.0
