# SPDX-License-Identifier: Apache-2.0
"""How long ago something came, by the clock on the wall."""

from __future__ import annotations

import math
import time


class Freshness:
    """Tells whether what came last is young enough to act on."""

    def __init__(self, longest: float) -> None:
        """What is older than `longest` [s] is too old; so is what never came."""
        self._longest = longest
        self._came_at = -math.inf

    def renew(self) -> None:
        """Note that something came."""
        self._came_at = time.monotonic()

    @property
    def age(self) -> float:
        """Of what came last [s], infinite where nothing did."""
        return time.monotonic() - self._came_at

    @property
    def stale(self) -> bool:
        """Whether it is too old."""
        return self.age > self._longest

    def __str__(self) -> str:
        """How old it is, in words."""
        age = self.age
        return 'none has come' if math.isinf(age) else f'the last is {age:.3g} s old'
