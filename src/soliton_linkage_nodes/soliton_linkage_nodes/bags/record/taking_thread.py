# SPDX-License-Identifier: Apache-2.0
"""A thread that takes messages from the middleware and passes them on to the bag."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Sequence
from operator import attrgetter

from soliton_linkage_nodes.bags.record.account import RecordingAccount
from soliton_linkage_nodes.bags.record.connecting import Connecting
from soliton_linkage_nodes.bags.record.inlets import Inlet, InletFinder
from soliton_linkage_nodes.bags.record.message_gate import MessageGate
from soliton_linkage_nodes.bags.record.writing_thread import Taken, WritingThread
from soliton_linkage_nodes.runtime.pacing import FirstAsLongAsIdle

_POLL_INTERVAL = 0.05
"""How long messages lie in the middleware before they are taken a few at a time [s]; 5000 may."""
_LONGEST_ROUND = 5.0
"""How long who waits for a round of taking does so [s], which takes some ten milliseconds."""
_SEARCH_INTERVAL = 0.25
"""How often the graph is asked for new topics, which takes a millisecond [s]."""


class TakingThread:
    """Takes what the inlets have, and writes what the gate lets pass, in the order of receipt.

    The subscriptions belong to a node that no executor spins: executors give a callback either
    the raw message or its sequence number, and cost ten times as much as taking a few at a time.
    """

    def __init__(
        self,
        finder: InletFinder,
        gate: MessageGate,
        bag: WritingThread,
        announce: Callable[[Sequence[str]], None],
        real_time: bool = False,
    ) -> None:
        """Begin to take, and go before ordinary threads if it is to do so in real time.

        `announce` is called once all that is published is connected and the bag is kept whatever
        comes; it is given the topics of which publishers did not answer.
        """
        self.failure: Exception | None = None
        self._finder = finder
        self._gate = gate
        self._bag = bag
        self._announce = announce
        self._real_time = real_time
        self._connecting: Connecting | None = Connecting()
        self._lock = threading.Lock()
        self._account = RecordingAccount()
        self._inlets: list[Inlet] = []
        self._add(finder.of_suite())
        self._rounds = 0
        self._rounds_changed = threading.Condition()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name='taking', daemon=True)
        self._thread.start()

    @property
    def heard(self) -> list[str]:
        """Topics that somebody publishes."""
        return [inlet.source.name for inlet in self._inlets if inlet.connected]

    @property
    def losses(self) -> dict[str, int]:
        """How many messages of each topic were published and are not in the bag."""
        dropped = self._bag.dropped
        return {i.source.name: i.gaps.lost + dropped[i.source.name] for i in self._inlets}

    def pause(self) -> None:
        """Record nothing."""
        with self._lock:
            self._gate.paused = True

    def settle(self) -> None:
        """Wait until all that has come by now is taken."""
        with self._rounds_changed:
            after = self._rounds + 2
            self._rounds_changed.wait_for(lambda: self._rounds >= after, _LONGEST_ROUND)

    def resume(self) -> int:
        """Go on, with what latched topics said last in the meantime; return how much that is."""
        return self._record(self._gate.resume)

    def snapshot(self) -> int:
        """Write the last seconds, and return how many messages these are."""
        return self._record(self._gate.snapshot)

    def stop(self) -> dict[str, str]:
        """Take what is left, and return what the bag is to say of the recording."""
        self._stopping.set()
        self._thread.join()
        return self._account.texts(self.losses)

    def _run(self) -> None:
        search_at = time.monotonic()
        place = FirstAsLongAsIdle(self._real_time, [0])
        last_round = False
        try:
            while not last_round:
                last_round = self._stopping.wait(_POLL_INTERVAL)
                place.look()
                searching = time.monotonic() >= search_at and not last_round
                batch = [message for inlet in self._inlets for message in inlet.drain()]
                if searching:
                    search_at = time.monotonic() + _SEARCH_INTERVAL
                    ask = self._connecting is not None
                    batch += [message for inlet in self._inlets for message in inlet.adapt(ask)]
                    self._add(self._finder.find())
                    self._bag.note(self._account.texts(self.losses))
                self._account.hear(batch)
                batch.sort(key=attrgetter('stamp'))
                with self._lock:
                    self._bag.put(self._gate.take(batch))
                if searching:
                    self._announce_once_connected()
                self._end_round(1)
        except Exception as error:
            self.failure = error
            self._end_round(sys.maxsize)

    def _announce_once_connected(self) -> None:
        connecting = self._connecting
        if connecting is not None and connecting.done(self._inlets):
            self._connecting = None
            self._bag.when_kept(lambda: self._announce(connecting.missing))

    def _end_round(self, number: int) -> None:
        with self._rounds_changed:
            self._rounds += number
            self._rounds_changed.notify_all()

    def _record(self, held: Callable[[], list[Taken]]) -> int:
        with self._lock:
            messages = held()
            self._bag.put(messages)
        return len(messages)

    def _add(self, inlets: Sequence[Inlet]) -> None:
        for inlet in inlets:
            self._bag.begin(inlet.source)
        self._inlets = [*self._inlets, *inlets]
