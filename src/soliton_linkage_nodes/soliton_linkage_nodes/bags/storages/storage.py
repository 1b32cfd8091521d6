# SPDX-License-Identifier: Apache-2.0
"""Common parts of the readers of bag files, and the interface of recovery from damaged files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2.metadata import ReaderMetadata, parse_qos

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, profiles_in

if TYPE_CHECKING:
    from rosbags.rosbag2.reader import ReaderProtocol

_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
LAST_STAMP = 2**63 - 1
"""Largest stamp [ns since 1970] of ROS's 64-bit time, in the year 2262."""


class Message(NamedTuple):
    """A message with topic number, sequence number, receive time and publish time [ns]."""

    topic: int
    sequence: int
    stamp: int
    published: int
    data: bytes


class LimitedReader:
    """A rosbags reader whose limits are set before it is opened."""

    def __init__(self) -> None:
        self.limits = DEFAULT_LIMITS
        self.connections: list[Connection] = []
        self.metadata = summary_of((), None)


def connection(
    owner: ReaderProtocol,
    topic: StoredTopic,
    count: int,
) -> Connection:
    """Return a topic of a file, with its number of messages, in the form of rosbags."""
    kind = _FORMATS.get(topic.definition_format, MessageDefinitionFormat.NONE)
    known = kind is not MessageDefinitionFormat.NONE
    definition = MessageDefinition(kind, topic.definition if known else '')
    extension = ConnectionExtRosbag2(topic.serialization, parse_profiles(topic.profiles))
    return Connection(
        topic.number,
        topic.name,
        topic.type_name,
        definition,
        topic.digest,
        count,
        extension,
        owner,
    )


def parse_profiles(profiles: str | Sequence[Any]) -> list[Qos]:
    """Return offered QoS profiles from YAML text or its value; empty if they are invalid."""
    try:
        values: Any = profiles_in(profiles) if isinstance(profiles, str) else list(profiles)
        return parse_qos(values)
    except (KeyError, TypeError, ValueError, AttributeError):
        return []


def summary_of(
    connections: Sequence[Connection],
    span: tuple[int, int] | None,
    compression: tuple[str | None, str | None] = (None, None),
    distribution: str | None = None,
    custom: dict[str, str] | None = None,
) -> ReaderMetadata:
    """Return the metadata of a bag from its topics and its first and last stamp [ns]."""
    start, end = span or (LAST_STAMP, LAST_STAMP)
    count = sum(each.msgcount for each in connections)
    return ReaderMetadata(
        end - start + 1 if span else 0,
        start,
        end + 1 if span else 0,
        count if span else 0,
        *compression,
        distribution,
        custom,
    )


class RecoveredFile(ABC):
    """A possibly damaged file of a bag, of which all intact messages are read.

    `topics` are keyed by their number in the file. `damage` describes each damaged part in a
    line. `lost` counts messages that are known to be in the file and cannot be read,
    `unverified` those read without a checksum. All are complete after the last message.
    `stated` is the number of messages that the file states, 0 if it states none.
    `records` holds opcodes and contents of MCAP records that are copied uninterpreted.
    """

    def __init__(
        self, path: Path, doubtful: bool = False, limits: BagLimits = DEFAULT_LIMITS
    ) -> None:
        """Scan the file; `doubtful` keeps messages with wrong checksums.

        Data beyond the limits is left out and reported as damage.
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
        """Yield topic and content of each intact message."""
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
            self.report_damage(
                f'{timeless} messages have stamps before 1970 or after 2262, unlike MCAP',
                timeless,
            )
        self._conclude()

    def report_damage(self, damage: str, lost: int = 0) -> None:
        """Note a damaged part and the number of messages lost in it."""
        self.damage.append(damage)
        self.lost += lost

    @abstractmethod
    def _scan(self, path: Path) -> None:
        """Fill `topics` and `custom_data`."""

    @abstractmethod
    def _messages(self) -> Iterator[Message]:
        """Yield the intact messages."""

    @abstractmethod
    def _conclude(self) -> None:
        """Report damage that is known only after all messages were read."""
