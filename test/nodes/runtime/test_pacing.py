# SPDX-License-Identifier: Apache-2.0
"""The paced loop, on a clock that the tests advance: absolute deadlines, no drift, no burst."""

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import pytest

from soliton_linkage_nodes.runtime import pacing
from soliton_linkage_nodes.runtime.pacing import (
    IdlePriority,
    PacedLoop,
    raise_priority,
    yield_core,
)

SECOND = 10**9
START = 123_456_789


class Clock:
    """Replacement of the module time."""

    def __init__(self) -> None:
        self.now = START

    def monotonic_ns(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * SECOND)


class Enough(Exception):
    """Ends a loop from within."""


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(pacing, 'time', clock)
    return clock


def instants(
    clock: Clock,
    rate: float,
    calls: int,
    work: Callable[[int], int] = lambda call: 0,
    first: bool = False,
    rates: Mapping[int, float] = MappingProxyType({}),
) -> tuple[list[int], PacedLoop]:
    """Return when a loop acted [ns since it began].

    The call k takes work(k) [ns], and then sets the rate to rates[k] [1/s].
    """
    seen: list[int] = []
    enough = threading.Event()

    def act() -> None:
        if len(seen) == calls:
            enough.set()
            raise Enough
        seen.append(clock.now - START)
        clock.now += work(len(seen) - 1)
        if len(seen) - 1 in rates:
            loop.rate = rates[len(seen) - 1]

    loop = PacedLoop(rate, act, first)
    loop.start()
    assert enough.wait(120)
    loop.stop()
    assert isinstance(loop.failure, Enough)
    return seen, loop


@pytest.mark.parametrize('rate', [1.0, 300.0, 1999.99])
def test_deadlines_are_absolute_and_never_drift(clock, rate):
    seen, loop = instants(clock, rate, 20_000)
    assert seen == [round(tick * SECOND / rate) for tick in range(20_000)]
    assert loop.punctuality == pacing.Punctuality(20_000, 0, 0.0, 0.0)


