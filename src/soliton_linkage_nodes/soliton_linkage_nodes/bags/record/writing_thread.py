# SPDX-License-Identifier: Apache-2.0
"""A thread that does all that touches a bag, so that a slow disk holds up nobody else."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from rclpy.qos import QoSProfile

from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.stored_topic import StoredTopic
from soliton_linkage_nodes.runtime.pacing import IdlePriority

_TICK = 0.1
"""How often the bag is told of the time where no messages come, so that it flushes [s]."""
_LONGEST_FLUSH = 5.0
"""How long who asks for a flush waits for the disk [s]; what is put is written all the same."""
_MOST_WAITING = 512 * 2**20
"""What may wait in memory [B]: ten seconds of a thousand rotors at 1000 Hz."""


@dataclass(frozen=True, eq=False)
class Source:
    """A topic that is recorded: its name, type, and the qualities of service offered."""

    name: str
    type_name: str
    profiles: tuple[QoSProfile, ...]
    latched: bool = False


class Taken(NamedTuple):
    """A message as it was taken: whence, when it was received [ns], and what."""

    source: Source
    stamp: int
    serialized: bytes


class WritingThread:
    """Writes messages in the order in which they are put, however long the disk takes.

    While it is behind, up to 512 MiB wait in memory; beyond that messages are dropped and
    counted. A failure to write ends the bag, as far as it goes, and is kept for who asks.
    """

    def __init__(
        self,
        create_writer: Callable[[], BagWriter],
        most_waiting: int = _MOST_WAITING,
        real_time: bool = False,
    ) -> None:
        """Create the bag, and go before ordinary threads if it is to do so in real time.

        Raises what the writer raises.
        """
        self.dropped: Counter[str] = Counter()
        self.failure: Exception | None = None
        self.refused: dict[str, str] = {}
        self._most_waiting = most_waiting
        self._waiting: deque[Callable[[], object]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._ending = False
        self._real_time = real_time
        self._final: Mapping[str, str] = {}
        self._topics: dict[Source, StoredTopic | None] = {}
        self._ready = threading.Event()
        self._thread = threading.Thread(
            target=self._run, args=(create_writer,), name='bag', daemon=True
        )
        self._thread.start()
        self._ready.wait()
        if self.failure is not None:
            self._thread.join()
            raise self.failure

    @property
    def writer(self) -> BagWriter:
        """The bag; what it says may be read from any thread."""
        return self._writer

    @property
    def waiting(self) -> int:
        """Bytes of messages that wait to be written."""
        return self._bytes

    def put(self, messages: Sequence[Taken]) -> None:
        """Have messages written, soon."""
        if not messages:
            return
        size = sum(len(message.serialized) for message in messages)
        with self._changed:
            if self.failure is not None or self._bytes + size > self._most_waiting:
                self.dropped.update(message.source.name for message in messages)
                return
            self._bytes += size
            self._waiting.append(lambda: self._write(messages, size))
            self._changed.notify()

    def begin(self, source: Source) -> None:
        """Have a topic in the bag, though it may never get a message."""
        self._post(lambda: self._begin(source))

    def note(self, texts: Mapping[str, str]) -> None:
        """Have texts kept in the bag."""
        self._post(lambda: self._writer.note(texts))

    def split(self) -> None:
        """Have the bag go on in a new file."""
        self._post(self._writer.split)

    def flush(self) -> None:
        """Wait, not for long, until all that was put is with the system."""
        written = threading.Event()

        def write() -> None:
            self._writer.flush()
            written.set()

        if self.failure is None:
            self._post(write)
            written.wait(_LONGEST_FLUSH)

    def when_kept(self, act: Callable[[], object]) -> None:
        """Have something done as soon as all that was put is kept whatever comes."""

        def keep() -> None:
            self._writer.keep()
            act()

        self._post(keep)

    def close(self, custom_data: Mapping[str, str]) -> None:
        """Write all that waits and finish the bag; what fails is kept."""
        with self._changed:
            self._final = custom_data
            self._ending = True
            self._changed.notify()
        self._thread.join()

    def abandon(self) -> None:
        """End a bag that is not to be recorded after all; without a message nothing is left."""
        self.close({})
        self._writer.leave_nothing()

    def _post(self, action: Callable[[], object]) -> None:
        with self._changed:
            self._waiting.append(action)
            self._changed.notify()

    def _run(self, create_writer: Callable[[], BagWriter]) -> None:
        try:
            self._writer = create_writer()
        except Exception as error:
            self.failure = error
            return
        finally:
            self._ready.set()
        priority = IdlePriority(self._real_time, [0])
        try:
            while (action := self._next()) is not None:
                action()
                priority.update()
            self._writer.close(self._final)
        except Exception as error:
            self._fail(error)

    def _next(self) -> Callable[[], object] | None:
        """What to do next; None at the end."""
        with self._changed:
            if not self._waiting and not self._ending:
                self._changed.wait(_TICK)
            if self._waiting:
                return self._waiting.popleft()
            return None if self._ending else self._writer.tick

    def _fail(self, error: Exception) -> None:
        try:
            self._writer.rescue()
        except Exception:
            self.failure = error
            raise
        kept = f'the {self._writer.messages} messages before are kept'
        if not self._writer.finished:
            kept = f'recover_bag {self._writer.path} brings back what was written before'
        with self._changed:
            self.failure = OSError(f'{error}; {kept}') if isinstance(error, OSError) else error
            self._waiting.clear()
            self._bytes = 0

    def _begin(self, source: Source) -> StoredTopic | None:
        if source not in self._topics:
            try:
                self._topics[source] = self._writer.add_topic(
                    source.name, source.type_name, *source.profiles
                )
            except ValueError as error:
                self._topics[source] = None
                self.refused[source.name] = str(error)
        return self._topics[source]

    def _write(self, messages: Sequence[Taken], size: int) -> None:
        stored = [
            (topic, stamp, serialized)
            for source, stamp, serialized in messages
            if (topic := self._begin(source)) is not None
        ]
        self._writer.write_all(stored)
        with self._changed:
            self._bytes -= size
