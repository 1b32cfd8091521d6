# SPDX-License-Identifier: Apache-2.0
"""Parsing of command lines, with one-line error messages and with completion by the shell.

In bash, `eval "$(register-python-argcomplete soliton-linkage)"` activates completion.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

_ASKED = '_ARGCOMPLETE'
"""Environment variable that marks a completion request. Its value is the number of words that name
the program: 1, or 2 with a sub-command."""
_ROS_FLAGS = ('-r', '--remap', '-p', '--param', '--params-file', '--log-level')
_NEGATIVE = re.compile(r'-(\d|\.\d|inf|nan)')


class PlainParser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line and exits with code 2."""

    def error(self, message: str) -> NoReturn:
        """Print the error message and exit with code 2."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')

    def parse(self, arguments: Sequence[str] | None = None) -> argparse.Namespace:
        """Return the parsed options; by default, parse the arguments of the program."""
        given = sys.argv[1:] if arguments is None else arguments
        # argparse recognises only plain decimals as negative numbers, and regards -1e-3 as an
        # option. A leading space prevents this.
        spaced = [f' {each}' if _NEGATIVE.match(each) else each for each in given]
        options, unknown = self.parse_known_args(spaced)
        if any(each in _ROS_FLAGS or ':=' in each for each in unknown):
            self.error('put ROS arguments after --ros-args, e.g. --ros-args -r __ns:=/left')
        if unknown:
            self.error(f'{" ".join(unknown)}: unknown')
        return options


def words_before() -> list[str]:
    """Return the words between the program name and the word that the shell completes.

    Return an empty list unless the shell requests completion.
    """
    if _ASKED not in os.environ:
        return []
    return os.environ['COMP_LINE'][: int(os.environ['COMP_POINT'])].split(' ')[1:-1]


def skip_word() -> None:
    """Skip the sub-command in a completion request, so that its own parser completes the line."""
    if _ASKED in os.environ:
        os.environ[_ASKED] = str(int(os.environ[_ASKED]) + 1)


def complete(parser: argparse.ArgumentParser) -> None:
    """If the shell requests completion, print the completions and exit."""
    if _ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser, exclude=['-h', '--help'])
