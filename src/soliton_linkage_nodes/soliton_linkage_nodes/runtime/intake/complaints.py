# SPDX-License-Identifier: Apache-2.0
"""Complaints about what comes in, each said at once, and floods of them once a while."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

MOST_LINES = 100
"""In a period [1]: more than a person reads, and no burden where thousands are made up."""
_NUMBERS = re.compile(r'[-+]?(?:\d+\.?\d*(?:e[-+]?\d+)?|\binf\b|\bnan\b)')
"""A complaint with other numbers is the same."""


class Complaints:
    """Says each distinct complaint once a period, and how many like it there were meanwhile."""

    def __init__(self, say: Callable[[str], object], period: float) -> None:
        """`say` is called with each line; the period is in [s]."""
        self._say = say
        self._period = period
        self._begun = -period
        self._said: dict[str, int] = {}
        self._before: dict[str, int] = {}
        self._unsaid = self._unsaid_before = 0

    def __len__(self) -> int:
        """How many are kept in mind."""
        return len(self._said)

    def tell(self, complaint: str) -> None:
        """Say a complaint, unless one like it was said within the period."""
        now = time.monotonic()
        if now - self._begun >= self._period:
            self._begun = now
            self._before, self._said = self._said, {}
            self._unsaid_before, self._unsaid = self._unsaid, 0
        kind = _NUMBERS.sub('#', complaint)
        if kind in self._said:
            self._said[kind] += 1
        elif len(self._said) < MOST_LINES:
            self._said[kind] = 0
            self._say(complaint + self._of_before(kind))
        else:
            self._unsaid += 1

    def _of_before(self, kind: str) -> str:
        alike, self._before[kind] = self._before.get(kind, 0), 0
        others, self._unsaid_before = self._unsaid_before, 0
        if alike:
            return f' (and {alike} more like it)'
        return f' (and {others} other complaints in the second before)' if others else ''
