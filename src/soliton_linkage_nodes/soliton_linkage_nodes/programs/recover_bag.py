# SPDX-License-Identifier: Apache-2.0
"""Write the intact messages of a damaged or unfinished bag to a new bag."""

from __future__ import annotations

import sys
from pathlib import Path

from soliton_linkage.command_line import PlainParser
from soliton_linkage_nodes.bags.guards import BagLimits
from soliton_linkage_nodes.bags.recovery import recover_bag
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.runtime.process import interrupt_on_signals


def main() -> None:
    """Recover the bag that the command line names; exit with 1 if no message is intact."""
    parser = PlainParser(
        prog='recover_bag',
        description=f'{__doc__} The exit code is 1 if no message could be recovered.',
    )
    parser.add_argument('bag', type=Path, help='directory of the bag, or one file of it')
    parser.add_argument(
        '--output',
        type=Path,
        help='path of the new bag; _0, _1, ... is appended (<bag>_recovered beside the bag)',
    )
    parser.add_argument(
        '--doubtful', action='store_true', help='also recover messages with wrong checksums'
    )
    command_line.add_fields(parser, BagLimits(), 'BYTES')
    options = parser.parse()
    bag: Path = options.bag
    name = bag.resolve()
    output = options.output or name.parent / f'{name.name.partition(".")[0]}_recovered'
    progress, show = command_line.message_progress(f'recovering {bag}')
    interrupt_on_signals()
    with command_line.exit_on_failure('recover_bag'):
        try:
            limits = command_line.fields_of(options, BagLimits)
            report, new = recover_bag(bag, output, options.doubtful, show, limits)
        except KeyboardInterrupt:
            print(f'\nrecover_bag: stopped; {output}_* is incomplete', file=sys.stderr)
            raise
    progress.clear()
    for damage in report.damage:
        print(damage)
    if report.damage and report.unverified:
        print(f'{report.unverified} messages have no checksum and may be damaged')
    lost = f', {report.lost} lost' if report.lost else ''
    print(f'recovered {report.messages} messages{lost} into {new}')
