# SPDX-License-Identifier: Apache-2.0
"""Description of a topic in a bag, in the notation of rosbag2."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.qos import LivelinessPolicy, QoSProfile
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from soliton_linkage_nodes.bags.guards import load_yaml

CDR = 'cdr'
"""Encoding of ROS 2 messages. Messages in other encodings can be copied but not decoded."""
_LONGEST_NAME = 255
"""Length to which texts in errors are cut [characters], the limit of names in file systems."""
_UNLIMITED = {'sec': 2147483647, 'nsec': 4294967295}
"""Infinite duration in the notation of rosbag2."""
_LATCHED = ('transient_local', '1')
"""Durability of a latched topic in metadata.yaml of version 9 and in earlier versions."""
_UNKNOWN_DEPTH = 10
"""Assumed queue depth of a latched topic if the bag does not state it [messages]."""
_TYPE_NAME = re.compile(r'\w+/\w+/\w+')
_SERVICE_SEPARATOR = re.compile(r'^---[ \t]*$', re.MULTILINE)


@dataclass(frozen=True)
class StoredTopic:
    """Topic of a bag. Unknown texts are ''.

    `number` is the number of the topic in its file or bag, beginning at 1. `definition` is the
    message definition in the format `definition_format`, for example 'ros2msg'. Both are '' for an
    MCAP channel without a schema. Surrogates replace the bytes of the definition that are not
    valid UTF-8. `digest` is the RIHS01 hash of the type. `profiles` are the QoS profiles of the
    publishers in YAML. `about` contains other metadata of an MCAP channel.
    """

    number: int
    name: str
    type_name: str
    definition: str
    definition_format: str
    digest: str
    profiles: str
    serialization: str = CDR
    about: tuple[tuple[str, str], ...] = ()

    @property
    def key(self) -> tuple[str, str, str]:
        """Name, type and encoding. Channels with the same key are one topic, as in ROS."""
        return self.name, self.type_name, self.serialization

    @property
    def latched_depth(self) -> int:
        """Number of messages that the publishers stored for late subscribers, or 0."""
        profiles = [p for p in profiles_in(self.profiles) if str(p['durability']) in _LATCHED]
        depths = [p['depth'] for p in profiles if isinstance(p['depth'], int)]
        return max((depth if depth > 0 else _UNKNOWN_DEPTH for depth in depths), default=0)

    @property
    def type_is_lost(self) -> bool:
        """Whether the name of the message type is unknown, although the topic has a type.

        For example, its channel in a damaged MCAP file refers to a schema that is lost.
        """
        return not self.type_name and bool(self.definition_format)


def type_definition(name: str) -> tuple[str, str]:
    """Return the definition of a message type, with all nested types, and the hash of the type.

    Raises ValueError if the type is not installed.
    """
    definition, digest, complaint = _installed(name)
    if complaint:
        raise ValueError(complaint)
    return definition, digest


@lru_cache(maxsize=1024)
def service_definitions(name: str) -> tuple[str, str]:
    """Return the definitions of the request and of the response of a service.

    Raises ValueError if the service type is not installed.
    """
    try:
        package, kind, short = _name_parts(name)
        path = Path(get_package_share_directory(package), kind, f'{short}.srv')
        parts = _SERVICE_SEPARATOR.split(path.read_text(encoding='utf-8'), maxsplit=1)
        request, response = (
            _definition_of(f'{package}/msg/{short}_{half}', text)
            for half, text in zip(('Request', 'Response'), parts, strict=True)
        )
    except (PackageNotFoundError, OSError, TypesysError, KeyError, ValueError) as error:
        raise ValueError(_not_installed('service', name, error)) from error
    return request, response


def _definition_of(name: str, text: str) -> str:
    store = _typestore()
    if name not in store.fielddefs:
        _register(store, name, text)
    definition: str = store.generate_msgdef(name, ros_version=2)[0]
    return definition


@lru_cache(maxsize=1024)
def _installed(name: str) -> tuple[str, str, str]:
    store = _typestore()
    try:
        _name_parts(name)
        if name not in store.fielddefs:
            _register_installed(store, name)
        definition, _ = store.generate_msgdef(name, ros_version=2)
        return definition, store.hash_rihs01(name), ''
    except (PackageNotFoundError, OSError, TypesysError, KeyError, ValueError) as error:
        return '', '', _not_installed('message', name, error)


def _name_parts(name: str) -> list[str]:
    if not _TYPE_NAME.fullmatch(name):
        raise ValueError('the name is not PACKAGE/KIND/TYPE')
    return name.split('/')


def _not_installed(kind: str, name: str, error: Exception) -> str:
    package = name.partition('/')[0][:_LONGEST_NAME]
    return (
        f'{kind} type {name[:_LONGEST_NAME]!r} has no definition on this machine: '
        f'{str(error)[:_LONGEST_NAME]}; install its package {package!r}'
    )


def completed(topic: StoredTopic) -> StoredTopic:
    """Return a topic. If its encoding is CDR, add a missing definition or hash of its type."""
    if topic.serialization != CDR or (topic.definition and topic.digest):
        return topic
    known, digest, _ = _installed(topic.type_name)
    return replace(
        topic,
        definition=topic.definition or known,
        digest=topic.digest or digest,
        definition_format=topic.definition_format or ('ros2msg' if known else ''),
    )


def profiles_text(profiles: Sequence[QoSProfile]) -> str:
    """Return QoS profiles as YAML text in the notation of rosbag2."""
    if not profiles:
        return ''
    return str(yaml.safe_dump([_profile(p) for p in profiles], sort_keys=False)).strip()


@lru_cache(maxsize=1024)
def profiles_in(text: str) -> list[dict[str, Any]]:
    """Return the QoS profiles in a YAML text of rosbag2; [] if the text is invalid."""
    try:
        loaded = load_yaml(text)
    except ValueError:
        return []
    profiles = loaded if isinstance(loaded, list) else []
    keys = _profile(QoSProfile(depth=1)).keys()
    valid = all(isinstance(each, dict) and not keys - each.keys() for each in profiles)
    return profiles if valid else []


@lru_cache(maxsize=1)
def _typestore() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def _register_installed(store: Typestore, name: str) -> None:
    package, kind, short = name.split('/')
    path = Path(get_package_share_directory(package), kind, f'{short}.msg')
    _register(store, name, path.read_text(encoding='utf-8'))


def _register(store: Typestore, name: str, text: str) -> None:
    types: dict[str, Any] = get_types_from_msg(text, name)
    store.register({key: value for key, value in types.items() if key not in store.fielddefs})
    for _, fields in types.values():
        for _, field in fields:
            for part in _nested_types(field):
                if part not in store.fielddefs:
                    _register_installed(store, part)


def _nested_types(field: Any) -> list[str]:
    kind, inner = field
    if kind.name == 'NAME':
        return [inner]
    return _nested_types(inner[0]) if kind.name in ('ARRAY', 'SEQUENCE') else []


def _profile(qos: QoSProfile) -> dict[str, Any]:
    by_topic = qos.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return {
        'history': qos.history.short_key,
        'depth': qos.depth,
        'reliability': qos.reliability.short_key,
        'durability': qos.durability.short_key,
        'deadline': dict(_UNLIMITED),
        'lifespan': dict(_UNLIMITED),
        'liveliness': 'manual_by_topic' if by_topic else 'automatic',
        'liveliness_lease_duration': dict(_UNLIMITED),
        'avoid_ros_namespace_conventions': False,
    }
