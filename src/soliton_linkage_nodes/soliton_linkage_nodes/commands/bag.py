# SPDX-License-Identifier: Apache-2.0
"""Inspect, record and play bags with the programs of the suite."""

from __future__ import annotations

import json

from soliton_linkage.command_line import PlainParser, complete
from soliton_linkage_nodes.commands import run


def main(arguments: list[str]) -> int:
    """Run the program for the verb of the command line, and return its exit code."""
    parser = PlainParser(prog='soliton-linkage bag', description=__doc__)
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    info = verbs.add_parser('info', help='report the content of bags, by check_bag')
    info.add_argument('bags', nargs='+', metavar='bag', help='directory of a bag')
    record = verbs.add_parser('record', help='record a bag until Ctrl-C, by bag_recorder')
    record.add_argument('topics', nargs='*', help='topics to record [all of the suite]')
    record.add_argument('-o', '--output', help='path of the bag; _0, _1, ... is appended')
    record.add_argument(
        *('-a', '--all'), dest='regex', action='store_const', const='.', help='record all topics'
    )
    record.add_argument('-e', '--regex', help='also record topics that contain this pattern')
    record.add_argument('-x', '--exclude-regex', help='omit topics that contain this pattern')
    play = verbs.add_parser('play', help='play a bag, by bag_player')
    play.add_argument('bag', help='directory of the bag')
    play.add_argument('-r', '--rate', type=float, help='rate relative to the recording [1]')
    play.add_argument('-l', '--loop', action='store_true', help='restart at the end of the bag')
    play.add_argument('--topics', nargs='+', help='topics to play [all in the bag]')
    play.add_argument('--start-offset', type=float, help='start time in the bag, in s [0]')
    play.add_argument(
        *('--clock',), dest='publish_clock', action='store_true', help='publish /clock'
    )
    for each in (record, play):
        each.add_argument('--start-paused', action='store_true', help='begin paused')
        each.epilog = 'Further parameters of the node follow --ros-args, such as -p NAME:=VALUE.'
    complete(parser)
    own = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    options = vars(parser.parse_args(arguments[:own]))
    verb = options.pop('verb')
    if verb == 'info':
        return run.main(['check_bag', *options['bags'], *arguments[own:]])
    given = [f'{name}:={json.dumps(value)}' for name, value in options.items() if value]
    parameters = [word for each in given for word in ('-p', each)]
    program = 'bag_recorder' if verb == 'record' else 'bag_player'
    return run.main([program, '--ros-args', *parameters, *arguments[own + 1 :]])
