# SPDX-License-Identifier: Apache-2.0
"""What readers of bag files share, and a damaged file, of which as much as possible is read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
"""Of the 64-bit number that ROS keeps time in [ns since 1970], in the year 2262."""


class LimitedReader:
    """A reader of rosbags' form that is told what its file may ask for, before it is opened."""

    def __init__(self, limits: BagLimits = DEFAULT_LIMITS) -> None:
        """Begin with nothing."""
        self.limits = limits
        self.connections: list[Connection] = []
        self.metadata = summary_of((), None)


def connection(
    owner: ReaderProtocol,
    number: int,
    name: str,
    type_name: str,
    definition: tuple[str, str],
    digest: str,
    *,
    count: int,
    serialization: str,
    profiles: str | Sequence[Any],
) -> Connection:
    """Return a topic of a file; its definition is the encoding and the text."""
    encoding, text = definition
    kind = _FORMATS.get(encoding, MessageDefinitionFormat.NONE)
    told = MessageDefinition(kind, text if kind is not MessageDefinitionFormat.NONE else '')
    extension = ConnectionExtRosbag2(serialization, qualities(profiles))
    return Connection(number, name, type_name, told, digest, count, extension, owner)


def qualities(profiles: str | Sequence[Any]) -> list[Qos]:
    """Offered qualities of service, none where what is told of them has another form."""
    try:
        told: Any = profiles_in(profiles) if isinstance(profiles, str) else list(profiles)
        return parse_qos(told)
    except (KeyError, TypeError, ValueError, AttributeError):
        return []


def summary_of(
    connections: Sequence[Connection],
    span: tuple[int, int] | None,
    compression: tuple[str | None, str | None] = (None, None),
    distribution: str | None = None,
    custom: dict[str, str] | None = None,
) -> ReaderMetadata:
    """What a bag says of itself, from its topics and the stamps of its first and last message."""
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
