# SPDX-License-Identifier: Apache-2.0
"""Messages are due at their bag time, after any pause, seek or change of rate."""

import threading
from typing import Any

import pytest

from soliton_linkage_nodes.bags.play.playback_clock import NextAction, PlaybackClock

SECOND = 10**9


class Clock(threading.Condition):
    """A clock that advances only during waits."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now

    def wait(self, timeout: float | None = None) -> bool:
        self.now += timeout or 0.0
        return False


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def started(clock):
    def start(*arguments: Any) -> PlaybackClock:
        moved = PlaybackClock(*arguments, clock=clock, changed=clock)
        moved.start(0)
        return moved

    return start


def test_messages_are_due_at_the_rate_without_any_drift(clock, started):
    for rate in [0.5, 1.0, 4.0]:
        begin = clock.now
        moved = started(rate)
        for number in range(2000):
            stamp = number * 7_000_001
            assert moved.wait_for(stamp) is NextAction.PLAY
            assert clock.now - begin == pytest.approx(stamp / SECOND / rate, abs=1e-9)


def test_the_rate_may_change_on_the_way(clock, started):
    moved = started(1.0)
    moved.wait_for(2 * SECOND)
    moved.set_rate(4.0)
    moved.wait_for(6 * SECOND)
    assert clock.now == pytest.approx(1000.0 + 2.0 + 1.0)
    assert moved.rate == 4.0


def test_a_pause_delays_later_messages_by_its_duration(clock, started):
    moved = started(2.0)
    moved.wait_for(1 * SECOND)
    moved.pause()
    clock.now += 50.0
    assert moved.paused
    moved.resume()
    moved.wait_for(3 * SECOND)
    assert clock.now == pytest.approx(1000.0 + 0.5 + 50.0 + 1.0)


def test_without_pace_everything_is_due(clock, started):
    moved = started(1.0, False, False)
    for number in range(10):
        assert moved.wait_for(number * SECOND) is NextAction.PLAY
    assert clock.now == 1000.0


def test_an_unused_step_is_forgotten():
    moved = PlaybackClock(paused=True, longest_step=0.05)
    assert not moved.play_next()
    moved.start(0)
    threading.Timer(0.05, moved.stop).start()
    assert moved.wait_for(0) is NextAction.STOP


def test_a_wait_ends_where_another_instant_is_sought_or_it_is_to_stop():
    moved = PlaybackClock()
    moved.start(0)
    threading.Timer(0.05, moved.seek, [7]).start()
    assert moved.wait_for(3600 * SECOND) is NextAction.SEEK
    assert moved.take_sought() == 7
    threading.Timer(0.05, moved.stop).start()
    assert moved.wait_for(3600 * SECOND) is NextAction.STOP
    with pytest.raises(ValueError, match='there was no seek'):
        moved.take_sought()


def test_a_burst_that_lasts_is_answered_before_its_end():
    slow = PlaybackClock(paused=True, longest_burst=2.0)
    slow.start(0)
    threading.Timer(0.01, slow.wait_for, [0]).start()
    assert slow.burst(3) == 1
    assert slow.stepping
    assert slow.wait_for(1) is NextAction.PLAY
    assert slow.wait_for(2) is NextAction.PLAY
    assert not slow.stepping
