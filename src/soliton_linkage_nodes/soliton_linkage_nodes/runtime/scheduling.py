# SPDX-License-Identifier: Apache-2.0
"""Which threads go before others."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Sequence
from pathlib import Path

_LOWEST_PRIORITY = 1
"""Of SCHED_FIFO: before all ordinary threads and behind all others of the system."""
_INTERVAL = 0.05
"""Over which the share of a core is measured [s]: the kernel stops real-time threads at 0.95 s."""
_MOST_OF_A_CORE = 0.8
"""Share of a core above which a process is one that computes and no longer one that waits [1]."""


def go_first(first: bool, threads: Sequence[int] = (0,)) -> None:
    """Give threads, and those that they start, priority over ordinary ones, or no longer.

    Threads are given by their numbers in the system, 0 for the one that calls. It is the lowest
    real-time priority (SCHED_FIFO), for which a user needs the limit rtprio; without it nothing
    changes.
    """
    priority = _LOWEST_PRIORITY if first else 0
    policy = os.SCHED_FIFO if first else os.SCHED_OTHER
    for thread in threads:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(thread, policy, os.sched_param(priority))


def foreign_threads() -> list[int]:
    """Threads of this process that are none of Python's, as those of the middleware."""
    ours = {thread.native_id for thread in threading.enumerate()}
    return [
        int(path.name) for path in Path('/proc/self/task').iterdir() if int(path.name) not in ours
    ]


def let_others_go() -> None:
    """Let those threads go that go first as well and wait for the same core.

    A thread of SCHED_FIFO that has woken others keeps them waiting until it sleeps, where the
    other cores are busy. An ordinary thread, which might lose its core for long, goes on.
    """
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_yield()


class FirstAsLongAsIdle:
    """Lets a process go first while it mostly waits, so that overload takes nothing from others.

    That is the calling thread and those of the middleware, or what threads are given. Python's
    others see to themselves.
    """

    def __init__(self, real_time: bool, threads: Sequence[int] | None = None) -> None:
        """Let them go first, unless they are not to run in `real_time`."""
        self._real_time = real_time
        self._first = True
        self._since = (time.monotonic(), time.process_time())
        self._threads = [0, *foreign_threads()] if threads is None else threads
        if real_time:
            go_first(True, self._threads)

    def look(self) -> None:
        """Change its place where the share of a core that it took of late asks for that."""
        now, (then, busy) = time.monotonic(), self._since
        if not self._real_time or now - then < _INTERVAL:
            return
        self._since = (now, time.process_time())
        first = self._since[1] - busy < _MOST_OF_A_CORE * (now - then)
        if first is not self._first:
            self._first = first
            go_first(first, self._threads)
