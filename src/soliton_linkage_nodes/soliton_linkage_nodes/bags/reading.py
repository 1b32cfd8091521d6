# SPDX-License-Identifier: Apache-2.0
"""Reading of the topics and messages of bags. rosbag2 need not be installed."""

from __future__ import annotations

import importlib
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from soliton_linkage_nodes.bags.bag_files import BagReader, one_line
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS, BagLimits
from soliton_linkage_nodes.bags.metadata import METADATA_FILE, SUFFIXES, explain_no_bag
from soliton_linkage_nodes.bags.stored_topic import CDR, StoredTopic, type_definition


def open_bag(path: Path, limits: BagLimits = DEFAULT_LIMITS) -> closing[BagReader]:
    """Return a context manager with the reader of a bag.

    Raises ValueError if the bag does not exist or cannot be read.
    """
    if complaint := explain_no_bag(path):
        raise ValueError(complaint)
    if path.is_dir() and not (path / METADATA_FILE).exists():
        raise ValueError(
            f'bag {str(path)!r} cannot be read: it has no {METADATA_FILE}. Either its recorder '
            f'still runs, or it was killed; then recover it with: recover_bag {path}'
        )
    try:
        reader = BagReader(path, limits)
    except Exception as error:  # sqlite3 and the decompressors raise many types of errors
        raise ValueError(
            f'bag {str(path)!r} cannot be read: {one_line(error).rstrip(".")}. '
            f'Give a directory with metadata.yaml and an {" or ".join(SUFFIXES.values())} file; '
            f'if the bag is damaged, try recover_bag {path}'
        ) from error
    return closing(reader)


def latched_before(reader: BagReader, topic: StoredTopic, stop: int) -> list[bytes]:
    """Return the messages that a subscriber of a latched topic receives if it starts at `stop`.

    `stop` is a receive time in the bag [ns].
    """
    earlier = reader.messages([topic], None, stop)
    return list(deque((data for _, _, data in earlier), maxlen=topic.latched_depth))


_RECORD = 'record it with bag_recorder'


def find_topic(reader: BagReader, name: str, remedy: str = _RECORD) -> StoredTopic:
    """Return the topic `name`. Without such a topic, compare only the names after the last '/'.

    Raises ValueError if no topic or several topics match, or if the topic has several types or is
    not encoded in CDR. The error about a missing topic ends with `remedy`.
    """
    found = types_of_topic(reader, name, remedy)
    bag = f'bag {str(reader.path)!r}'
    decodable = [each for each in found if each.serialization == CDR]
    if not decodable:
        raise ValueError(f'{bag}: {_other_encoding(found[0])}; {remedy}')
    if len(decodable) > 1:
        raise ValueError(
            f'{bag} has topic {found[0].name} with {len(decodable)} types: '
            f'{", ".join(each.type_name for each in decodable)}; only one can be read'
        )
    return decodable[0]


def types_of_topic(reader: BagReader, name: str, remedy: str = _RECORD) -> list[StoredTopic]:
    """Return one entry per type and encoding of a topic. `find_topic` describes the search."""
    wanted = name.rpartition('/')[2]
    found = [each for each in reader.topics if each.name == name] or [
        each for each in reader.topics if each.name.rpartition('/')[2] == wanted
    ]
    if not found:
        held = ', '.join(sorted({each.name for each in reader.topics})) or 'no topics'
        raise ValueError(
            f'bag {str(reader.path)!r} has no topic {wanted!r}, it contains {held}; {remedy}'
        )
    names = sorted({each.name for each in found})
    if len(names) > 1:
        raise ValueError(
            f'bag {str(reader.path)!r} has {len(names)} topics {wanted!r}: {", ".join(names)}; '
            'give the full name of one'
        )
    return found


def read_topic(reader: BagReader, name: str, remedy: str = _RECORD) -> Iterator[tuple[int, Any]]:
    """Yield receive time [ns] and content of the messages on the topic that `find_topic` finds."""
    topic = find_topic(reader, name, remedy)
    decode = decoder(topic)
    for _, stamp, serialized in reader.messages([topic]):
        yield stamp, decode(serialized)


def decoder(topic: StoredTopic) -> Callable[[bytes], Any]:
    """Return a function that decodes the serialized messages of a topic.

    If the messages were recorded with another definition of their type, the function copies the
    fields that have equal names in the installed type. It raises ValueError if a message is
    damaged. `decoder` itself raises ValueError if the type is not installed or the encoding is not
    CDR.
    """
    message_type = class_of(topic)
    if is_older(topic):
        return _older_decoder(topic, message_type)

    def decode(serialized: bytes) -> Any:
        try:
            return deserialize_message(serialized, message_type)
        except Exception as error:  # a private error type of rclpy
            raise ValueError(f'a message on {topic.name} is damaged: {one_line(error)}') from error

    return decode


