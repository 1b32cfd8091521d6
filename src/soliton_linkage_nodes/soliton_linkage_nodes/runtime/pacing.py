# SPDX-License-Identifier: Apache-2.0
"""A thread that acts at a fixed rate on absolute deadlines, and knows how well it did."""

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


_LONGEST_LAG = 10**8
"""Lateness that is made up for [ns]; beyond it the deadlines are put off."""
_LONGEST_SLEEP = 0.1
"""Between two looks at whether the loop has to stop or to change its rate [s]."""
_IDLE = 0.005
"""Sleep of a loop without a rate that has nothing to do [s]: a paused one costs little."""
_HOPELESSLY_LATE = 10**7
"""Lateness from which on the loop leaves the processor to others [ns]: ten periods of 1000 Hz."""


class Punctuality(NamedTuple):
    """How a paced loop has kept its deadlines since it began."""

    ticks: int
    """Times that it acted."""
    missed: int
    """Times that it acted more than a period late."""
    largest_lateness: float
    """The latest that it acted after an instant that was due [s]."""
    lag: float
    """By how much time it has fallen behind for good [s]."""


class PacedLoop:
    """Calls a function at t0 + k / rate, k = 0, 1, ..., each instant computed from k alone.

    A late call is made at once and the next deadlines stay where they are. Where the loop is
    more than 0.1 s behind, the rest of the deadlines are put off by that much: it then runs
    slower than asked for, and says so, but never in a burst.

    A loop that is to be `first` goes before other threads, as far as it may, while it is less
    than 10 ms late: one that cannot keep up leaves the processor to them. It can be started again
    once it was stopped.

    A rate that is set later counts from that moment on, as t0. At an infinite rate each call
    follows the last, but for one that returned False, as it had nothing to do.
    """

    def __init__(self, rate: float, act: Callable[[], object], first: bool = False) -> None:
        """Prepare to call `act` at a rate [Hz]."""
        self.rate = rate
        self._act = act
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._punctuality = Punctuality(0, 0, 0.0, 0.0)
        self._may_go_first = first
        self._first: bool | None = None
        self.failure: Exception | None = None

    @property
    def punctuality(self) -> Punctuality:
        """How the loop has kept its deadlines so far."""
        return self._punctuality

    def start(self) -> None:
        """Begin, with the first call at once."""
        self._stopping.clear()
        self._first = None
        self._thread = threading.Thread(target=self._run, name='pacing', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End after the call that is being made, if any."""
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
        """Act without a pause until a finite rate is set."""
        self._go_first(False)
        while math.isinf(self.rate) and not self._stopping.is_set():
            if self._act() is False:
                time.sleep(_IDLE)
            else:
                self._note(0, 0, 0)

    def _pace(self, rate: float) -> None:
        """Act at one rate until another is set."""
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
        """Sleep until an instant is due [ns]; False where the loop stops or its rate changes."""
        while not self._stopping.is_set() and self.rate == rate:
            early = (due - time.monotonic_ns()) / SECOND
            if early <= 0:
                return True
            time.sleep(min(early, _LONGEST_SLEEP))
        return False

    def _go_first(self, first: bool) -> None:
        if self._may_go_first and first is not self._first:
            self._first = first
            go_first(first)

    def _note(self, late: int, missed: int, put_off: int) -> None:
        before = self._punctuality
        self._punctuality = Punctuality(
            before.ticks + 1,
            before.missed + missed,
            max(before.largest_lateness, late / SECOND),
            before.lag + put_off / SECOND,
        )
