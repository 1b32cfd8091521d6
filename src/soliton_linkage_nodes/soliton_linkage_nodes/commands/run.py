# SPDX-License-Identifier: Apache-2.0
"""Run a node or a program of the suite, as `ros2 run soliton_linkage_nodes` does."""

from __future__ import annotations

import sys
from functools import partial

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes import start

PROGRAMS = sorted(name for name, value in vars(start).items() if isinstance(value, partial))
"""Programs that `ros2 run soliton_linkage_nodes` can run."""


def main(arguments: list[str]) -> int:
    """Run the program that the first argument names, and pass the other arguments to it."""
    parser = PlainParser(
        prog='soliton-linkage run',
        usage='%(prog)s PROGRAM ...',
        description=f'Run a node or a program of the suite: {", ".join(PROGRAMS)}.',
        epilog='Run a program with --help to list its arguments.',
    )
    parser.add_argument('program', choices=PROGRAMS, metavar='PROGRAM', help='name of the program')
    complete(parser)
    name = parser.parse_args(arguments[:1]).program
    sys.argv = [name, *arguments[1:]]
    getattr(start, name)()
    return 0
