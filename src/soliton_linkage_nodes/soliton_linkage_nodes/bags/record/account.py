# SPDX-License-Identifier: Apache-2.0
"""What a bag says of its own recording: losses, the chain, the version and the command line."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from soliton_linkage_nodes.bags.metadata import suite_version
from soliton_linkage_nodes.bags.read.reading import type_name
from soliton_linkage_nodes.bags.record.writing_thread import Taken
from soliton_linkage_nodes.runtime import interfaces

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
