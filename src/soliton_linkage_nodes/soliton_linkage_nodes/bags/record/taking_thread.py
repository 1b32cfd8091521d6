# SPDX-License-Identifier: Apache-2.0
"""A thread that takes messages from the middleware and passes them on to the bag."""

from __future__ import annotations

import json
import shlex
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.metadata import suite_version
from soliton_linkage_nodes.bags.read.reading import type_name
from soliton_linkage_nodes.bags.record.inlets import Inlet, InletFinder
from soliton_linkage_nodes.bags.record.message_gate import MessageGate
from soliton_linkage_nodes.bags.record.writing_thread import Taken, WritingThread
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import IdlePriority

_LONGEST_TEXT = 1000
"""Characters of a value that is told twice, in its message and here: lists of a number for each
of thousands of rotors are not."""
_CHAIN_TYPE = type_name(interfaces.CHAIN.type)


class RecordingAccount:
    """Keeps what is to be said of the messages that were taken."""

    def __init__(self) -> None:
        """Begin without a chain."""
        self._chains: dict[str, dict[str, Any]] = {}

    def hear(self, messages: Iterable[Taken]) -> None:
        """Take note of messages."""
        for source, _, serialized in messages:
            if source.type_name == _CHAIN_TYPE:
                self._chains[source.name] = _parameters_of(serialized)

    def texts(self, losses: Mapping[str, int]) -> dict[str, str]:
        """Texts for the bag, with how many messages of each topic are not in it."""
        return {
            'lost_messages': json.dumps(losses),
            'chain': json.dumps(self._chains),
            'suite_version': suite_version(),
            'command_line': shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        }


def _parameters_of(serialized: bytes) -> dict[str, Any]:
    """Parameters of a chain, without the lists that are too long to be told twice."""
    message = deserialize_message(serialized, interfaces.CHAIN.type)
    told: dict[str, Any] = {'number_of_rotors': len(message.joint_names)}
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if hasattr(value, '__len__') and not isinstance(value, str):
            value = list(value)
        if name not in ('header', 'joint_names') and len(str(value)) < _LONGEST_TEXT:
            told[name] = value
    return told


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
        priority = IdlePriority(self._real_time, [0])
        last_round = False
        try:
            while not last_round:
                last_round = self._stopping.wait(_POLL_INTERVAL)
                priority.update()
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
