# SPDX-License-Identifier: Apache-2.0
"""Messages of a type whose definition has changed since they were recorded."""

from __future__ import annotations

import importlib
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_nodes.bags.stored_topic import type_definition

_LONGER, _MARGIN = 4, 4096
"""Times the length of the installed definition, and characters more, that a recorded one may
have: parsing takes a second for 40,000."""
_LONGEST_REASON = 200
"""Characters of what a parser says, which may repeat all that it was given."""


def is_older(connection: Connection) -> bool:
    """Whether a topic was recorded with another definition of its type than the installed one."""
    told = connection.digest and connection.msgdef.format is MessageDefinitionFormat.MSG
    if not told:
        return False
    try:
        return type_definition(connection.msgtype)[1] != connection.digest
    except ValueError:
        return False


class OlderMessages:
    """Reads messages by the definition that is in their bag, and fills installed ones by name.

    Fields that the recorded definition did not have keep their default.
    """

    def __init__(self, connection: Connection, message_type: Any) -> None:
        """Learn the recorded definition; ValueError where it is none."""
        self._name = connection.msgtype
        self._type = message_type
        self._store = get_typestore(Stores.EMPTY)
        text = connection.msgdef.data
        try:
            installed, _ = type_definition(self._name)
            longest = _LONGER * len(installed) + _MARGIN
            if len(text) > longest:
                raise ValueError(f'it has {len(text)} characters, more than {longest}')
            self._store.register(get_types_from_msg(text, self._name))
        except Exception as error:  # whatever a parser stumbles on
            raise ValueError(
                f'the definition that {connection.topic} was recorded with is none of '
                f'{self._name!r}: {" ".join(str(error).split())[:_LONGEST_REASON]}'
            ) from error

    def read(self, serialized: bytes) -> Any:
        """Message of the installed type; ValueError where it does not fit its definition."""
        try:
            recorded = self._store.deserialize_cdr(serialized, self._name)
            return _filled(self._type, recorded)
        except Exception as error:  # whatever a decoder stumbles on
            raise ValueError(
                f'a message of type {self._name!r} does not fit the definition that was recorded '
                f'with it: {" ".join(str(error).split())[:_LONGEST_REASON]}'
            ) from error


def _filled(message_type: Any, recorded: Any) -> Any:
    message = message_type()
    kinds = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
    for name, kind in kinds:
        if hasattr(recorded, name):
            setattr(message, name, _value(kind, getattr(recorded, name)))
    return message


def _value(kind: Any, recorded: Any) -> Any:
    element = getattr(kind, 'value_type', None)
    if element is not None and hasattr(element, 'namespaces'):
        return [_filled(_class_of(element), one) for one in recorded]
    if hasattr(kind, 'namespaces'):
        return _filled(_class_of(kind), recorded)
    return recorded.tolist() if hasattr(recorded, 'tolist') else recorded


def _class_of(kind: Any) -> Any:
    return getattr(importlib.import_module('.'.join(kind.namespaces)), kind.name)
