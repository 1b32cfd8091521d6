# SPDX-License-Identifier: Apache-2.0
"""Which threads go before others."""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import struct
import threading
import time
from collections.abc import Sequence
from pathlib import Path

_LOWEST_PRIORITY = 1
"""Of SCHED_FIFO: before all ordinary threads and behind all others of the system."""
_SHORT_SLICE = 100_000
"""Of time that a thread asks for at one go [ns], the least that Linux grants: who asks for little
is served soon."""
_SCHED_ATTRIBUTES = struct.Struct('=IIQiIQQQ')
"""Size, policy, flags, nice, priority, runtime [ns], deadline [ns] and period [ns] of
sched_setattr(2)."""
_SCHED_SETATTR = {'x86_64': 314, 'aarch64': 274}
"""Number of that call, for which Python and most C libraries have no function."""
_C_LIBRARY = ctypes.CDLL(None)
_INTERVAL = 0.05
"""Over which the share of a core is measured [s]: the kernel stops real-time threads at 0.95 s."""
_MOST_OF_A_CORE = 0.8
"""Share of a core above which a process is one that computes and no longer one that waits [1]."""


def go_first(first: bool, threads: Sequence[int] = (0,), real_time: bool = True) -> None:
    """Let threads, and those that they start, go before ordinary ones, or no longer.

    Threads are told by their numbers in the system, 0 for the one that calls. It asks for the
    lowest real-time priority (SCHED_FIFO), for which a user needs the limit rtprio. Where the
    system does not allow that, or it is not to be in `real_time`, it asks for short slices of
    time, which any user may: from Linux 6.12 on the thread is then served soon after it wakes,
    though with no more time than others.
    """
    priority = _LOWEST_PRIORITY if first and real_time else 0
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    for thread in threads:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(thread, policy, os.sched_param(priority))
            if priority:
                continue
        _ask_for_slices(thread, _SHORT_SLICE if first else 0)


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


def _ask_for_slices(thread: int, duration: int) -> None:
    """Have the system give an ordinary thread its time in slices [ns], of its own choice for 0."""
    call = _SCHED_SETATTR.get(platform.machine())
    with contextlib.suppress(ProcessLookupError):
        nice = os.getpriority(os.PRIO_PROCESS, thread)
        asked = (_SCHED_ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, duration, 0, 0)
        if call is not None:
            _C_LIBRARY.syscall(call, thread, _SCHED_ATTRIBUTES.pack(*asked), 0)


class FirstAsLongAsIdle:
    """Lets a process go first while it mostly waits, so that overload takes nothing from others.

    That is the calling thread and those of the middleware, or what threads are given. Python's
    others see to themselves.
    """

    def __init__(self, real_time: bool, threads: Sequence[int] | None = None) -> None:
        """Let them go first, in real time or among ordinary threads."""
        self._real_time = real_time
        self._first = True
        self._since = (time.monotonic(), time.process_time())
        self._threads = [0, *foreign_threads()] if threads is None else threads
        go_first(True, self._threads, real_time)

    def look(self) -> None:
        """Change its place where the share of a core that it took of late asks for that."""
        now, (then, busy) = time.monotonic(), self._since
        if now - then < _INTERVAL:
            return
        self._since = (now, time.process_time())
        first = self._since[1] - busy < _MOST_OF_A_CORE * (now - then)
        if first is not self._first:
            self._first = first
            go_first(first, self._threads, self._real_time)
