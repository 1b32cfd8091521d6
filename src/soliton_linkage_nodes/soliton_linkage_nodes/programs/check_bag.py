# SPDX-License-Identifier: Apache-2.0
"""Say whether a bag is whole, what it holds, and what was lost when it was recorded."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.rescue.bag_rescue import BagReport, check_bag


def main() -> None:
    """Check a bag; the exit code is 1 where it is damaged or messages were lost."""
    parser = argparse.ArgumentParser(prog='check_bag', description=__doc__)
    parser.add_argument('bag', type=Path, help='directory of the bag, or one file of it')
    bag = parser.parse_args().bag
    progress = ProgressLine(f'checking {bag}', 0)
    try:
        report = check_bag(bag, lambda done: progress.show(0, f'{done} messages'))
    except (ValueError, OSError) as error:
        sys.exit(f'check_bag: {error}')
    print('\n'.join(_lines(report)))
    sys.exit(1 if report.damage or sum(_lost_when_recorded(report).values()) else 0)


def _lines(report: BagReport) -> Iterator[str]:
    seconds = (report.end - report.start) * 1e-9 if report.start is not None else 0.0
    files = ', '.join(file.name for file in report.files)
    yield f'{report.path}: {report.storage}, {files}'
    yield f'{report.messages} messages in {seconds:.3f} s'
    lost = _lost_when_recorded(report)
    for topic, count in sorted(report.counts.items(), key=lambda item: item[0].name):
        missing = f', {lost[topic.name]} lost when recorded' if lost.get(topic.name) else ''
        yield f'  {topic.name}  {topic.type_name}  {count}{missing}'
    for key in ('suite_version', 'command_line', 'chain', 'recovered_from'):
        if key in report.custom_data:
            yield f'{key.replace("_", " ")}: {report.custom_data[key]}'
    if 'lost_messages' in report.custom_data:
        yield f'lost when recorded: {sum(lost.values()) or "nothing"}'
    else:
        yield 'lost when recorded: not known'
    yield from report.damage
    if report.damage:
        yield f'damaged; recover_bag {report.path} makes a whole bag of what is intact'
    else:
        yield 'whole'


def _lost_when_recorded(report: BagReport) -> dict[str, int]:
    try:
        lost = json.loads(report.custom_data.get('lost_messages', '{}'))
        return {str(topic): int(count) for topic, count in lost.items()}
    except (ValueError, TypeError, AttributeError):
        return {}
