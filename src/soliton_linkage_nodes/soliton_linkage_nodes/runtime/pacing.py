# SPDX-License-Identifier: Apache-2.0
"""Loops that call a function at a fixed rate, and the real-time priority of threads."""

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
"""Lowest priority of SCHED_FIFO [1], which still exceeds the priority of every ordinary thread."""
_INTERVAL = 0.05
"""Time between two measurements of the processor load [s]. It is well below the 0.95 s after which
the kernel suspends real-time threads that do not pause."""
_LARGEST_SHARE = 0.8
"""A process with a larger processor load than this [cores] loses its real-time priority."""


def raise_priority(raised: bool, threads: Sequence[int] = (0,)) -> None:
    """Give threads the lowest real-time priority (SCHED_FIFO) or, if not `raised`, remove it.

    Thread 0 is the calling thread. New threads inherit the priority of the thread that starts
    them. If the process lacks the permission (limit rtprio), nothing changes.
    """
    priority = _LOWEST_PRIORITY if raised else 0
    policy = os.SCHED_FIFO if raised else os.SCHED_OTHER
    for thread in threads:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(thread, policy, os.sched_param(priority))


def yield_core() -> None:
    """Yield the core of the calling real-time thread, so that threads it has woken can run."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_yield()


class IdlePriority:
    """Real-time priority of threads, removed while the process uses more than 0.8 of a core."""

    def __init__(self, real_time: bool, threads: Sequence[int] | None = None) -> None:
        self._real_time = real_time
        self._raised = True
        self._since = (time.monotonic(), time.process_time())
        self._threads = [0, *_middleware_threads()] if threads is None else threads
        if real_time:
            raise_priority(True, self._threads)

    def update(self) -> None:
        """Raise or remove the priority according to the processor load of the last interval."""
        now, (then, busy) = time.monotonic(), self._since
        if not self._real_time or now - then < _INTERVAL:
            return
        self._since = (now, time.process_time())
        raised = self._since[1] - busy < _LARGEST_SHARE * (now - then)
        if raised is not self._raised:
            self._raised = raised
            raise_priority(raised, self._threads)


def _middleware_threads() -> list[int]:
    """Return the system thread numbers of all threads that Python has not started."""
    ours = {thread.native_id for thread in threading.enumerate()}
    numbers = (int(path.name) for path in Path('/proc/self/task').iterdir())
    return [number for number in numbers if number not in ours]


_LONGEST_LAG = 10**8
"""If a call is later than this [ns], all later deadlines are postponed by its lateness."""
_LONGEST_SLEEP = 0.1
"""The loop checks at least this often whether it was stopped or its rate was changed [s]."""
_IDLE = 0.005
"""At an infinite rate, the loop pauses for this time after a call that has returned False [s]."""
_PRIORITY_LIMIT = 10**7
"""If a call is later than this [ns], it runs without real-time priority. The limit is ten periods
at 1000 Hz."""


class Punctuality(NamedTuple):
    """Statistics of the deadlines of a loop since its start."""

    ticks: int
    missed: int
    """Number of calls that were more than one period late."""
    largest_lateness: float
    """Largest lateness of a call [s]."""
    lag: float
    """Total time by which deadlines were postponed [s]."""


class PacedLoop:
    """Thread that calls a function at the times t0 + k / rate, with k = 0, 1, ...

    The time t0 is the start of the loop or the last change of its rate. A call that is more than
    0.1 s late postpones all later deadlines, so that the missed calls do not follow in a burst. At
    an infinite rate, calls follow without pauses, except for 5 ms after a call that returns False.
    With `real_time`, the thread has real-time priority, except at an infinite rate and during
    calls that are at least 10 ms late.
    """

    def __init__(self, rate: float, act: Callable[[], object], real_time: bool = False) -> None:
        self.rate = rate
        self.punctuality = Punctuality(0, 0, 0.0, 0.0)
        self.failure: Exception | None = None
        self._act = act
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._real_time = real_time
        self._raised: bool | None = None

    def start(self) -> None:
        """Start the thread. The first call is made immediately."""
        self._stopping.clear()
        self._raised = None
        self._thread = threading.Thread(target=self._run, name='pacing', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread after the current call, and wait until it has ended."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                if math.isinf(self.rate):
                    self._run_unpaced()
                else:
                    self._run_paced(self.rate)
        except Exception as error:
            self.failure = error

    def _run_unpaced(self) -> None:
        self._set_priority(False)
        while math.isinf(self.rate) and not self._stopping.is_set():
            if self._act() is False:
                time.sleep(_IDLE)
            else:
                self._count(0, 0, 0)

    def _run_paced(self, rate: float) -> None:
        period = round(SECOND / rate)
        start = time.monotonic_ns()
        ticks, lag = 0, 0
        while True:
            due = start + lag + round(ticks * SECOND / rate)
            if not self._sleep_until(due, rate):
                return
            late = time.monotonic_ns() - due
            self._set_priority(late < _PRIORITY_LIMIT)
            self._act()
            ticks += 1
            postponed = late if late > _LONGEST_LAG else 0
            lag += postponed
            self._count(late, late > period, postponed)

    def _sleep_until(self, due: int, rate: float) -> bool:
        while not self._stopping.is_set() and self.rate == rate:
            early = (due - time.monotonic_ns()) / SECOND
            if early <= 0:
                return True
            time.sleep(min(early, _LONGEST_SLEEP))
        return False

    def _set_priority(self, raised: bool) -> None:
        if self._real_time and raised is not self._raised:
            self._raised = raised
            raise_priority(raised)

    def _count(self, late: int, missed: int, postponed: int) -> None:
        before = self.punctuality
        self.punctuality = Punctuality(
            before.ticks + 1,
            before.missed + missed,
            max(before.largest_lateness, late / SECOND),
            before.lag + postponed / SECOND,
        )
