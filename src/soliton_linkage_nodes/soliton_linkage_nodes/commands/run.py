# SPDX-License-Identifier: Apache-2.0
"""Run a node or a program of the suite, as `ros2 run soliton_linkage_nodes` does."""

from __future__ import annotations

import sys
from functools import partial

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes import start

PROGRAMS = sorted(name for name, value in vars(start).items() if isinstance(value, partial))
"""Names that `ros2 run soliton_linkage_nodes` knows."""


def main(arguments: list[str]) -> int:
    """Become the program that the first argument names; the rest of the arguments is for it."""
    parser = PlainParser(
        prog='soliton-linkage run',
        usage='%(prog)s PROGRAM ...',
        description=f'Run a node or a program of the suite: {", ".join(PROGRAMS)}.',
        epilog='Each of them tells with --help what may follow.',
    )
    parser.add_argument('program', choices=PROGRAMS, metavar='PROGRAM', help='its name')
    complete(parser)
    name = parser.parse_args(arguments[:1]).program
    sys.argv = [name, *arguments[1:]]
    getattr(start, name)()
    return 0
