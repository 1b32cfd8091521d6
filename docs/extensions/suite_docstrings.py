# SPDX-License-Identifier: Apache-2.0
"""Docstrings are written to be read in a terminal; this makes reStructuredText of them."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

from sphinx.application import Sphinx


def fields_listed(described: Any, lines: list[str]) -> list[str]:
    """Make a list of the lines `field: meaning` in the docstring of a dataclass or named tuple."""
    if dataclasses.is_dataclass(described):
        names = {field.name for field in dataclasses.fields(described)}
    else:
        names = set(getattr(described, '_fields', ()))
    listed = []
    for line in lines:
        name, colon, meaning = line.strip().partition(': ')
        if colon and name in names:
            if listed and listed[-1].strip() and not listed[-1].startswith((':ivar', ' ')):
                listed.append('')
            listed.append(f':ivar {name}: {meaning}')
        elif line.strip() != 'Fields:':
            listed.append(line)
    return listed


def bars_kept(lines: list[str]) -> list[str]:
    """Let `|x|` be the absolute value that it is."""
    return [re.sub(r'(?<!\\)\|', r'\\|', line) for line in lines]


def process(
    _app: Sphinx, _what: str, _name: str, described: Any, _options: Any, lines: list[str]
) -> None:
    """Mend the lines of a docstring in place."""
    lines[:] = bars_kept(fields_listed(described, lines))


def setup(app: Sphinx) -> dict[str, Any]:
    """Listen to autodoc."""
    app.connect('autodoc-process-docstring', process)
    return {'parallel_read_safe': True}
