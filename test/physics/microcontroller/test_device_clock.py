# SPDX-License-Identifier: Apache-2.0
"""Times of measurements by the host's clock, from arrivals with random delays."""

import contextlib
from collections.abc import Callable

import numpy as np
import pytest

from soliton_linkage.linkage.chain import Array
from soliton_linkage.microcontroller.device_clock import DeviceClock
from soliton_linkage.microcontroller.frames import CLOCK_RANGE

SECOND = 10**9
BOOT = 5 * SECOND
RATE = 100.0
LEAST = 0.002
"""Least delay of the messages [s]."""
Delays = Callable[[np.random.Generator, int], Array]
Intervals = Delays

DELAYS: dict[str, Delays] = {
    'exponential': lambda rng, count: rng.exponential(1e-3, count),
    'uniform': lambda rng, count: rng.uniform(0.0, 2e-3, count),
    'stalls': lambda rng, count: rng.exponential(2e-4, count) + 0.05 * (rng.random(count) < 0.02),
}


class Line:
    """Messages of a controller whose clock drifts, in their order."""

    def __init__(
        self,
        duration: float,
        drift: float,
        delays: Delays,
        begin: int = 0,
        intervals: Intervals = lambda rng, count: np.full(count, 1 / RATE),
    ) -> None:
        rng = np.random.default_rng(3)
        measured = np.cumsum(intervals(rng, round(duration * RATE)))
        measured -= measured[0]
        arrived = np.maximum.accumulate(measured + LEAST + delays(rng, len(measured)))
        device = measured / (1 + drift)
        self.measured = BOOT + np.round(measured * SECOND).astype(np.int64)
        self.arrivals = BOOT + np.round(arrived * SECOND).astype(np.int64)
        self.times = (begin + np.round(device * 1e6).astype(np.int64)) % CLOCK_RANGE

    def stamps(self, clock: DeviceClock) -> Array:
        """Stamps less the times of measurements and the least delay [s]."""
        stamps = [
            clock.stamp(int(time), int(arrival))
            for time, arrival in zip(self.times, self.arrivals, strict=True)
        ]
        assert (np.diff(stamps) > 0).all()
        assert (np.array(stamps) <= self.arrivals).all()
        return (np.array(stamps) - self.measured) / SECOND - LEAST


@pytest.mark.parametrize(
    ('kind', 'drift'),
    [('exponential', 100e-6), ('uniform', -5e-3), ('stalls', 100e-6), ('stalls', -5e-3)],
)
def test_errors_of_offset_and_drift_stay_below_the_stated_scatter(kind, drift):
    clock = DeviceClock()
    errors = Line(20.0, drift, DELAYS[kind]).stamps(clock)
    assert clock.drift == pytest.approx(drift, abs=5e-6)
    assert (clock.jumps, clock.restarts) == (0, 0)
    assert np.abs(errors[-500:]).max() < clock.scatter < 2e-4
    # The delay of arrivals.
    assert np.abs(errors[100:]).mean() < 0.05 * DELAYS[kind](np.random.default_rng(0), 999).mean()


def test_a_32_bit_clock_may_wrap_repeatedly():
    clock = DeviceClock()
    errors = Line(2.0, 0.0, DELAYS['exponential'], CLOCK_RANGE - 10**6).stamps(clock)
    assert np.abs(errors[100:]).max() < 1e-3
    last = Line(2.0, 0.0, DELAYS['exponential'], CLOCK_RANGE - 10**6)
    # No message for two hours and a half, in which the clock wraps twice.
    silence = 9 * 10**9
    time = (int(last.times[-1]) + silence) % CLOCK_RANGE
    arrival = int(last.arrivals[-1]) + 1000 * silence
    assert clock.stamp(time, arrival) == pytest.approx(arrival, abs=0.25 * SECOND)
    assert clock.restarts == 0


def test_a_restart_is_detected_and_stamps_continue():
    clock = DeviceClock()
    line = Line(5.0, 100e-6, DELAYS['exponential'], 10**7)
    line.stamps(clock)
    arrival = int(line.arrivals[-1])
    for k in range(2):
        with pytest.raises(ValueError, match=rf'time = {500 + 10**4 * k} us differs from its arr'):
            clock.stamp(500 + 10**4 * k, arrival + SECOND + 10**7 * k)
    stamps = [clock.stamp(500 + 10**4 * k, arrival + SECOND + 10**7 * k) for k in range(2, 10)]
    assert (clock.restarts, clock.jumps) == (1, 0)
    np.testing.assert_allclose(np.diff(stamps), 1e7)
    assert 0 <= arrival + SECOND + 2 * 10**7 - stamps[0] < 1000


def test_a_stopped_clock_and_one_in_milliseconds_are_restarted():
    clock = DeviceClock()
    line = Line(5.0, 0.0, DELAYS['exponential'])
    line.stamps(clock)
    for k in range(1, 4):
        arrival = int(line.arrivals[-1]) + 20 * SECOND + 10**7 * k
        with contextlib.suppress(ValueError):
            stamp = clock.stamp(int(line.times[-1]) + 10**4 * k, arrival)
    assert stamp == arrival
    assert clock.restarts == 1
    milliseconds = DeviceClock()
    for frame in range(1, 100):
        milliseconds.stamp(10 * frame, BOOT + 10**7 * frame)
    assert milliseconds.delay == pytest.approx(0.98, abs=0.01)


def test_a_repeated_time_is_rejected():
    clock = DeviceClock()
    clock.stamp(10, BOOT)
    with pytest.raises(ValueError, match='time = 10 us repeats the last frame'):
        clock.stamp(10, BOOT + SECOND)


