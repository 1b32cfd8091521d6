# SPDX-License-Identifier: Apache-2.0
"""Make a whole bag of what is intact of one whose recorder was killed, or that is damaged."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes.bags.rescue.bag_rescue import recover_bag


def main() -> None:
    """Recover a bag; the exit code is 1 where nothing could be brought back."""
    parser = argparse.ArgumentParser(prog='recover_bag', description=__doc__)
    parser.add_argument('bag', type=Path, help='directory of the bag, or one file of it')
    parser.add_argument(
        '--output', type=Path, help='path of the new bag, to which _0, _1, ... is added'
    )
    parser.add_argument(
        '--doubtful', action='store_true', help='also bring back messages with wrong checksums'
    )
    arguments = parser.parse_args()
    bag = arguments.bag
    name = bag.resolve()
    output = arguments.output or name.parent / f'{name.name.partition(".")[0]}_recovered'
    progress = ProgressLine(f'recovering {bag}', 0)
    try:
        report, new = recover_bag(
            bag, output, arguments.doubtful, lambda done: progress.show(0, f'{done} messages')
        )
    except (ValueError, OSError) as error:
        sys.exit(f'recover_bag: {error}')
    for damage in report.damage:
        print(damage)
    lost = f', {report.lost} lost' if report.lost else ''
    print(f'recovered {report.messages} messages{lost} into {new}')
