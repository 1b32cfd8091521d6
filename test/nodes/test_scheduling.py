# SPDX-License-Identifier: Apache-2.0
"""A thread goes first and back where that is allowed, and as before where it is not."""

from __future__ import annotations

import os
import threading

import pytest

from soliton_linkage_nodes.scheduling import go_first


def policies_of_a_thread() -> list[int]:
    """Of a thread before it goes first, while it does, of one that it begins, and afterwards."""
    seen: list[int] = []

    def note() -> None:
        seen.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)

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


def test_a_thread_goes_first_and_those_that_it_begins_do_not() -> None:
    if not allowed():
        pytest.skip('this user may not go first')
    ordinary = os.SCHED_OTHER
    assert policies_of_a_thread() == [ordinary, os.SCHED_FIFO, ordinary, ordinary]


def test_where_it_is_not_allowed_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbid(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, 'sched_setscheduler', forbid)
    assert len(set(policies_of_a_thread())) == 1
