# SPDX-License-Identifier: Apache-2.0
"""Message of a bag file, and base class for the recovery of damaged files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.stored_topic import StoredTopic

LAST_STAMP = 2**63 - 1
"""Largest stamp in a signed 64-bit integer [ns since 1970]. It lies in the year 2262."""


class Message(NamedTuple):
    """Message of a bag.

    `topic` is the number of the topic. `stamp` is the receive time and `published` the publish
    time [ns].
    """

    topic: int
    sequence: int
    stamp: int
    published: int
    data: bytes


class RecoveredFile(ABC):
    """Recovery of all intact messages of a bag file that may be damaged.

    `topics` maps the topic numbers in the file to topics. `damage` contains a line of text for
    each damaged part. `lost` is the number of messages that cannot be read. `unverified` is the
    number of messages without a checksum. `stated` is the number of messages according to the
    statistics in the file, or 0 without statistics. `records` contains opcode and body of other
    records that must be copied to the recovered bag.
    """

    def __init__(
        self, path: Path, doubtful: bool = False, limits: BagLimits = DEFAULT_LIMITS
    ) -> None:
        """Read the file without its messages.

        If `doubtful` is set, wrong checksums of messages are ignored.
        """
        self.topics: dict[int, StoredTopic] = {}
        self.custom_data: dict[str, str] = {}
        self.damage: list[str] = []
        self.lost = 0
        self.unverified = 0
        self.stated = 0
        self.records: list[tuple[int, bytes | bytearray | memoryview]] = []
        self._doubtful = doubtful
        self._limits = limits
        self._read = 0
        self._scan(path)

    def messages(self) -> Iterator[tuple[StoredTopic, Message]]:
        """Yield the topic and the content of each intact message."""
        nameless = timeless = 0
        for message in self._messages():
            topic = self.topics.get(message.topic)
            if topic is None:
                nameless += 1
            elif not 0 <= message.stamp <= LAST_STAMP:
                timeless += 1
            else:
                self._read += 1
                yield topic, message
        if nameless:
            self.report_damage(f'{nameless} messages have topics whose names are lost', nameless)
        if timeless:
            why = 'messages have stamps before 1970 or after 2262, unlike MCAP'
            self.report_damage(f'{timeless} {why}', timeless)
        missing = self.stated - self._read - self.lost
        if missing > 0:
            self.report_damage(f'the index lists {missing} more messages than the file', missing)

    def report_damage(self, damage: str, lost: int = 0) -> None:
        """Add the description of a damaged part. `lost` messages in it cannot be read."""
        self.damage.append(damage)
        self.lost += lost

    @abstractmethod
    def _scan(self, path: Path) -> None:
        """Read the file, and fill `topics` and `custom_data`."""

    @abstractmethod
    def _messages(self) -> Iterator[Message]:
        """Yield the intact messages."""