def test_a_short_stall_is_caught_up_with_and_counted(clock):
    stall = {10: SECOND // 20}
    seen, loop = instants(clock, 100.0, 40, lambda call: stall.get(call, 0))
    deadlines = [tick * SECOND // 100 for tick in range(40)]
    assert seen[:11] == deadlines[:11]
    assert seen[11:15] == [deadlines[15]] * 4
    assert seen[15:] == deadlines[15:]
    # Due after 1, 2, 3, 4 of the 5 periods: the last was not more than a period late.
    assert loop.punctuality == pacing.Punctuality(40, 3, 0.04, 0.0)


def test_after_a_long_stall_the_deadlines_lag_instead_of_bursting(clock):
    stall = {10: SECOND}
    seen, loop = instants(clock, 100.0, 40, lambda call: stall.get(call, 0))
    period = SECOND // 100
    late = SECOND - period
    assert seen[11] == 10 * period + SECOND
    assert seen[12:] == [tick * period + late for tick in range(12, 40)]
    assert loop.punctuality == pacing.Punctuality(40, 1, late / SECOND, late / SECOND)


def test_an_overloaded_loop_runs_at_full_speed_and_reports_its_lag(clock):
    work = SECOND // 10
    seen, loop = instants(clock, 1000.0, 100, lambda call: work)
    assert seen == [call * work for call in range(100)]
    assert loop.punctuality.missed == 99
    assert loop.punctuality.lag == pytest.approx(99 * 0.099, abs=0.1)


def test_stop_completes_the_current_call_and_makes_no_other():
    entered, release, calls = threading.Event(), threading.Event(), []

    def act() -> None:
        entered.set()
        assert release.wait(120)
        calls.append(1)

    loop = PacedLoop(1000.0, act)
    loop.start()
    assert entered.wait(120)
    stopping = threading.Thread(target=loop.stop)
    stopping.start()
    assert calls == []
    release.set()
    stopping.join(120)
    assert not stopping.is_alive()
    assert calls == [1]


def test_a_rate_that_is_set_later_counts_from_then_on(clock):
    stall = {10: SECOND // 20}
    seen, loop = instants(clock, 100.0, 31, lambda call: stall.get(call, 0), rates={10: 200.0})
    changed = SECOND // 10 + SECOND // 20
    assert seen[:11] == [tick * SECOND // 100 for tick in range(11)]
    assert seen[11:] == [changed + tick * SECOND // 200 for tick in range(20)]
    assert loop.punctuality.missed == 0


def test_at_an_infinite_rate_it_sleeps_only_without_work(clock):
    asleep: list[int] = []
    enough = threading.Event()

    def act() -> bool:
        asleep.append(clock.now - START)
        if len(asleep) == 100:
            enough.set()
            raise Enough
        return not 20 < len(asleep) <= 30

    loop = PacedLoop(math.inf, act)
    loop.start()
    assert enough.wait(120)
    loop.stop()
    assert set(asleep[:21]) == {0}
    assert len(set(asleep[20:31])) == 11
    assert len(set(asleep[30:])) == 1
    assert loop.punctuality == pacing.Punctuality(89, 0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('rate', 'first', 'asked'),
    [(100.0, True, [True, False, True]), (100.0, False, []), (math.inf, True, [False])],
)
def test_it_has_priority_if_asked_for_and_while_it_keeps_its_rate(
    clock, monkeypatch, rate, first, asked
):
    requests = []
    monkeypatch.setattr(pacing, 'raise_priority', requests.append)
    stall = {10: SECOND // 20}
    instants(clock, rate, 40, lambda call: stall.get(call, 0), first=first)
    assert requests == asked


def policies_of_a_thread() -> list[int]:
    """Return the policies of a thread: before priority, with it, of a child thread, afterwards."""
    seen: list[int] = []

    def note() -> None:
        seen.append(os.sched_getscheduler(0))

    def run() -> None:
        note()
        raise_priority(True)
        note()
        child = threading.Thread(target=note)
        child.start()
        child.join()
        raise_priority(False)
        note()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return seen


def allowed() -> bool:
    return os.geteuid() == 0 and policies_of_a_thread()[1] == os.SCHED_FIFO


def test_a_thread_with_priority_gives_it_to_its_children():
    if not allowed():
        pytest.skip('needs real-time priority: run as root, or raise the limit rtprio')
    ordinary = os.SCHED_OTHER
    assert policies_of_a_thread() == [ordinary, os.SCHED_FIFO, os.SCHED_FIFO, ordinary]


def test_without_permission_a_thread_keeps_its_priority(monkeypatch):
    system = os.sched_setscheduler

    def forbid(thread: int, policy: int, parameters: os.sched_param) -> None:
        if policy != os.SCHED_OTHER:
            raise PermissionError
        system(thread, policy, parameters)

    monkeypatch.setattr(os, 'sched_setscheduler', forbid)
    assert len(set(policies_of_a_thread())) == 1


@pytest.mark.parametrize('first', [False, True])
def test_a_thread_with_priority_yields_to_others(monkeypatch, first):
    if first and not allowed():
        pytest.skip('needs real-time priority: run as root, or raise the limit rtprio')
    yielded: list[bool] = []
    monkeypatch.setattr(os, 'sched_yield', lambda: yielded.append(True))

    def run() -> None:
        raise_priority(first)
        yield_core()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert yielded == [True] * first


def test_it_is_first_only_while_it_mostly_waits(monkeypatch):
    asked: list[bool] = []
    now = busy = 0.0

    def note(first: bool, _threads: Sequence[int]) -> None:
        asked.append(first)

    monkeypatch.setattr(pacing, 'raise_priority', note)
    monkeypatch.setattr(pacing.time, 'monotonic', lambda: now)
    monkeypatch.setattr(pacing.time, 'process_time', lambda: busy)
    place = IdlePriority(real_time=True)
    for share in (0.5, 1.0, 1.0, 0.1):
        for _ in range(100):
            now += 0.001
            busy += 0.001 * share
            place.update()
    assert asked == [True, False, True]


def test_without_real_time_nothing_is_asked_for(monkeypatch):
    monkeypatch.setattr(pacing, 'raise_priority', lambda *_: pytest.fail('it asked'))
    IdlePriority(real_time=False).update()
