# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of a bag, version 9, as Jazzy's rosbag2 writes and reads it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from textwrap import indent
from typing import Any, Final

import yaml

from soliton_linkage_nodes.bags.guards import LARGEST_TEXT, load_yaml, read_file
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, profiles_in

MCAP: Final = 'mcap'
SUFFIXES: Final = {MCAP: '.mcap', 'sqlite3': '.db3'}
"""Suffixes of files by the names that rosbag2 gives to storages; bags are written as MCAP."""
METADATA_VERSION: Final = 9
"""Of the layout that Jazzy's rosbag2 writes; older ones lack fields that we fill."""
METADATA_FILE: Final = 'metadata.yaml'
_KEY: Final = 'rosbag2_bagfile_information'
_TOPICS: Final = 'topics_with_message_count'
_DUMPER: Any = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


@dataclass(frozen=True)
class StoredFile:
    """A file of a bag: how many messages it holds, and when the first and the last came [ns]."""

    name: str
    messages: int
    start: int
    end: int


def storage_of(path: Path) -> str | None:
    """Return the name of the storage of a file, by its suffix; None if it is no file of a bag."""
    return next((name for name, suffix in SUFFIXES.items() if suffix == path.suffix), None)


@lru_cache(maxsize=1)
def suite_version() -> str:
    """Version of the suite that writes a bag."""
    return version('soliton_linkage_nodes')


def bag_information(
    storage: str,
    topics: Mapping[StoredTopic, int],
    files: Sequence[StoredFile],
    custom_data: Mapping[str, str],
) -> dict[str, Any]:
    """What a bag of some topics, each with so many messages, says about itself."""
    filled = [file for file in files if file.messages] or list(files)
    start = min(file.start for file in filled)
    return {
        'version': METADATA_VERSION,
        'storage_identifier': storage,
        'duration': {'nanoseconds': max(file.end for file in filled) - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(file.messages for file in files),
        _TOPICS: topics,
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [_file(file) for file in files],
        'custom_data': dict(custom_data) or None,
        'ros_distro': 'jazzy',
    }


def as_text(information: Mapping[str, Any]) -> str:
    """What a bag says about itself as the text that its files hold."""
    return ''.join(_pieces(information, ''))


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write metadata.yaml, whole or not at all."""
    text = ''.join([f'{_KEY}:\n', *_pieces(information, '  ')])
    unfinished = folder / f'{METADATA_FILE}.unfinished'
    unfinished.write_text(text, encoding='utf-8')
    unfinished.replace(folder / METADATA_FILE)


def load_metadata(folder: Path) -> dict[str, Any]:
    """What metadata.yaml says about a bag; ValueError or OSError where that cannot be read."""
    content = read_file(folder / METADATA_FILE, folder, LARGEST_TEXT)
    loaded = load_yaml(content.decode())
    information = loaded.get(_KEY) if isinstance(loaded, dict) else None
    if not isinstance(information, dict):
        raise ValueError(f'it has no mapping {_KEY}')
    return information


def read_metadata(folder: Path) -> dict[str, Any] | None:
    """What metadata.yaml says about a bag, None where there is none that can be read."""
    try:
        return load_metadata(folder)
    except (OSError, ValueError):
        return None


def custom_data_of(metadata: str) -> dict[str, str]:
    """Texts that are kept in what a file says about its bag, as far as they can be read."""
    try:
        loaded = load_yaml(metadata)
    except ValueError:
        return {}
    return custom_data_in(loaded)


def custom_data_in(information: object) -> dict[str, str]:
    """Texts that are kept in what was said about a bag; what is no text or number is left out."""
    custom = information.get('custom_data') if isinstance(information, dict) else None
    told = custom.items() if isinstance(custom, dict) else ()
    return {str(key): str(value) for key, value in told if isinstance(value, (str, int, float))}


def _pieces(information: Mapping[str, Any], margin: str) -> Iterator[str]:
    """Text of what is said, in block style; topics, of which there may be many, by themselves."""
    for key, value in information.items():
        if key == _TOPICS:
            yield f'{margin}{key}:\n' if value else f'{margin}{key}: []\n'
            for topic, count in value.items():
                yield _topic_text(topic, count, margin)
        else:
            yield indent(_dumped({key: value}), margin)


def _topic_text(topic: StoredTopic, count: int, margin: str) -> str:
    return (
        f'{margin}- topic_metadata:\n'
        f'{margin}    name: {_quoted(topic.name)}\n'
        f'{margin}    type: {_quoted(topic.type_name)}\n'
        f'{margin}    serialization_format: {_quoted(topic.serialization)}\n'
        f'{margin}    offered_qos_profiles:{_profiles_text(topic.profiles, margin)}'
        f'{margin}    type_description_hash: {_quoted(topic.digest)}\n'
        f'{margin}  message_count: {count}\n'
    )


@lru_cache(maxsize=1024)
def _profiles_text(profiles: str, margin: str) -> str:
    told = profiles_in(profiles)
    return '\n' + indent(_dumped(told), f'{margin}    ') if told else ' []\n'


def _quoted(text: str) -> str:
    if text.isascii() and text.isprintable():
        return json.dumps(text)
    return str(yaml.dump(text, Dumper=_DUMPER, default_style='"', width=LARGEST_TEXT)).strip()


def _dumped(value: object) -> str:
    return str(yaml.dump(value, Dumper=_DUMPER, sort_keys=False, allow_unicode=True))


def _file(file: StoredFile) -> dict[str, Any]:
    return {
        'path': file.name,
        'starting_time': {'nanoseconds_since_epoch': file.start},
        'duration': {'nanoseconds': file.end - file.start},
        'message_count': file.messages,
    }
