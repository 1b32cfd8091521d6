# SPDX-License-Identifier: Apache-2.0
"""Command `soliton-linkage`; its sub-commands come from the studies and from other packages.

A sub-command is an entry point in the group `soliton_linkage.commands`. The entry point is a
function that receives the list of arguments and returns the exit code: 0 after success, 1 after an
error, and 2 after Ctrl-C or for an invalid command line. The first line of the module docstring is
the help text of the sub-command.
"""

from __future__ import annotations

import argparse
import ast
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path

from soliton_linkage.command_line import PlainParser, complete, skip_word, words_before

PROGRAM = 'soliton-linkage'
_GROUP = 'soliton_linkage.commands'
_STUDIES = 'soliton_linkage_studies'
_REQUIREMENTS = {
    'matplotlib': ('matplotlib', 'python3-matplotlib'),
    'mpl_toolkits': ('matplotlib', 'python3-matplotlib'),
    'yaml': ('pyyaml', 'python3-yaml'),
}
_FAILURES = (ArithmeticError, LookupError, OSError, RuntimeError, ValueError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the sub-command that the first argument names, and return its exit code.

    Without arguments, print the list of all sub-commands and return 0.
    """
    given = sys.argv[1:] if arguments is None else list(arguments)
    words = words_before() or given
    commands = {found.name: found for found in sorted(entry_points(group=_GROUP))}
    if words and words[0] in commands:
        skip_word()
        return _run(commands[words[0]], given[1:])
    parser = _parser(commands)
    complete(parser)
    if given and not given[0].startswith('-'):
        known = ', '.join(commands) or 'none here'
        more = 'source the setup.bash of a workspace to add its commands'
        if not any(each.module.startswith(_STUDIES) for each in commands.values()):
            more += f'; for studies, install {_STUDIES} with pip, or by the rosdep key {_STUDIES}'
        parser.error(f'unknown command {given[0]}; known commands are {known}; {more}')
    parser.parse_args(given)
    parser.print_help()
    return 0


def _run(command: EntryPoint, arguments: list[str]) -> int:
    title = f'{PROGRAM} {command.name}'
    try:
        code: int = command.load()(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return int(signal.SIGINT)
    except BrokenPipeError:
        # Redirect stdout, because Python would write to the closed pipe again when it exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ModuleNotFoundError as error:
        print(f'{title}: {error}; {_remedy(command, error)}', file=sys.stderr)
        return 1
    except _FAILURES as error:
        print(f'{title}: {error}', file=sys.stderr)
        return 1
    return code


def _remedy(command: EntryPoint, error: ModuleNotFoundError) -> str:
    missing = (error.name or '').partition('.')[0]
    if command.module.startswith(_STUDIES) and missing in _REQUIREMENTS:
        return 'pip install {}, or the rosdep key {}'.format(*_REQUIREMENTS[missing])
    return 'install it, or source the setup.bash of the workspace that contains it'


def _parser(commands: Mapping[str, EntryPoint]) -> PlainParser:
    width = max(map(len, commands), default=0)
    lines = [f'  {name:{width}}  {_summary(found)}' for name, found in commands.items()]
    parser = PlainParser(
        prog=PROGRAM,
        usage=f'{PROGRAM} COMMAND ...',
        description='A topological linkage: its studies, and its nodes where ROS 2 is installed.',
        epilog='\n'.join(['commands; each has a --help:', *lines]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('command', nargs='?', choices=list(commands), help=argparse.SUPPRESS)
    text = f'{PROGRAM} {version("soliton_linkage")}'
    parser.add_argument('--version', action='version', version=text)
    return parser


def _summary(command: EntryPoint) -> str:
    """Return the first line of a command's docstring without importing its module."""
    if command.dist is None:
        return ''
    path = Path(str(command.dist.locate_file(command.module.replace('.', '/') + '.py')))
    syntax = ast.parse(path.read_text(encoding='utf-8') if path.is_file() else '')
    return (ast.get_docstring(syntax) or '').partition('\n')[0]
