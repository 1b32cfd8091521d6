# SPDX-License-Identifier: Apache-2.0
"""A thread goes first and back where that is allowed, and as before where it is not."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence

import pytest

from soliton_linkage_nodes.runtime import scheduling
from soliton_linkage_nodes.runtime.scheduling import FirstAsLongAsIdle, go_first, let_others_go


def policies_of_a_thread() -> list[int]:
    """Of a thread before it goes first, while it does, of one that it begins, and afterwards."""
    seen: list[int] = []

    def note() -> None:
        seen.append(os.sched_getscheduler(0))

    def run() -> None:
        note()
        go_first(True)
        note()
        child = threading.Thread(target=note)
        child.start()
        child.join()
        go_first(False)
        note()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return seen


def allowed() -> bool:
    return os.geteuid() == 0 and policies_of_a_thread()[1] == os.SCHED_FIFO


def test_a_thread_goes_first_and_so_do_those_that_it_begins() -> None:
    if not allowed():
        pytest.skip('this user may not go first')
    ordinary = os.SCHED_OTHER
    assert policies_of_a_thread() == [ordinary, os.SCHED_FIFO, os.SCHED_FIFO, ordinary]


def test_where_it_is_not_allowed_a_thread_stays_an_ordinary_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    system = os.sched_setscheduler

    def forbid(thread: int, policy: int, parameters: os.sched_param) -> None:
        if policy != os.SCHED_OTHER:
            raise PermissionError
        system(thread, policy, parameters)

    monkeypatch.setattr(os, 'sched_setscheduler', forbid)
    assert len(set(policies_of_a_thread())) == 1


def test_a_thread_that_has_ended_is_passed_over() -> None:
    thread = threading.Thread()
    thread.start()
    thread.join()
    assert thread.native_id is not None
    go_first(True, [thread.native_id])


@pytest.mark.parametrize('first', [False, True])
def test_a_thread_lets_others_go_where_it_goes_first_itself(
    monkeypatch: pytest.MonkeyPatch, first: bool
) -> None:
    if first and not allowed():
        pytest.skip('this user may not go first')
    yielded: list[bool] = []
    monkeypatch.setattr(os, 'sched_yield', lambda: yielded.append(True))

    def run() -> None:
        go_first(first)
        let_others_go()

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert yielded == [True] * first


def test_it_is_first_only_while_it_mostly_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    now = busy = 0.0

    def note(first: bool, _threads: Sequence[int]) -> None:
        asked.append(first)

    monkeypatch.setattr(scheduling, 'go_first', note)
    monkeypatch.setattr(scheduling.time, 'monotonic', lambda: now)
    monkeypatch.setattr(scheduling.time, 'process_time', lambda: busy)
    place = FirstAsLongAsIdle(real_time=True)
    for share in (0.5, 1.0, 1.0, 0.1):
        for _ in range(100):
            now += 0.001
            busy += 0.001 * share
            place.look()
    assert asked == [True, False, True]


def test_without_real_time_nothing_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduling, 'go_first', lambda *_: pytest.fail('it asked'))
    FirstAsLongAsIdle(real_time=False).look()
