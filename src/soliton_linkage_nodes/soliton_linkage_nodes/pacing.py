# SPDX-License-Identifier: Apache-2.0
"""A thread that acts at a fixed rate on absolute deadlines, and knows how well it did."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

_NANOSECONDS = 10**9
_LONGEST_LAG = 10**8


@dataclass(frozen=True)
class Punctuality:
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
    """

    def __init__(self, rate: float, act: Callable[[], None]) -> None:
        """Prepare to call `act` at a rate [Hz]."""
        self._rate = rate
        self._act = act
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='pacing', daemon=True)
        self._punctuality = Punctuality(0, 0, 0.0, 0.0)
        self.failure: Exception | None = None

    @property
    def punctuality(self) -> Punctuality:
        """How the loop has kept its deadlines so far."""
        return self._punctuality

    def start(self) -> None:
        """Begin, with the first call at once."""
        self._thread.start()

    def stop(self) -> None:
        """End after the call that is being made, if any."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        try:
            self._loop()
        except Exception as error:
            self.failure = error

    def _loop(self) -> None:
        period = round(_NANOSECONDS / self._rate)
        start = time.monotonic_ns()
        ticks, missed, latest, lag = 0, 0, 0, 0
        while not self._stopping.is_set():
            due = start + lag + round(ticks * _NANOSECONDS / self._rate)
            early = due - time.monotonic_ns()
            if early > 0:
                time.sleep(early / _NANOSECONDS)
            late = time.monotonic_ns() - due
            self._act()
            ticks += 1
            missed += late > period
            latest = max(latest, late)
            if late > _LONGEST_LAG:
                lag += late
            self._punctuality = Punctuality(
                ticks, missed, latest / _NANOSECONDS, lag / _NANOSECONDS
            )
