# SPDX-License-Identifier: Apache-2.0
"""Topics of a stored bag as rosbags describes them, with its quality of service, or none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2.metadata import ReaderMetadata, parse_qos

from soliton_linkage_nodes.bags.guards.limits import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.stored_topic import profiles_in

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
    count: int,
    serialization: str,
    profiles: str | Sequence[Any],
) -> Connection:
    """A topic; its definition is the encoding and the text, of which no other kind is told."""
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
