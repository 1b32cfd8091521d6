# SPDX-License-Identifier: Apache-2.0
"""Command lines of commands that have verbs, as `topic echo`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from soliton_linkage.command_line import PlainParser
from soliton_linkage.completion import complete

Verb = Callable[[argparse.Namespace], int]


class Verbs:
    """Verbs of a command, each with arguments of its own."""

    def __init__(self, command: str, description: str | None) -> None:
        """Describe a command that has none so far."""
        self._parser = PlainParser(prog=f'soliton-linkage {command}', description=description)
        self._verbs = self._parser.add_subparsers(metavar='VERB', required=True)

    def add(self, name: str, verb: Verb, summary: str) -> argparse.ArgumentParser:
        """Add a verb; return its parser, which is to be given its arguments."""
        parser: argparse.ArgumentParser = self._verbs.add_parser(
            name, help=summary, description=f'{summary[0].upper()}{summary[1:]}.'
        )
        parser.set_defaults(verb=verb)
        return parser

    def run(self, arguments: list[str]) -> int:
        """Understand a line and do what it says; return the exit code."""
        complete(self._parser)
        options = self._parser.parse_args(arguments)
        verb: Verb = options.verb
        return verb(options)
