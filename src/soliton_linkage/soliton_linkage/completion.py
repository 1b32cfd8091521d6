# SPDX-License-Identifier: Apache-2.0
"""Completion of command lines by the shell, where the package argcomplete is installed.

In bash: eval "$(register-python-argcomplete soliton-linkage)"
"""

from __future__ import annotations

import argparse
import os

_ASKED = '_ARGCOMPLETE'
"""In the environment of a program that is asked how its line may go on: how many words of the line
are the program."""


def words_before() -> list[str]:
    """Words between the program and the one that is to be completed; none where none is."""
    if _ASKED not in os.environ:
        return []
    return os.environ['COMP_LINE'][: int(os.environ['COMP_POINT'])].split(' ')[1:-1]


def skip_word() -> None:
    """Count the sub-command to the program, so that its own parser completes the line."""
    if _ASKED in os.environ:
        os.environ[_ASKED] = str(int(os.environ[_ASKED]) + 1)


def complete(parser: argparse.ArgumentParser) -> None:
    """Where the shell asks how the line may go on, answer and end."""
    if _ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser, exclude=['-h', '--help'])
