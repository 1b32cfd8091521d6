# SPDX-License-Identifier: Apache-2.0
"""What a bag keeps of a topic, and how rosbag2 spells it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from soliton_linkage_nodes.bags.guards import load_yaml

_LONGEST_NAME = 255
"""Characters of the longest name that ROS and file systems know."""
_UNLIMITED = {'sec': 2147483647, 'nsec': 4294967295}
"""A duration without end as rosbag2 writes it: the largest of its 32-bit numbers."""


_TYPE_NAME = re.compile(r'\w+/\w+/\w+')
_HALVES = re.compile(r'^---[ \t]*$', re.MULTILINE)
_PROFILE_KEYS = {
    'history',
    'depth',
    'reliability',
    'durability',
    'deadline',
    'lifespan',
    'liveliness',
    'liveliness_lease_duration',
    'avoid_ros_namespace_conventions',
}


@dataclass(frozen=True)
class StoredTopic:
    """A topic of a bag; numbers count from 1, in the order in which topics were added.

    Its type is told by name, by the text of the definition in a format such as 'ros2msg', and by
    the hash (digest) of that. Profiles are the offered qualities of service, as rosbag2 writes
    them; an empty text stands for what is not known.
    """

    number: int
    name: str
    type_name: str
    definition: str
    definition_format: str
    digest: str
    profiles: str
    serialization: str = 'cdr'


def type_definition(name: str) -> tuple[str, str]:
    """Definition of a message type with all that it is made of, and its hash.

    Raises ValueError where its package is not installed.
    """
    definition, digest, complaint = _installed(name)
    if complaint:
        raise ValueError(complaint)
    return definition, digest


@lru_cache(maxsize=1024)
def service_definitions(name: str) -> tuple[str, str]:
    """Definitions of request and response of a service type, with all that they are made of.

    Raises ValueError where its package is not installed.
    """
    try:
        if not _TYPE_NAME.fullmatch(name):
            raise ValueError('its name is none of a type')
        package, kind, short = name.split('/')
        path = Path(get_package_share_directory(package), kind, f'{short}.srv')
        parts = _HALVES.split(path.read_text(encoding='utf-8'), maxsplit=1)
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
    """Definition and hash of a type, and why there is none: a bag may ask a thousand times."""
    store = _typestore()
    try:
        if not _TYPE_NAME.fullmatch(name):
            raise ValueError('its name is none of a type')
        if name not in store.fielddefs:
            _learn(store, name)
        definition, _ = store.generate_msgdef(name, ros_version=2)
        return definition, store.hash_rihs01(name), ''
    except (PackageNotFoundError, OSError, TypesysError, KeyError, ValueError) as error:
        return '', '', _not_installed('message', name, error)


def _not_installed(kind: str, name: str, error: Exception) -> str:
    package = name.partition('/')[0][:_LONGEST_NAME]
    return (
        f'{kind} type {name[:_LONGEST_NAME]!r} has no definition on this machine: '
        f'{str(error)[:_LONGEST_NAME]}; install its package {package!r}'
    )


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


def profiles_text(profiles: Sequence[QoSProfile]) -> str:
    """Qualities of service as rosbag2 writes them."""
    if not profiles:
        return ''
    return str(yaml.safe_dump([_profile(p) for p in profiles], sort_keys=False)).strip()


@lru_cache(maxsize=1024)
def profiles_in(text: str) -> list[dict[str, Any]]:
    """Qualities of service of a text as rosbag2 writes it; none where it is of another form."""
    try:
        loaded = load_yaml(text)
    except ValueError:
        return []
    told = loaded if isinstance(loaded, list) else []
    sound = all(isinstance(each, dict) and not _PROFILE_KEYS - each.keys() for each in told)
    return told if sound else []


@lru_cache(maxsize=1)
def _typestore() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def _learn(store: Typestore, name: str) -> None:
    """Register a type that Jazzy itself does not have, and the types that it is made of."""
    package, kind, short = name.split('/')
    path = Path(get_package_share_directory(package), kind, f'{short}.msg')
    _register(store, name, path.read_text(encoding='utf-8'))


def _register(store: Typestore, name: str, text: str) -> None:
    """Register a type of a definition, and the types that it is made of."""
    types: dict[str, Any] = get_types_from_msg(text, name)
    store.register({key: value for key, value in types.items() if key not in store.fielddefs})
    for _, fields in types.values():
        for _, field in fields:
            for part in _parts(field):
                if part not in store.fielddefs:
                    _learn(store, part)


def _parts(field: Any) -> list[str]:
    """Names of the message types in a field's description, which nests for arrays."""
    kind, inner = field
    if kind.name == 'NAME':
        return [inner]
    if kind.name in ('ARRAY', 'SEQUENCE'):
        return _parts(inner[0])
    return []


def _profile(qos: QoSProfile) -> dict[str, Any]:
    histories = {HistoryPolicy.KEEP_ALL: 'keep_all', HistoryPolicy.UNKNOWN: 'unknown'}
    reliable = qos.reliability == ReliabilityPolicy.RELIABLE
    transient = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    by_topic = qos.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return {
        'history': histories.get(qos.history, 'keep_last'),
        'depth': qos.depth,
        'reliability': 'reliable' if reliable else 'best_effort',
        'durability': 'transient_local' if transient else 'volatile',
        'deadline': dict(_UNLIMITED),
        'lifespan': dict(_UNLIMITED),
        'liveliness': 'manual_by_topic' if by_topic else 'automatic',
        'liveliness_lease_duration': dict(_UNLIMITED),
        'avoid_ros_namespace_conventions': False,
    }
