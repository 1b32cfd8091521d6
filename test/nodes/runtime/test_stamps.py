# SPDX-License-Identifier: Apache-2.0
"""The last message ages with the wall clock; without a message the age is infinite."""

import math
import random

import pytest

from soliton_linkage_nodes.runtime import stamps
from soliton_linkage_nodes.runtime.stamps import ClockMonitor, Freshness


def test_the_age_increases_until_the_next_message(monkeypatch):
    now = 100.0
    monkeypatch.setattr(stamps.time, 'monotonic', lambda: now)
    watched = Freshness(0.5)
    assert (watched.age, watched.stale, str(watched)) == (math.inf, True, 'none received')
    watched.renew()
    now = 100.5
    assert (watched.age, watched.stale) == (0.5, False)
    now = 101.25
    assert (watched.stale, str(watched)) == (True, 'the last is 1.25 s old')
    watched.renew()
    assert not watched.stale


SECOND = 10**9


def test_offset_and_drift_of_a_clock_are_reported():
    for offset, drift in [(0.0, 0.0), (3.5, 500.0), (-7.0, -2000.0)]:
        ways = random.Random(1)
        watch = ClockMonitor()
        for second in range(30):
            for frame in range(100):
                sent = second + frame / 100
                came = sent + 0.0002 + ways.expovariate(1000.0)
                stamp = sent - offset - drift * 1e-6 * sent
                watch.note(round(stamp * SECOND), round(came * SECOND))
            told = watch.figures()
            expected = offset + drift * 1e-6 * second
            assert told['stamps behind the clock [s]'] == pytest.approx(expected, abs=0.005)
            assert len(told) == 2 or second < 12
        assert told['drift of stamps against the clock [ppm]'] == pytest.approx(drift, abs=20)


def test_without_messages_nothing_is_reported():
    watch = ClockMonitor()
    assert watch.figures() == {}
    watch.note(1, 2)
    assert watch.figures() == {'stamps behind the clock [s]': 1e-9}
    assert watch.figures() == {}
