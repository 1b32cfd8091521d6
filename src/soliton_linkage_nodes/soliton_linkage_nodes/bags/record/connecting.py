# SPDX-License-Identifier: Apache-2.0
"""Whether all that is published is connected: processes find each other one after the other."""

from __future__ import annotations

import time
from collections.abc import Sequence

from soliton_linkage_nodes.bags.record.inlets import Inlet

_ALL_ANNOUNCED = 3.2
"""Each process announces itself every 3 s [s]: who has not been heard by then publishes nothing.
Without load most are heard at once, beside busy programs one in three later than in a second."""
_QUIET = 1.0
"""Without a further publisher, after which all that a process publishes is known [s]."""
_LONGEST = 10.0
"""That it waits for a publisher that does not answer, as one that has died does not [s]."""


class Connecting:
    """Watches publishers of the topics that are recorded until no further one is expected."""

    def __init__(self) -> None:
        """Begin when the topics were subscribed to."""
        self.missing: list[str] = []
        """Topics with publishers that were not connected in time."""
        self._begun = self._since = time.monotonic()
        self._known: list[tuple[str, int, int]] = []

    def done(self, inlets: Sequence[Inlet]) -> bool:
        """Whether all are connected, by what the inlets saw when they last looked."""
        now = time.monotonic()
        known = [(inlet.source.name, inlet.publishers, inlet.connected) for inlet in inlets]
        if known != self._known:
            self._known, self._since = known, now
        self.missing = [name for name, publishers, connected in known if connected < publishers]
        if now < max(self._since + _QUIET, self._begun + _ALL_ANNOUNCED):
            return False
        return not self.missing or now - self._begun > _LONGEST