def class_of(topic: StoredTopic) -> Any:
    """Return the message class of a topic.

    Raises ValueError if the class is not installed or the encoding is not CDR.
    """
    if topic.serialization != CDR:
        raise ValueError(_other_encoding(topic))
    return message_class(topic.type_name)


def _other_encoding(topic: StoredTopic) -> str:
    return f'{topic.name} has the encoding {topic.serialization!r}; only cdr is decoded'


_KINDS = ('msg', 'srv', 'action')


def message_class(type_name: str) -> Any:
    """Return the class of a message type, for example 'sensor_msgs/msg/JointState'.

    Raises ValueError if the type is not installed.
    """
    try:
        package, kind, name = type_name.split('/')
    except ValueError:
        package = kind = name = ''
    if kind not in _KINDS:
        raise ValueError(f'message type {type_name!r} is not PACKAGE/KIND/TYPE as in ROS 2')
    if not _has_types(package, kind):
        raise ValueError(
            f'message type {type_name!r} is not installed; install its package {package!r}'
        )
    try:
        return getattr(importlib.import_module(f'{package}.{kind}'), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f'message type {type_name!r} is not in the installed package {package!r}; '
            'install the version of the package that the bag was recorded with'
        ) from error


def _has_types(package: str, kind: str) -> bool:
    """Return whether a package contains types of a kind: 'msg', 'srv' or 'action'.

    The package is not imported, because an untrusted bag may name any package.
    """
    if f'{package}.{kind}' in sys.modules:
        return True
    found = PathFinder.find_spec(package) if package.isidentifier() else None
    folders = (found.submodule_search_locations or []) if found else []
    return any(Path(folder, kind, '__init__.py').is_file() for folder in folders)


def type_name(message_type: Any) -> str:
    """Return the type name of a message class, for example 'sensor_msgs/msg/JointState'."""
    return f'{message_type.__module__.partition(".")[0]}/msg/{message_type.__name__}'


_LONGER, _MARGIN = 4, 4096
"""The largest accepted length of a recorded definition [characters] is `_LONGER` [1] times the
length of the installed definition plus `_MARGIN` [characters]."""
_LONGEST_REASON = 200
"""Length to which error texts are cut [characters]. They may quote the whole input."""


def is_older(topic: StoredTopic) -> bool:
    """Return whether the recorded definition of a topic differs from the installed definition."""
    if not topic.digest or topic.definition_format != 'ros2msg':
        return False
    try:
        return type_definition(topic.type_name)[1] != topic.digest
    except ValueError:
        return False


def _older_decoder(topic: StoredTopic, message_type: Any) -> Callable[[bytes], Any]:
    name, text = topic.type_name, topic.definition
    store = get_typestore(Stores.EMPTY)
    try:
        longest = _LONGER * len(type_definition(name)[0]) + _MARGIN
        if len(text) > longest:
            raise ValueError(f'it has {len(text)} characters; the limit is {longest}')
        store.register(get_types_from_msg(text, name))
    except Exception as error:  # the parser raises many types of errors
        raise ValueError(
            f'the recorded definition of {topic.name} is not a valid {name!r}: '
            f'{one_line(error)[:_LONGEST_REASON]}'
        ) from error

    def decode(serialized: bytes) -> Any:
        try:
            return _converted(message_type, store.deserialize_cdr(serialized, name))
        except Exception as error:  # the decoder raises many types of errors
            raise ValueError(
                f'a message of type {name!r} does not fit its recorded definition: '
                f'{one_line(error)[:_LONGEST_REASON]}'
            ) from error

    return decode


def _converted(message_type: Any, recorded: Any) -> Any:
    message = message_type()
    kinds = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
    for name, kind in kinds:
        if hasattr(recorded, name):
            setattr(message, name, _value(kind, getattr(recorded, name)))
    return message


def _value(kind: Any, recorded: Any) -> Any:
    element = getattr(kind, 'value_type', None)
    if element is not None and hasattr(element, 'namespaces'):
        return [_converted(_class_of(element), one) for one in recorded]
    if hasattr(kind, 'namespaces'):
        return _converted(_class_of(kind), recorded)
    return recorded.tolist() if hasattr(recorded, 'tolist') else recorded


def _class_of(kind: Any) -> Any:
    return getattr(importlib.import_module('.'.join(kind.namespaces)), kind.name)
