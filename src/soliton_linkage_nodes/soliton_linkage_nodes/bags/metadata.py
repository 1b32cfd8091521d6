# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of metadata.yaml in version 9, the version of rosbag2 in ROS 2 Jazzy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import yaml

from soliton_linkage_nodes.bags import guards
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, profiles_in

MCAP: Final = 'mcap'
SUFFIXES: Final = {MCAP: '.mcap', 'sqlite3': '.db3'}
"""File suffix for each storage format of rosbag2."""
METADATA_VERSION: Final = 9
"""Version of metadata.yaml in the rosbag2 of Jazzy. Older versions have fewer fields."""
METADATA_FILE: Final = 'metadata.yaml'
_KEY: Final = 'rosbag2_bagfile_information'
GAPS: Final = 'gaps'
"""Key in the custom data under which the intervals without recording are listed."""
_WIDTH: Final = guards.MAX_TEXT_SIZE
"""Line width of metadata.yaml [characters]. It is so large that no text is divided into lines."""


@dataclass(frozen=True)
class StoredFile:
    """File of a bag: name, number of messages, first and last receive time [ns]."""

    name: str
    messages: int
    start: int
    end: int


def storage_of(path: Path) -> str | None:
    """Return the storage format of a file, also of a compressed one; None if it is unknown."""
    plain = Path(path.stem) if path.suffix == guards.PACKED else path
    return next((name for name, suffix in SUFFIXES.items() if suffix == plain.suffix), None)


def explain_no_bag(path: Path) -> str:
    """Return '' if a path is a bag of rosbag2. Otherwise return the error message."""
    bag = f'bag {str(path)!r}'
    if not path.exists():
        return f'{bag} does not exist; give the path of a bag directory'
    if path.suffix == '.bag' and path.is_file():
        new = path.with_suffix('')
        return (
            f'{bag} is a bag of ROS 1; convert it with: '
            f'rosbags-convert --src {path} --dst {new}, from the Python package rosbags'
        )
    files = list(path.iterdir()) if path.is_dir() else [path]
    if not any(file.name == METADATA_FILE or storage_of(file) for file in files):
        why = '' if files else ', the directory is empty'
        suffixes = ' or '.join(SUFFIXES.values())
        return f'{bag} has no {suffixes} file{why}; give a bag directory'
    return ''


@lru_cache(maxsize=1)
def suite_version() -> str:
    """Return the version of this suite."""
    return version('soliton_linkage_nodes')


def bag_information(
    topics: Mapping[StoredTopic, int], files: Sequence[StoredFile], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return the content of metadata.yaml for an MCAP bag.

    `topics` maps the topics to their numbers of messages.
    """
    filled = [file for file in files if file.messages] or list(files)
    start = min(file.start for file in filled)
    listed: dict[tuple[str, str, str], tuple[StoredTopic, int]] = {}
    for topic, count in topics.items():
        # List channels with the same topic name, type and encoding as one topic, as rosbag2 does.
        key = (topic.name, topic.type_name, topic.serialization)
        first, counted = listed.get(key, (topic, 0))
        listed[key] = (first, counted + count)
    return {
        'version': METADATA_VERSION,
        'storage_identifier': MCAP,
        'duration': {'nanoseconds': max(file.end for file in filled) - start},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(file.messages for file in files),
        'topics_with_message_count': [
            {'topic_metadata': _topic_metadata(topic), 'message_count': count}
            for topic, count in listed.values()
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name for file in files],
        'files': [
            {
                'path': file.name,
                'starting_time': {'nanoseconds_since_epoch': file.start},
                'duration': {'nanoseconds': file.end - file.start},
                'message_count': file.messages,
            }
            for file in files
        ],
        'custom_data': dict(custom_data) or None,
        'ros_distro': 'jazzy',
    }


def as_text(information: Mapping[str, Any]) -> str:
    """Return the metadata as YAML text. Each file of a bag also contains this text."""
    return str(
        yaml.dump(information, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
    )


def write_metadata(folder: Path, information: Mapping[str, Any]) -> None:
    """Write metadata.yaml in one step, so that no reader finds an incomplete file."""
    unfinished = folder / f'{METADATA_FILE}.unfinished'
    unfinished.write_text(as_text({_KEY: information}), encoding='utf-8')
    unfinished.replace(folder / METADATA_FILE)


def load_metadata(folder: Path) -> dict[str, Any]:
    """Return the content of metadata.yaml. Raises ValueError if the content is invalid."""
    content = guards.read_file(folder / METADATA_FILE, folder, guards.MAX_TEXT_SIZE)
    loaded = guards.load_yaml(content.decode())
    information = loaded.get(_KEY) if isinstance(loaded, dict) else None
    if not isinstance(information, dict):
        raise ValueError(f'it has no mapping {_KEY}')
    return information


def read_metadata(folder: Path) -> dict[str, Any] | None:
    """Return the content of metadata.yaml, or None if the file is missing or invalid."""
    try:
        return load_metadata(folder)
    except (OSError, ValueError):
        return None


def custom_data_of(metadata: str) -> dict[str, str]:
    """Return the custom data in the YAML text of metadata; {} if the text is invalid."""
    try:
        return custom_data_in(guards.load_yaml(metadata))
    except ValueError:
        return {}


def custom_data_in(information: object) -> dict[str, str]:
    """Return the custom data in parsed metadata. Numbers are converted to texts."""
    custom = information.get('custom_data') if isinstance(information, dict) else None
    items = custom.items() if isinstance(custom, dict) else ()
    return {str(key): str(value) for key, value in items if isinstance(value, (str, int, float))}


def gaps_in(custom_data: Mapping[str, str]) -> list[tuple[int, int]]:
    """Return start and end of each interval without recording [ns]; [] if the data is invalid."""
    try:
        gaps = guards.load_json(custom_data.get(GAPS, '[]'))
        return [(guards.parse_count(start), guards.parse_count(end)) for start, end in gaps]
    except (TypeError, ValueError):
        return []


def time_in_gaps(gaps: Sequence[tuple[int, int]], start: int, end: int) -> int:
    """Return the total duration of the gaps between `start` and `end` [ns]."""
    found = sum(max(0, min(end, last) - max(start, first)) for first, last in gaps)
    return max(0, min(found, end - start))


def _topic_metadata(topic: StoredTopic) -> dict[str, Any]:
    return {
        'name': topic.name,
        'type': topic.type_name,
        'serialization_format': topic.serialization,
        'offered_qos_profiles': profiles_in(topic.profiles),
        'type_description_hash': topic.digest,
    }


class _Dumper(getattr(yaml, 'CSafeDumper', yaml.SafeDumper)):  # type: ignore[misc]
    """Dumper that, like rosbag2, repeats equal parts instead of writing aliases."""

    def ignore_aliases(self, data: object) -> bool:
        return True
