# SPDX-License-Identifier: Apache-2.0
"""How the clock that stamps messages differs from the one here, and drifts away from it."""

from __future__ import annotations

from soliton_linkage_nodes.runtime.stamps import SECOND

_SHORTEST = 10.0
"""Time from which on a drift is told [s]: ways of messages differ by milliseconds, so that it is
known to 100 ppm by then, which is what a poor quartz drifts."""


class ClockWatch:
    """Compares stamps with when they come; the quickest message of a while tells the difference.

    Stamps of a simulation that was paused, or of a bag, differ from the clock as well. Nothing
    that a node does depends on the difference: that of messages is reckoned by their stamps
    alone, their age by when they come.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._least: int | None = None
        self._latest = 0
        self._first: tuple[int, int] | None = None

    def note(self, stamp: int, now: int) -> None:
        """Take note of a message's stamp and of the time when it came, both [ns]."""
        behind = now - stamp
        if self._least is None or behind < self._least:
            self._least, self._latest = behind, now

    def figures(self) -> dict[str, float]:
        """What the messages since the last call tell; nothing where none has come."""
        if self._least is None:
            return {}
        least, at, self._least = self._least, self._latest, None
        told = {'stamps behind the clock [s]': least / SECOND}
        if self._first is None:
            self._first = (at, least)
        elapsed = (at - self._first[0]) / SECOND
        if elapsed >= _SHORTEST:
            drift = 1e6 * (least - self._first[1]) / SECOND / elapsed
            told['drift of stamps against the clock [ppm]'] = drift
        return told
