# SPDX-License-Identifier: Apache-2.0
"""A command line whose mistakes are said in one line."""

from __future__ import annotations

import argparse
from typing import NoReturn


class PlainParser(argparse.ArgumentParser):
    """Says in one line what is wrong with a command line, and ends the program with 2."""

    def error(self, message: str) -> NoReturn:
        """End the program."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')
