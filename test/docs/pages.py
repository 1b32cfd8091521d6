# SPDX-License-Identifier: Apache-2.0
"""The pages of the documentation as they stand in the sources."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted(DOCS.glob('**/*.md'))]


def table(page: Path, heading: str) -> list[list[str]]:
    """Rows of the first table under a heading, cell by cell, without its head."""
    text = page.read_text(encoding='utf-8').partition(f'\n{heading}\n')[2]
    lines = re.search(r'(\|.*\n)+', text)
    assert lines, f'{page.name} has no table under {heading!r}'
    rows = lines.group().splitlines()[2:]
    return [[cell.strip() for cell in row.strip('|').split('|')] for row in rows]


def directives(name: str) -> list[list[str]]:
    """Arguments of each use of a directive on any page."""
    return [
        match.split()
        for page in PAGES
        for match in re.findall(rf'^```{{{name}}} (.*)$', page.read_text(encoding='utf-8'), re.M)
    ]
