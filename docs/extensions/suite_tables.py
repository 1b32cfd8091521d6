# SPDX-License-Identifier: Apache-2.0
"""Directives that insert parts of the code into the pages.

{parameters} MODULE:CLASS [PREFIX]    a table of the parameters that a dataclass describes
{notebook} PATH                       the cells of a notebook, one after the other
{captioned} PICTURE                   a picture with the caption in its .txt file
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from parameter_rows import parameter_rows
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def notebook_text(content: dict[str, Any]) -> str:
    """Return the cells of a notebook as Markdown."""
    return '\n\n'.join(
        text if cell['cell_type'] == 'markdown' else f'```python\n{text}\n```'
        for cell in content['cells']
        for text in [''.join(cell['source'])]
    )


class ParametersDirective(SphinxDirective):
    """Directive `{parameters} MODULE:CLASS [PREFIX]`: a table of parameters."""

    required_arguments = 1
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the document node of the table, in a list."""
        rows = [
            ('parameter', 'default', 'range', 'meaning'),
            4 * ('---',),
            *parameter_rows(*self.arguments),
        ]
        return self.parse_text_to_nodes('\n'.join(f'| {" | ".join(row)} |' for row in rows))


class NotebookDirective(SphinxDirective):
    """Directive `{notebook} PATH`, where PATH is relative to the folder of the page."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the document nodes of the cells."""
        path = beside(self, self.arguments[0])
        content = json.loads(path.read_text(encoding='utf-8'))
        return self.parse_text_to_nodes(notebook_text(content), allow_section_headings=True)


class CaptionedDirective(SphinxDirective):
    """Directive `{captioned} PICTURE`, where PICTURE is relative to the folder of the page."""

    required_arguments = 1
    option_spec: ClassVar = {'alt': str}

    def run(self) -> list[nodes.Node]:
        """Return the document node of the figure, in a list."""
        picture = self.arguments[0]
        text = beside(self, picture).with_suffix('.txt').read_text(encoding='utf-8')
        caption, *more = [' '.join(each.split()) for each in text.strip().split('\n\n')]
        figure = nodes.figure('', nodes.image(uri=picture, alt=self.options.get('alt', '')))
        figure += nodes.caption('', caption)
        if more:
            figure += nodes.legend('', *(nodes.paragraph('', each) for each in more))
        return [figure]


def beside(directive: SphinxDirective, path: str) -> Path:
    """Return an absolute path; if this file changes, Sphinx builds the page again.

    `path` is relative to the folder of the page.
    """
    _, absolute = directive.env.relfn2path(path)
    directive.env.note_dependency(absolute)
    return Path(absolute)


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives."""
    app.add_directive('parameters', ParametersDirective)
    app.add_directive('notebook', NotebookDirective)
    app.add_directive('captioned', CaptionedDirective)
    return {'parallel_read_safe': True}
