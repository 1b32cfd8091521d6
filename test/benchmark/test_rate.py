# SPDX-License-Identifier: Apache-2.0
"""The comparison of simulators at a rate runs, and judges by the instants that it saw."""

from typing import Any

import numpy as np
import pytest
from rate import MOST_ROTORS, Bench, Run, run_of

RATE = 1000.0
PERIOD = 10**6
PUNCTUAL = np.arange(1001) * PERIOD


def frames(instants: np.ndarray) -> np.ndarray:
    return np.stack([np.arange(len(instants)), instants], axis=1)


def test_a_punctual_simulator_holds():
    run = run_of(40, RATE, frames(PUNCTUAL), PUNCTUAL, 0.1)
    assert run.holds
    assert (run.frames, run.missed, run.missed_by_sleeping) == (1001, 0, 0)
    assert run.real_time_factor == pytest.approx(1)
    assert run.jitter == pytest.approx((0, 0, 0), abs=1e-12)


def test_a_stall_is_a_missed_deadline_unless_sleeping_misses_one_too():
    stalled = PUNCTUAL.copy()
    stalled[500] += 2 * PERIOD + PERIOD // 2
    stalled[501] = stalled[502] = stalled[500]
    run = run_of(40, RATE, frames(stalled), PUNCTUAL, 0.1)
    assert (run.missed, run.holds) == (1, False)
    assert run.jitter[2] == pytest.approx(2.5e-3)
    assert run_of(40, RATE, frames(stalled), stalled, 0.1).holds


def test_a_frame_that_was_not_received_is_no_missed_deadline():
    seen = np.delete(frames(PUNCTUAL), [400, 401, 402], axis=0)
    assert run_of(40, RATE, seen, PUNCTUAL, 0.1).holds


def test_a_simulator_that_is_slow_does_not_hold():
    run = run_of(40, RATE, frames(PUNCTUAL * 5 // 4), PUNCTUAL, 0.1)
    assert run.real_time_factor == pytest.approx(0.8)
    assert not run.holds


class Imagined(Bench):
    """Holds up to a limit, in long runs up to a lower one."""

    def __init__(self, limit: float, lasting: float) -> None:
        super().__init__(None, 1.0, 30.0)
        self.limits = {1.0: limit, 30.0: lasting}
        self.longest = 0

    def run(self, name: str, command: Any, rotors: int, rate: float, seconds: float) -> Run:
        self.longest = max(self.longest, rotors)
        factor = 1.0 if rotors <= self.limits[seconds] else 0.5
        return Run(rotors, rate, factor, 1000, 0, 0, (0.0, 0.0, 0.0), 0.1)


def test_the_largest_size_that_holds_is_found_and_confirmed():
    for limit in [3, 30, 1234, 20_000]:
        (found,) = Imagined(limit, limit).most_rotors('ours', lambda *_: [])
        assert limit / 1.2 <= found <= limit
        lasts = limit / 1.5 + 1
        (lasting,) = Imagined(limit, lasts).most_rotors('ours', lambda *_: [])
        assert 0.65 * lasts <= lasting <= lasts


def test_no_rate_above_the_limit_is_requested():
    bench = Imagined(10 * MOST_ROTORS, 10 * MOST_ROTORS)
    assert bench.most_rotors('ours', lambda *_: []) == [MOST_ROTORS]
    assert bench.longest == MOST_ROTORS


def test_no_rate_is_found_if_none_is_sustained():
    assert Imagined(0, 0).most_rotors('ours', lambda *_: []) == []


class Unlucky(Imagined):
    """Fails every other of its short runs."""

    short_runs = 0

    def run(self, name: str, command: Any, rotors: int, rate: float, seconds: float) -> Run:
        self.short_runs += seconds < 30
        unlucky = seconds < 30 and self.short_runs % 2 == 1
        return super().run(name, command, 2 * MOST_ROTORS if unlucky else rotors, rate, seconds)


def test_bad_luck_in_one_run_does_not_end_the_search():
    (found,) = Unlucky(1234, 1234).most_rotors('ours', lambda *_: [])
    assert 1234 / 1.2 <= found <= 1234
