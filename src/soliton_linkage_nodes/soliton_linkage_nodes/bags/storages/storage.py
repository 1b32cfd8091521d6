# SPDX-License-Identifier: Apache-2.0
"""What a kind of file has to offer so that bags are made of it: writing, rescue and reading."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soliton_linkage_nodes.bags.guards.limits import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.storages.connections import LAST_STAMP
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol


class FileWriter(ABC):
    """A file of a bag that is being written; methods raise OSError where the disk refuses.

    `counts` holds the messages of each topic by its number, `span` the stamps of the first and
    the last [ns]. What was flushed is whole, whenever and however the process ends.
    """

    def __init__(self) -> None:
        """Begin without messages."""
        self.counts: Counter[int] = Counter()
        self.span: tuple[int, int] | None = None

    @property
    @abstractmethod
    def size(self) -> int:
        """About how many bytes the file takes, with those that wait to be flushed."""

    @abstractmethod
    def add_topic(self, topic: StoredTopic) -> None:
        """Begin to store a topic."""

    @abstractmethod
    def write(self, number: int, stamp: int, serialized: bytes) -> None:
        """Store a message of the topic with a number, received at a time [ns]."""

    @abstractmethod
    def flush(self) -> None:
        """Hand all messages to the system, which keeps them if this process is killed."""

    @abstractmethod
    def discard(self) -> None:
        """Forget what the disk refused."""

    @abstractmethod
    def note(self, texts: Mapping[str, str]) -> None:
        """Keep texts, also if the file is never closed."""

    @abstractmethod
    def close(self, metadata: str) -> None:
        """Write what is left and the bag's metadata, and end the file."""

    @abstractmethod
    def abandon(self) -> None:
        """End the file as it is."""

    def _widen(self, stamps: Collection[int]) -> None:
        """Let the span take in stamps, of which there are some."""
        known = [*(self.span or ()), *stamps]
        self.span = (min(known), max(known))


class RescuedFile(ABC):
    """A file of a bag of which as much as possible is read.

    `topics` are known by their numbers in the file, `custom_data` are the texts that were kept
    in it. `damage` says line by line what is wrong with the file, and `lost` counts messages that
    are known to be in it and cannot be read, `unverified` those that were read and have no
    checksum; all are complete after the last message.
    """

    def __init__(
        self, path: Path, doubtful: bool = False, limits: BagLimits = DEFAULT_LIMITS
    ) -> None:
        """Look through the file; messages with wrong checksums count if they may be `doubtful`.

        What asks for more than the limits is left out, as damage.
        """
        self.topics: dict[int, StoredTopic] = {}
        self.custom_data: dict[str, str] = {}
        self.damage: list[str] = []
        self.lost = 0
        self.unverified = 0
        self._doubtful = doubtful
        self._limits = limits
        self._read = 0
        self._learn(path)

    def messages(self) -> Iterator[tuple[StoredTopic, int, bytes]]:
        """Yield the intact messages with their topics and stamps [ns]."""
        nameless = timeless = 0
        for number, stamp, data in self._messages():
            topic = self.topics.get(number)
            if topic is None:
                nameless += 1
            elif not 0 <= stamp <= LAST_STAMP:
                timeless += 1
            else:
                self._read += 1
                yield topic, stamp, data
        if nameless:
            self.complain(f'{nameless} messages are of topics whose names are lost', nameless)
        if timeless:
            self.complain(f'{timeless} messages have stamps before 1970 or after 2262', timeless)
        self._conclude()

    def complain(self, damage: str, lost: int = 0) -> None:
        """Note what is wrong, and how many messages it costs."""
        self.damage.append(damage)
        self.lost += lost

    @abstractmethod
    def _learn(self, path: Path) -> None:
        """Fill `topics` and `custom_data`."""

    @abstractmethod
    def _messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield topic number, stamp [ns] and bytes of the intact messages."""

    @abstractmethod
    def _conclude(self) -> None:
        """Say what is known to be wrong once all messages were read."""


@dataclass(frozen=True)
class Storage:
    """A kind of file that bags are made of.

    `suffix` ends the names of its files. `writers` create a file at a path, by the name of the
    compression, of which one is 'none'. `rescue` takes a path, whether messages with wrong
    checksums count, and limits. `reader` is what rosbags opens an intact file with; it is told
    the limits if it is a `LimitedReader`.
    """

    suffix: str
    writers: Mapping[str, Callable[[Path], FileWriter]]
    rescue: Callable[[Path, bool, BagLimits], RescuedFile]
    reader: type[ReaderProtocol]