def test_stamps_without_times_are_increasing_arrivals():
    clock = DeviceClock()
    assert [clock.stamp_of_arrival(BOOT), clock.stamp_of_arrival(BOOT)] == [BOOT, BOOT + 1]


def test_a_jump_of_the_clock_is_counted_and_corrected_within_three_frames():
    for jump in [0.010, 0.050, -0.005, -0.050]:
        clock = DeviceClock()
        line = Line(20.0, 100e-6, lambda rng, count: rng.exponential(3e-4, count), 10**7)
        line.times[500:] += round(jump * 1e6)
        errors, rejected = plausible_stamps(clock, line)
        assert rejected == [500, 501]
        assert (clock.jumps, clock.restarts) == (1, 0)
        assert np.abs(errors[500:]).max() < 3e-3
        assert np.abs(errors[-500:]).max() < 1e-4
        assert clock.drift == pytest.approx(100e-6, abs=1e-5)


def bursts(rng: np.random.Generator, count: int) -> Array:
    """Delays of a busy computer, which reads all waiting messages at irregular times [s]."""
    pauses = np.where(rng.random(count) < 0.8, rng.exponential(4e-3, count), 0.06)
    reads, sent = np.cumsum(pauses), np.arange(count) / RATE
    return np.maximum(reads[np.minimum(np.searchsorted(reads, sent), count - 1)] - sent, 0.0)


@pytest.mark.parametrize(
    'delays', [lambda rng, count: rng.exponential(1e-2, count), bursts], ids=['random', 'bursts']
)
def test_a_jump_forward_is_corrected_if_the_computer_is_busy(delays):
    clock = DeviceClock()
    line = Line(15.0, 100e-6, delays, 10**7)
    line.times[500:] += 50_000
    errors, rejected = plausible_stamps(clock, line, checked=True)
    assert (clock.jumps, clock.restarts) == (1, 0)
    assert np.sum(np.abs(errors[500:]) > 0.025) < 12
    assert len(rejected) < 12


def test_single_wrong_times_are_rejected_and_change_no_stamp():
    clock = DeviceClock()
    line = Line(20.0, 100e-6, DELAYS['exponential'])
    wrong = np.arange(30, 2000, 20)
    digits = 10 ** np.random.default_rng(5).integers(5, 9, len(wrong))
    line.times[wrong] = (line.times[wrong] + 3 * digits) % CLOCK_RANGE
    errors, rejected = plausible_stamps(clock, line)
    assert rejected == wrong.tolist()
    assert (clock.jumps, clock.restarts) == (0, 0)
    assert np.abs(errors[100:]).max() < 1e-3


INTERVALS: dict[str, Intervals] = {
    'uniform': lambda rng, count: rng.uniform(3e-3, 20e-3, count),
    'rarely long': lambda rng, count: np.where(rng.random(count) < 0.05, 20e-3, 3e-3),
    'short or long': lambda rng, count: rng.choice([3e-3, 20e-3], count),
    'exponential': lambda rng, count: 3e-3 + rng.exponential(1e-3, count),
}


def late(rng: np.random.Generator, count: int) -> Array:
    """Delays with stalls of the receiver, in which several messages arrive together [s]."""
    stalls = (rng.random(count) < 0.02) * rng.uniform(5e-3, 0.1, count)
    return rng.exponential(5e-4, count) + stalls


@pytest.mark.parametrize('kind', INTERVALS)
def test_late_messages_are_accepted_at_irregular_intervals(kind):
    clock = DeviceClock()
    line = Line(60.0, 100e-6, late, 10**7, INTERVALS[kind])
    errors, rejected = plausible_stamps(clock, line, checked=True)
    assert not rejected
    assert (clock.jumps, clock.restarts) == (0, 0)
    assert np.abs(errors[200:]).max() < 1e-3


@pytest.mark.parametrize(
    ('kind', 'jump'),
    [('uniform', 0.05), ('rarely long', 0.01), ('short or long', -0.03), ('exponential', 0.01)],
)
def test_jumps_are_corrected_at_irregular_intervals(kind, jump):
    clock = DeviceClock()
    line = Line(
        40.0, 100e-6, lambda rng, count: rng.exponential(3e-4, count), 10**7, INTERVALS[kind]
    )
    line.times[2000:] += round(jump * 1e6)
    errors, rejected = plausible_stamps(clock, line, checked=True)
    assert (clock.jumps, clock.restarts) == (1, 0)
    assert len([number for number in rejected if number >= 2000]) < 12
    assert np.sum(np.abs(errors) > 3e-3) < 12


def test_wrong_times_in_the_first_messages_have_no_lasting_effect():
    clock = DeviceClock()
    line = Line(20.0, 100e-6, DELAYS['exponential'])
    line.times[[3, 9]] += 30_000
    errors, _ = plausible_stamps(clock, line)
    assert np.abs(errors[300:]).max() < 1e-3


def plausible_stamps(
    clock: DeviceClock, line: Line, checked: bool = False
) -> tuple[Array, list[int]]:
    """Errors of the stamps of accepted measurements [s], and the numbers of rejected ones."""
    errors, rejected = [], []
    for number, (time, arrival) in enumerate(zip(line.times, line.arrivals, strict=True)):
        try:
            stamp = clock.stamp(int(time), int(arrival), checked)
        except ValueError:
            rejected.append(number)
        else:
            errors.append((stamp - line.measured[number]) / SECOND - LEAST)
    return np.array(errors), rejected
