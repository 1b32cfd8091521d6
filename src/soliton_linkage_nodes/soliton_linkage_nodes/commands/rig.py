# SPDX-License-Identifier: Apache-2.0
"""Check the encoders of your own rig, and write a report page."""

from __future__ import annotations

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes.commands import run


def main(arguments: list[str]) -> int:
    """Run the program check_rig for the verb `check`, and return its exit code."""
    parser = PlainParser(prog='soliton-linkage rig', description=__doc__)
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    verbs.add_parser('check', help='check joint_states, by check_rig', add_help=False)
    complete(parser)
    parser.parse_args(arguments[:1])
    return run.main(['check_rig', *arguments[1:]])
