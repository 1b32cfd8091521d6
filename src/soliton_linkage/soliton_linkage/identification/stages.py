# SPDX-License-Identifier: Apache-2.0
"""Progress of an identification, as the fraction of the work that is done."""

from __future__ import annotations

import math
from collections.abc import Callable


class Stages:
    """Reporter of the fraction of the work that is done [1]; the fraction never decreases."""

    def __init__(self, report: Callable[[float], None] = lambda done: None) -> None:
        self._report, self._done = report, 0.0
        self._begin, self._end = 0.0, 1.0

    def enter(self, begin: float, end: float) -> None:
        """Begin a stage that increases the fraction from `begin` to `end` [1]."""
        self._begin, self._end = begin, end
        self.show(0.0)

    def show(self, part: float) -> None:
        """Report the progress if the fraction `part` of the current stage is done [1]."""
        done = self._begin + (self._end - self._begin) * min(max(part, 0.0), 1.0)
        if done > self._done:
            self._done = done
            self._report(done)

    def show_decrease(self, first: float, now: float, last: float) -> None:
        """Report the progress of an iteration whose present error is `now`.

        The iteration starts with the error `first` and ends with the error `last`. The logarithm
        of the error is assumed to decrease at a constant rate.
        """
        if first > now > 0 and first > last:
            self.show(math.log(first / now) / math.log(first / last))
