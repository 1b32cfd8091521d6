# SPDX-License-Identifier: Apache-2.0
"""Report the content and the damage of a bag, and the messages lost during recording.

The first lines have the layout of `ros2 bag info`. The program computes times and counts from the
messages themselves. Only the number of lost messages comes from the recorder, which stores it in
the bag.
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from soliton_linkage.command_line import PlainParser
from soliton_linkage_nodes.bags.guards import BagLimits, load_json, parse_count
from soliton_linkage_nodes.bags.metadata import gaps_in, time_in_gaps
from soliton_linkage_nodes.bags.recovery import BagReport, check_bag
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.runtime.stamps import SECOND

_DAMAGE = 'damage'
"""Key in a recovered bag's custom data; the value describes the damage of the original bag."""
_LABEL_WIDTH = 19
"""Width of the labels, as in `ros2 bag info` [characters]."""
_EVENTS = 'soliton_linkage_msgs/msg/SolitonEvent'
_SERVICE_EVENT, _SERVICE_SUFFIX = '_Event', '/_service_event'
_TopicRow = tuple[tuple[str, str, str], int, int]
"""(Name, type, encoding) of a topic, number of its messages, and number of its lost messages."""


def main() -> None:
    """Check a bag; exit with 1 if the bag is damaged or messages were lost."""
    parser = PlainParser(
        prog='check_bag',
        description=f'{__doc__} The exit code is 1 if the bag is damaged or messages were lost.',
    )
    parser.add_argument('bag', type=Path, help='directory of the bag, or one file of it')
    parser.add_argument('--json', action='store_true', help='print the report as JSON')
    command_line.add_fields(parser, BagLimits(), 'BYTES')
    options = parser.parse()
    progress, show = command_line.message_progress(f'checking {options.bag}')
    with command_line.exit_on_failure('check_bag'):
        report = check_bag(options.bag, show, command_line.fields_of(options, BagLimits))
    progress.clear()
    if options.json:
        print(json.dumps(_as_json(report), indent=2))
    else:
        for label, texts in _lines(report):
            indent = ' ' * max(_LABEL_WIDTH, len(label) + 1)
            print(f'{label:{len(indent)}}{f"{chr(10)}{indent}".join(texts)}'.rstrip())
    sys.exit(not _is_sound(report))


def _is_sound(report: BagReport) -> bool:
    lost = sum(_counts_in(report, 'lost_messages').values())
    return not (report.damage or _DAMAGE in report.custom_data or lost)


def _lines(report: BagReport) -> Iterator[tuple[str, list[str]]]:
    start = report.start or 0
    topics, services = _topics(report)
    yield 'Files:', [file.name for file in report.files]
    yield 'Bag size:', [_size(sum(file.stat().st_size for file in report.files))]
    yield 'Storage id:', [report.storage]
    yield 'ROS Distro:', [report.distribution or 'unknown']
    yield 'Duration:', [f'{_seconds(report.end - start if report.messages else 0)}s']
    yield 'Start:', [_moment(start)]
    yield 'End:', [_moment(report.end)]
    yield 'Messages:', [str(sum(count for _, count, _ in topics))]
    yield 'Topic information:', [_row('Topic', 'Count', each) for each in topics]
    yield 'Service:', [str(len(services))]
    yield 'Service information:', [_row('Service', 'Event Count', each) for each in services]
    paused = report.end - start - _recorded(report)
    if report.messages and paused:
        recorded = _seconds(_recorded(report))
        yield 'Recorded:', [f'{recorded}s, without {_seconds(paused)}s of pauses']
    yield 'Lost:', [_losses(report)]
    missed = _counts_in(report, 'missed_messages').items()
    if missed:
        yield 'Missed:', [f'{n} on {name}, before its publisher was matched' for name, n in missed]
    if 'chain' in report.custom_data:
        yield 'Chain:', _chains(report.custom_data['chain'])
    events = [f'{count} on {name}' for (name, kind, _), count, _ in topics if kind == _EVENTS]
    if events:
        yield 'Soliton events:', events
    for key in ('suite_version', 'command_line', 'ended_by', 'recovered_from'):
        if key in report.custom_data:
            yield f'{key.replace("_", " ").capitalize()}:', [report.custom_data[key]]
    if report.unverified:
        yield 'Checksums:', [f'missing for {report.unverified} messages; damage is not detected']
    if report.damage:
        yield 'Damage:', report.damage
        remedy = f'recover_bag {report.path} writes the intact messages to a new bag'
        yield 'Result:', [f'damaged; {remedy}']
    else:
        yield 'Result:', ['; '.join(['complete', *report.notes])]


