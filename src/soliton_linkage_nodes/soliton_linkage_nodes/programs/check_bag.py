# SPDX-License-Identifier: Apache-2.0
"""Say whether a bag is whole, what it holds, and what was lost when it was recorded."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from soliton_linkage.command_line import PlainParser
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.guards import load_json, parse_count
from soliton_linkage_nodes.bags.recovery import BagReport, check_bag
from soliton_linkage_nodes.programs.command_line import (
    add_limits,
    exit_on_failure,
    limits_of,
)

_DAMAGE = 'damage'
"""Text of a bag that was recovered of another, with what was wrong with that."""


def main() -> None:
    """Check a bag; the exit code is 1 where it is damaged or messages were lost."""
    parser = PlainParser(
        prog='check_bag',
        description=f'{__doc__} The exit code is 1 where it is damaged or messages were lost.',
    )
    parser.add_argument('bag', type=Path, help='directory of the bag, or one file of it')
    add_limits(parser)
    options = parser.parse()
    bag = options.bag
    progress = ProgressLine(f'checking {bag}', 0)
    with exit_on_failure('check_bag'):
        report = check_bag(
            bag, lambda done: progress.show(0, f'{done} messages'), limits_of(options)
        )
    progress.clear()
    print('\n'.join(_lines(report)))
    lost = _lost_when_recorded(report)
    sys.exit(bool(report.damage or _DAMAGE in report.custom_data or sum(lost.values())))


def _lines(report: BagReport) -> Iterator[str]:
    seconds = (report.end - report.start) * 1e-9 if report.start is not None else 0.0
    files = ', '.join(file.name for file in report.files)
    yield f'{report.path}: {report.storage}, {files}'
    yield f'{report.messages} messages in {seconds:.3f} s'
    lost = _lost_when_recorded(report)
    for topic, count in sorted(report.counts.items(), key=lambda item: item[0].name):
        missing = f', {lost[topic.name]} lost when recorded' if lost.get(topic.name) else ''
        yield f'  {topic.name}  {topic.type_name}  {count}{missing}'
    for key in ('suite_version', 'command_line', 'chain', 'ended_by', 'recovered_from'):
        if key in report.custom_data:
            yield f'{key.replace("_", " ")}: {report.custom_data[key]}'
    if report.unverified:
        yield f'{report.unverified} messages have no checksum: changes in them go unnoticed'
    yield _losses(report, sum(lost.values()))
    yield from report.damage
    if report.damage:
        yield f'damaged; recover_bag {report.path} makes a whole bag of what is intact'
    else:
        yield 'whole'


def _losses(report: BagReport, when_recorded: int) -> str:
    """What is not in the bag, be it that it was never recorded or that damage took it."""
    known = 'lost_messages' in report.custom_data
    recorded = f'{when_recorded or "nothing"}' if known else 'not known'
    if _DAMAGE not in report.custom_data:
        return f'lost when recorded: {recorded}'
    count = parse_count(report.custom_data.get('lost_in_damage'))
    damage = report.custom_data[_DAMAGE]
    return (
        f'lost before it was recovered: {count or "an unknown number"} ({damage}); '
        f'when recorded: {recorded}'
    )


def _lost_when_recorded(report: BagReport) -> dict[str, int]:
    try:
        lost = load_json(report.custom_data.get('lost_messages', '{}'))
    except ValueError:
        return {}
    counted = lost.items() if isinstance(lost, dict) else ()
    return {topic: parse_count(count) for topic, count in counted}
