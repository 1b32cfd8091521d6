# SPDX-License-Identifier: Apache-2.0
"""Every picture states its units, the content of its panels and the meaning of its lines."""

import re
from typing import Any

from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from soliton_linkage_studies.palette import NAMES

LETTER = re.compile(r'(?:^|,\s+)([a-f])(?:  |,)')
STYLES = {'--': 'dashed', ':': 'dotted'}


def unexplained(figure: Figure, caption: str) -> list[str]:
    """Return descriptions of all parts of a picture without an explanation."""
    panels = [axes for axes in figure.axes if axes.axison and axes.get_label() != '<colorbar>']
    found = [f'axis without unit: {words!r}' for words in _labels(panels) if '[' not in words]
    titles = [axes.get_title(loc) for axes in figure.axes for loc in ('left', 'center')]
    found += [
        f'empty title: {title!r}'
        for title in filter(None, titles)
        if not re.search(r'\w{3}', LETTER.sub('', title))
    ]
    named = [*titles, *(axes.get_ylabel() for axes in panels)]
    letters = {letter for words in named for letter in LETTER.findall(words)}
    found += [
        f'no ({letter}) in the caption' for letter in letters if f'({letter})' not in caption
    ]
    return found + _unexplained_lines(panels, caption)


def _labels(panels: list[Any]) -> list[str]:
    """Labels of all axes, of those that are shared the one that is written."""
    labels = []
    for axes in panels:
        across = axes.get_shared_x_axes().get_siblings(axes)
        up = axes.get_shared_y_axes().get_siblings(axes)
        labels.append(max((other.get_xlabel() for other in across), key=len))
        labels.append(max((other.get_ylabel() for other in up), key=len))
    return labels


def _unexplained_lines(panels: list[Any], caption: str) -> list[str]:
    lines: list[Line2D] = [line for axes in panels for line in axes.lines]
    named = [line for line in lines if not str(line.get_label()).startswith('_')]
    bars = [bars for axes in panels for bars in axes.containers if bars.get_label()]
    named += [part for each in bars for part in (each[0], *each[1])]
    colours = {to_hex(line.get_color()) for line in named}
    styles = {line.get_linestyle() for line in named}
    words = set(re.findall(r'\w+', caption.lower()))
    found = []
    for line in lines:
        colour, style = to_hex(line.get_color()), line.get_linestyle()
        name = NAMES.get(colour, colour)
        if colour not in colours and not set(name.split()) <= words:
            found.append(f'line in {name}')
        if style in STYLES and style not in styles and STYLES[style] not in words:
            found.append(f'{STYLES[style]} line in {name}')
    return found