def _row(kind: str, count: str, topic: _TopicRow) -> str:
    (name, type_name, encoding), messages, lost = topic
    missing = f' | Lost: {lost}' if lost else ''
    return (
        f'{kind}: {name} | Type: {type_name} | {count}: {messages} | '
        f'Serialization Format: {encoding}{missing}'
    )


def _topics(report: BagReport) -> tuple[list[_TopicRow], list[_TopicRow]]:
    counts: Counter[tuple[str, str, str]] = Counter()
    for topic, count in report.counts.items():
        counts[topic.name, topic.type_name, topic.serialization] += count
    lost = _counts_in(report, 'lost_messages')
    topics: list[_TopicRow] = []
    services: list[_TopicRow] = []
    for (name, kind, encoding), count in sorted(counts.items()):
        if name.endswith(_SERVICE_SUFFIX) and kind.endswith(_SERVICE_EVENT):
            own = name.removesuffix(_SERVICE_SUFFIX), kind.removesuffix(_SERVICE_EVENT), encoding
            services.append((own, count, lost.get(name, 0)))
        else:
            topics.append(((name, kind, encoding), count, lost.get(name, 0)))
    return topics, services


def _as_json(report: BagReport) -> dict[str, Any]:
    topics, services = _topics(report)
    keys = ('name', 'type', 'serialization_format', 'count', 'lost_when_recorded')
    known = 'lost_messages' in report.custom_data
    return {
        'path': str(report.path),
        'storage': report.storage,
        'ros_distro': report.distribution,
        'files': [file.name for file in report.files],
        'size': sum(file.stat().st_size for file in report.files),
        'start': report.start,
        'end': report.end if report.messages else None,
        'recorded': _recorded(report),
        'messages': report.messages,
        'topics': [dict(zip(keys, (*own, *counts), strict=True)) for own, *counts in topics],
        'services': [dict(zip(keys, (*own, *counts), strict=True)) for own, *counts in services],
        'lost_when_recorded': sum(_counts_in(report, 'lost_messages').values()) if known else None,
        'lost_by_damage': report.lost,
        'unverified': report.unverified,
        'damage': report.damage,
        'notes': report.notes,
        'custom_data': report.custom_data,
        'sound': _is_sound(report),
    }


def _recorded(report: BagReport) -> int:
    """Return the duration of the recording without its pauses [ns]."""
    start = report.end if report.start is None else report.start
    gaps = gaps_in(report.custom_data)
    return report.end - start - time_in_gaps(gaps, start, report.end)


def _seconds(nanoseconds: int) -> str:
    return f'{nanoseconds // SECOND}.{nanoseconds % SECOND:09d}'


def _moment(stamp: int) -> str:
    moment = time.localtime(stamp // SECOND)
    date = time.strftime('%b %e %Y %H:%M:%S', moment)
    return f'{date}.{stamp % SECOND:09d} ({_seconds(stamp)})'


def _size(number: float) -> str:
    units = ['B', 'KiB', 'MiB', 'GiB', 'TiB']
    power = 0
    while number >= 1024 and power < len(units) - 1:
        number, power = number / 1024, power + 1
    return f'{number:.{1 if power else 0}f} {units[power]}'


def _chains(text: str) -> list[str]:
    try:
        chains = load_json(text)
        return [
            f'{topic}: {chain["number_of_rotors"]} rotors, spacing {chain["spacing"]:g} m, '
            f'rotor length {chain["rotor_length"]:g} m, rest angle {chain["rest_angle"]:g} rad'
            for topic, chain in chains.items()
        ]
    except (ValueError, TypeError, KeyError, AttributeError):
        return [text]


def _losses(report: BagReport) -> str:
    known = 'lost_messages' in report.custom_data
    count = sum(_counts_in(report, 'lost_messages').values())
    recorded = f'{count or "nothing"} when recorded' if known else 'unknown when recorded'
    if _DAMAGE not in report.custom_data:
        return recorded
    damaged = parse_count(report.custom_data.get('lost_in_damage'))
    damage = report.custom_data[_DAMAGE]
    return f'{damaged or "an unknown number"} by damage before recovery ({damage}); {recorded}'


def _counts_in(report: BagReport, key: str) -> dict[str, int]:
    try:
        counts = load_json(report.custom_data.get(key, '{}'))
    except ValueError:
        return {}
    counted = counts.items() if isinstance(counts, dict) else ()
    return {topic: parse_count(count) for topic, count in counted}
