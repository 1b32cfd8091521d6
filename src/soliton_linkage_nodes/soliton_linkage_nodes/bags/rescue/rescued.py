# SPDX-License-Identifier: Apache-2.0
"""What can still be read of a file of a bag, and what cannot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

from soliton_linkage_nodes.bags.stored_topic import StoredTopic, type_definition

RescuedMessage = tuple[StoredTopic, int, bytes]


@dataclass
class Findings:
    """What was found out about a file: what is wrong with it, and how many messages that cost."""

    damage: list[str] = field(default_factory=list)
    messages: int = 0
    lost: int = 0
    """Messages that are known to be in the file and cannot be read."""


class RescuedFile(Protocol):
    """A file of a bag of which as much as possible is read."""

    findings: Findings
    topics: list[StoredTopic]
    custom_data: dict[str, str]

    def messages(self) -> Iterator[RescuedMessage]:
        """Yield the intact messages; `findings` is complete after the last."""


def completed(
    number: int,
    name: str,
    type_name: str,
    definition: tuple[str, str] | None,
    digest: str,
    profiles: str,
) -> StoredTopic:
    """A topic whose definition, if it was lost, is that of the installed type, or else empty.

    The definition given is its encoding and text.
    """
    encoding, text = definition or ('ros2msg', '')
    if not text or not digest:
        try:
            known, known_digest = type_definition(type_name)
        except ValueError:
            known, known_digest = '', ''
        text, digest = text or known, digest or known_digest
    return StoredTopic(number, name, type_name, text, encoding, digest, profiles)
