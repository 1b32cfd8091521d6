# SPDX-License-Identifier: Apache-2.0
"""How far behind its messages a node is."""

from __future__ import annotations

import math
import time

_MEMORY = 10.0
"""How long the quickest message tells the difference of two clocks [s], which drift apart."""
_SECOND = 10**9
"""Nanoseconds."""


class Lag:
    """Tells whether a node has been behind its messages for too long.

    The quickest message of the last seconds tells how the clocks of both ends differ.
    """

    def __init__(self, longest: float) -> None:
        """Being behind by `longest` [s], for as long, is too long; 0 for never."""
        self._longest = longest or math.inf
        self._least: list[int] = []
        self._since = 0.0
        self._behind_since: float | None = None

    def too_long(self, sent: int) -> bool:
        """Whether, by a message that was sent at an instant [ns], it is behind for too long."""
        now = time.monotonic()
        apart = time.time_ns() - sent
        if not self._least or now - self._since > _MEMORY:
            self._since = now
            self._least = [*self._least[-1:], apart]
        self._least[-1] = min(self._least[-1], apart)
        if (apart - min(self._least)) / _SECOND < self._longest:
            self._behind_since = None
        elif self._behind_since is None:
            self._behind_since = now
        return self._behind_since is not None and now - self._behind_since > self._longest
