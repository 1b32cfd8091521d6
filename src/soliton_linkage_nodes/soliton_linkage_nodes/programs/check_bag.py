# SPDX-License-Identifier: Apache-2.0
"""Report whether a bag is complete, its content, and the losses during recording."""

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
"""Key of the custom data of a recovered bag that describes the damage of the original."""


def main() -> None:
    """Check a bag; exit with 1 if it is damaged or messages were lost."""
    parser = PlainParser(
        prog='check_bag',
        description=f'{__doc__} The exit code is 1 if it is damaged or messages were lost.',
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
        yield f'{report.unverified} messages have no checksum: changes are not detected'
    yield _losses(report, sum(lost.values()))
    yield from report.damage
    if report.damage:
        yield f'damaged; recover_bag {report.path} writes the intact messages to a new bag'
    else:
        yield 'complete'


def _losses(report: BagReport, when_recorded: int) -> str:
    """Describe the messages that were lost during recording or by damage."""
    known = 'lost_messages' in report.custom_data
    recorded = f'{when_recorded or "nothing"}' if known else 'unknown'
    if _DAMAGE not in report.custom_data:
        return f'lost when recorded: {recorded}'
    count = parse_count(report.custom_data.get('lost_in_damage'))
    damage = report.custom_data[_DAMAGE]
    return (
        f'lost by damage before recovery: {count or "an unknown number"} ({damage}); '
        f'when recorded: {recorded}'
    )


def _lost_when_recorded(report: BagReport) -> dict[str, int]:
    try:
        lost = load_json(report.custom_data.get('lost_messages', '{}'))
    except ValueError:
        return {}
    counted = lost.items() if isinstance(lost, dict) else ()
    return {topic: parse_count(count) for topic, count in counted}
