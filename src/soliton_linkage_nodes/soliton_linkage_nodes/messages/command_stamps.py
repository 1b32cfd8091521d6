# SPDX-License-Identifier: Apache-2.0
"""The one rule for when a command was made, when it begins and how long it lasts."""

from __future__ import annotations

from dataclasses import dataclass

from soliton_linkage_nodes.runtime.stamps import SECOND


@dataclass(frozen=True)
class StampRule:
    """Which stamps and durations commands may have; a stamp of 0 means now.

    oldest: age of a command [s], 0 for as old as it may be long.
    longest: time that a command may last or lie ahead [s].
    """

    oldest: float
    longest: float

    def check_at_once(self, source: str, stamp: int, now: int) -> None:
        """Raise ValueError for a command to be carried out at once, of a stamp and time [ns]."""
        age = self._age(stamp, now)
        limit = self.oldest or self.longest
        if age > limit:
            raise ValueError(
                f'{source} is {age:.3g} s old, the limit is {limit:g} s; send it in time, or with '
                'a stamp of 0, which means now, or raise command_timeout'
            )
        if -age > limit:
            raise ValueError(
                f'{source} is of {-age:.3g} s ahead, the limit is {limit:g} s; set the clocks, or '
                'send it with a stamp of 0, which means now'
            )

    def delay(self, source: str, stamp: int, now: int, duration: float) -> float:
        """Time until a command begins that lasts for a duration [s]; ValueError where refused."""
        delay = -self._age(stamp, now)
        if delay + duration < 0:
            raise ValueError(
                f'{source} was over {-duration - delay:.3g} s ago; send it in time, or with a '
                'stamp of 0, which means now'
            )
        self.check_length(source, max(delay, 0.0) + duration)
        return delay

    def check_length(self, source: str, ends: float) -> None:
        """Raise ValueError for a command that ends too late after now [s]."""
        if ends > self.longest:
            raise ValueError(
                f'{source} ends {ends:.3g} s from now, the limit is {self.longest:g} s; send '
                'shorter ones, or raise longest_command'
            )

    @staticmethod
    def _age(stamp: int, now: int) -> float:
        return (now - stamp) / SECOND if stamp else 0.0
