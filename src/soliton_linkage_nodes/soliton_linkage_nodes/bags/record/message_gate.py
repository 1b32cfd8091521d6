# SPDX-License-Identifier: Apache-2.0
"""Which messages a recorder lets pass: all, none while it is paused, or the last few seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from soliton_linkage_nodes.bags.record.writing_thread import Taken
from soliton_linkage_nodes.runtime.stamps import SECOND

_MOST_KEPT = 512 * 2**20
"""What the last seconds of a snapshot may take in memory [B]."""


class MessageGate:
    """Passes messages on, or holds them back.

    Of a latched topic the last message is always kept, so that what is let pass can be
    understood. The last seconds of a snapshot take 512 MiB at most.
    """

    def __init__(
        self, snapshot: float = 0.0, paused: bool = False, most_kept: int = _MOST_KEPT
    ) -> None:
        """Keep the last seconds for snapshots, or, for 0, let everything pass."""
        self.paused = paused
        self._most_kept = most_kept
        self._window = round(snapshot * SECOND)
        self._latched: dict[str, Taken] = {}
        self._kept: deque[Taken] = deque()
        self._newest = 0
        self._bytes = 0

    @property
    def held(self) -> int:
        """How many messages it holds back."""
        return len(self._kept) + len(self._latched)

    def take(self, messages: Iterable[Taken]) -> list[Taken]:
        """Return those of some messages that are to be recorded now."""
        if self.paused:
            self._remember(messages)
            return []
        if not self._window:
            return list(messages)
        for message in messages:
            self._kept.append(message)
            self._newest = max(self._newest, message.stamp)
            self._bytes += len(message.serialized)
        self._forget()
        return []

    def resume(self) -> list[Taken]:
        """End a pause and return what is to be recorded: the last latched messages."""
        self.paused = False
        return [] if self._window else self._take_latched()

    def snapshot(self) -> list[Taken]:
        """Return the last seconds, with the last latched messages before them, and forget them."""
        # On a busy machine a topic may be taken later than others that came after it.
        recent = [message for message in self._kept if not self._is_old(message)]
        self._remember(filter(self._is_old, self._kept))
        self._kept.clear()
        self._bytes = 0
        return [*self._take_latched(), *recent]

    def _remember(self, messages: Iterable[Taken]) -> None:
        self._latched.update((m.source.name, m) for m in messages if m.source.latched)

    def _take_latched(self) -> list[Taken]:
        latched = sorted(self._latched.values(), key=lambda message: message.stamp)
        self._latched.clear()
        return latched

    def _is_old(self, message: Taken) -> bool:
        return self._newest - message.stamp > self._window

    def _forget(self) -> None:
        while self._kept and (self._is_old(self._kept[0]) or self._bytes > self._most_kept):
            old = self._kept.popleft()
            self._bytes -= len(old.serialized)
            self._remember([old])
