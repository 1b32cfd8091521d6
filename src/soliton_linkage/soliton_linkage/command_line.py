# SPDX-License-Identifier: Apache-2.0
"""Command lines: mistakes are reported in one line, and the shell completes words.

Completion needs the package argcomplete. In bash:
eval "$(register-python-argcomplete soliton-linkage)"
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Sequence
from typing import NoReturn

_ASKED = '_ARGCOMPLETE'
"""Environment variable of a program that is asked for completion: how many words of the line are
the program."""
_ROS_FLAGS = ('-r', '--remap', '-p', '--param', '--params-file', '--log-level')
_NEGATIVE = re.compile(r'-(\d|\.\d|inf|nan)')


class PlainParser(argparse.ArgumentParser):
    """Parser that reports an error in one line and exits with 2."""

    def error(self, message: str) -> NoReturn:
        """End the program."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')

    def parse(self, arguments: Sequence[str] | None = None) -> argparse.Namespace:
        """Return the options in the arguments, by default from the command line."""
        given = sys.argv[1:] if arguments is None else arguments
        # argparse takes only plain decimals for negative numbers, and other ones for options.
        spaced = [f' {each}' if _NEGATIVE.match(each) else each for each in given]
        options, unknown = self.parse_known_args(spaced)
        if any(each in _ROS_FLAGS or ':=' in each for each in unknown):
            self.error('ROS arguments come after --ros-args, as --ros-args -r __ns:=/left')
        if unknown:
            self.error(f'{" ".join(unknown)}: unknown')
        return options


def words_before() -> list[str]:
    """Return the words between the program and the one to be completed, if any is."""
    if _ASKED not in os.environ:
        return []
    return os.environ['COMP_LINE'][: int(os.environ['COMP_POINT'])].split(' ')[1:-1]


def skip_word() -> None:
    """Count the sub-command to the program, so that its own parser completes the line."""
    if _ASKED in os.environ:
        os.environ[_ASKED] = str(int(os.environ[_ASKED]) + 1)


def complete(parser: argparse.ArgumentParser) -> None:
    """If the shell asks for completion, answer and end."""
    if _ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser, exclude=['-h', '--help'])
