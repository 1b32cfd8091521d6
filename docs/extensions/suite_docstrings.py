# SPDX-License-Identifier: Apache-2.0
"""Conversion of the docstrings, which are plain text, to reStructuredText."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

from sphinx.application import Sphinx


def fields_listed(described: Any, lines: list[str]) -> list[str]:
    """Return the lines of a docstring, with lines `field: meaning` converted to a list.

    `field` is a field of the dataclass or named tuple `described`.
    """
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
    """Return the lines with | escaped, because reStructuredText treats `|x|` as a substitution."""
    return [re.sub(r'(?<!\\)\|', r'\\|', line) for line in lines]


def process(
    _app: Sphinx, _what: str, _name: str, described: Any, _options: Any, lines: list[str]
) -> None:
    """Convert the lines of a docstring in place."""
    lines[:] = bars_kept(fields_listed(described, lines))


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect `process` to the event of autodoc that occurs for each docstring."""
    app.connect('autodoc-process-docstring', process)
    return {'parallel_read_safe': True}
