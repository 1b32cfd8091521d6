# SPDX-License-Identifier: Apache-2.0
"""The stamps of frames in their order."""

from __future__ import annotations

import math

from soliton_linkage.estimation.settings import DEFAULTS

_NANOSECOND = 1e-9
"""Unit of stamps [s]."""


class FrameClock:
    """Takes the stamps of frames, and refuses those that are late."""

    def __init__(self, limit: float = DEFAULTS.tracking.clock_limit) -> None:
        """Begin at the first stamp; one that goes back by more than the limit [s] starts anew."""
        self._limit = limit
        self.time = -math.inf
        """Instant of the last frame that was taken, from the first on [s]."""
        self.late = 0
        """Number of frames that were refused."""
        self.restarted = False
        """Whether the last one was by a clock that had been set back."""
        self._epoch: int | None = None

    def advance(self, stamp: int) -> bool:
        """Go on to a stamp [ns]; False where it is not later than the last, by up to the limit."""
        if self._epoch is None:
            self._epoch = stamp
        time = (stamp - self._epoch) * _NANOSECOND
        if -self._limit <= time - self.time <= 0:
            self.late += 1
            return False
        self.restarted = time < self.time
        self.time = time
        return True
