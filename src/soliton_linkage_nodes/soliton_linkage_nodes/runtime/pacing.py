# SPDX-License-Identifier: Apache-2.0
"""Loops at a fixed rate on absolute deadlines, and the real-time priority of threads."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from soliton_linkage_nodes.runtime.stamps import SECOND

_LOWEST_PRIORITY = 1
"""Priority in SCHED_FIFO [1]: above ordinary threads, below all other real-time threads."""
_INTERVAL = 0.05
"""Interval between two measurements of the share of a core [s]: the kernel stops real-time threads
after 0.95 s."""
_MOST_OF_A_CORE = 0.8
"""Largest share of a core of a process that keeps its priority [1]."""


def raise_priority(first: bool, threads: Sequence[int] = (0,)) -> None:
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
    """Return the numbers of the threads that Python did not start, as those of the middleware."""
    ours = {thread.native_id for thread in threading.enumerate()}
    return [
        int(path.name) for path in Path('/proc/self/task').iterdir() if int(path.name) not in ours
    ]


def yield_core() -> None:
    """Yield the core to other real-time threads; an ordinary thread continues.

    A SCHED_FIFO thread that has woken others keeps them waiting until it sleeps, if the other
    cores are busy.
    """
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_yield()


class IdlePriority:
    """Priority of a process while it mostly waits, so that overload takes nothing from others.

    By default it is that of the calling thread and of the middleware's threads.
    """

    def __init__(self, real_time: bool, threads: Sequence[int] | None = None) -> None:
        """Give the threads priority in `real_time`, otherwise do nothing."""
        self._real_time = real_time
        self._first = True
        self._since = (time.monotonic(), time.process_time())
        self._threads = [0, *foreign_threads()] if threads is None else threads
        if real_time:
            raise_priority(True, self._threads)

    def update(self) -> None:
        """Update the priority by the share of a core that the process took recently."""
        now, (then, busy) = time.monotonic(), self._since
        if not self._real_time or now - then < _INTERVAL:
            return
        self._since = (now, time.process_time())
        first = self._since[1] - busy < _MOST_OF_A_CORE * (now - then)
        if first is not self._first:
            self._first = first
            raise_priority(first, self._threads)


_LONGEST_LAG = 10**8
"""Largest lateness that is made up for [ns]; beyond it the deadlines are postponed."""
_LONGEST_SLEEP = 0.1
"""Longest time between two checks for a stop or another rate [s]."""
_IDLE = 0.005
"""Sleep of a loop of infinite rate that has nothing to do [s]."""
_HOPELESSLY_LATE = 10**7
"""Lateness above which a loop has no priority [ns]: ten periods of 1000 Hz."""


class Punctuality(NamedTuple):
    """Deadlines of a loop since it began."""

    ticks: int
    """Number of calls."""
    missed: int
    """Number of calls more than a period late."""
    largest_lateness: float
    """Largest lateness of a call [s]."""
    lag: float
    """Time by which the deadlines were postponed [s]."""


class PacedLoop:
    """Thread that calls a function at t0 + k / rate, computed from k = 0, 1, ... alone.

    A late call is made at once, and the next deadlines stay. If the loop is more than 0.1 s
    behind, all later deadlines are postponed by that much, so that there is no burst. A rate that
    is set later counts from that moment, as t0. At an infinite rate each call follows the last,
    after a pause if that returned False because it had nothing to do.

    With `first` the thread has priority while it is less than 10 ms late. A loop can be started
    again after a stop.
    """

    def __init__(self, rate: float, act: Callable[[], object], first: bool = False) -> None:
        """Prepare to call `act` at a rate [Hz]."""
        self.rate = rate
        self.punctuality = Punctuality(0, 0, 0.0, 0.0)
        self.failure: Exception | None = None
        self._act = act
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._may_go_first = first
        self._first: bool | None = None

    def start(self) -> None:
        """Start, with the first call at once."""
        self._stopping.clear()
        self._first = None
        self._thread = threading.Thread(target=self._run, name='pacing', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop after the current call."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                if math.isinf(self.rate):
                    self._race()
                else:
                    self._pace(self.rate)
        except Exception as error:
            self.failure = error

    def _race(self) -> None:
        self._go_first(False)
        while math.isinf(self.rate) and not self._stopping.is_set():
            if self._act() is False:
                time.sleep(_IDLE)
            else:
                self._note(0, 0, 0)

    def _pace(self, rate: float) -> None:
        period = round(SECOND / rate)
        start = time.monotonic_ns()
        ticks, lag = 0, 0
        while True:
            due = start + lag + round(ticks * SECOND / rate)
            if not self._reach(due, rate):
                return
            late = time.monotonic_ns() - due
            self._go_first(late < _HOPELESSLY_LATE)
            self._act()
            ticks += 1
            put_off = late if late > _LONGEST_LAG else 0
            lag += put_off
            self._note(late, late > period, put_off)

    def _reach(self, due: int, rate: float) -> bool:
        """Sleep until an instant [ns]; return False if the loop stops or its rate changes."""
        while not self._stopping.is_set() and self.rate == rate:
            early = (due - time.monotonic_ns()) / SECOND
            if early <= 0:
                return True
            time.sleep(min(early, _LONGEST_SLEEP))
        return False

    def _go_first(self, first: bool) -> None:
        if self._may_go_first and first is not self._first:
            self._first = first
            raise_priority(first)

    def _note(self, late: int, missed: int, put_off: int) -> None:
        before = self.punctuality
        self.punctuality = Punctuality(
            before.ticks + 1,
            before.missed + missed,
            max(before.largest_lateness, late / SECOND),
            before.lag + put_off / SECOND,
        )
