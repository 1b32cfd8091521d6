# SPDX-License-Identifier: Apache-2.0
"""Sheets of paper with the markers of a chain, to scale: PDF, or one SVG per sheet."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.layout import COLOURS, MODULES, MarkerLayout, marker_cells

PAPERS = {'a4': (0.210, 0.297), 'a3': (0.297, 0.420), 'letter': (0.2159, 0.2794)}
"""Width and height [m]."""
_MARGIN = 0.010
"""Margin of a sheet, where printers do not print [m]."""
_HEAD = 0.022
"""Height of the title and the ruler of a sheet [m]."""
_GAP = 0.002
"""Gap between markers, and below labels for their numbers [m]."""
_RULER = 0.1
"""Length of the ruler, a check of the scale [m]."""
_INCH = 0.0254
"""[m]."""
_BOARD = (9, 6, 0.025)
"""Columns and rows of squares of the chessboard, and their side [m]: 8 x 5 inner corners."""


def write_sheets(layout: MarkerLayout, path: Path, paper: str = 'a4') -> list[Path]:
    """Write the sheets of a chain; return the files. ValueError if a marker does not fit."""
    figures = list(_sheets(layout, paper))
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == '.svg':
        paths = [path.with_name(f'{path.stem}_{n}.svg') for n in range(1, len(figures) + 1)]
        for figure, each in zip(figures, paths, strict=True):
            figure.savefig(each)
        return paths
    if path.suffix.lower() != '.pdf':
        raise ValueError(f'{path} is neither a .pdf nor a .svg; name one')
    with PdfPages(path) as pages:
        for figure in figures:
            pages.savefig(figure)
    return [path]


def _sheets(layout: MarkerLayout, paper: str) -> Iterator[Figure]:
    yield from _frame_sheets(layout, paper)
    rotors = range(layout.chain.number_of_rotors)
    pivots = [(f'p{rotor}', 0) for rotor in rotors]
    masses = [(f'm{rotor}', int(layout.colours[rotor])) for rotor in rotors]
    yield from _label_sheets(layout, paper, pivots, 'pivots: p0, p1, ...')
    yield from _label_sheets(layout, paper, masses, 'masses: m0, m1, ...')
    yield _chessboard(paper)


def _frame_sheets(layout: MarkerLayout, paper: str) -> Iterator[Figure]:
    """Yield frame markers with their places."""
    size = layout.paper_size
    places = _grid(paper, size + _GAP, size + 2 * _GAP, f'frame markers of {1e3 * size:.0f} mm')
    for first in range(0, len(layout.frame_centres), len(places)):
        figure, axes = _sheet(paper, 'frame markers: x along the chain from pivot 0, z up')
        numbers = range(first, min(first + len(places), len(layout.frame_centres)))
        for (x, y), number in zip(places, numbers, strict=False):
            _draw_frame_marker(axes, layout, number, np.array([x, y]))
        yield figure


def _draw_frame_marker(axes: Any, layout: MarkerLayout, number: int, middle: Array) -> None:
    half = layout.paper_size / 2
    axes.add_patch(_square(middle - half, 2 * half, 'white', '0.8'))
    cell = layout.frame_marker_size / MODULES
    corner = middle + np.array([-1, 1]) * layout.frame_marker_size / 2
    for row, cells in enumerate(marker_cells(number)):
        for column, value in enumerate(cells):
            if not value:
                # White hairs between black cells would be seen.
                axes.add_patch(
                    _square(corner + cell * np.array([column, -row - 1]), cell, 'black', 'black')
                )
    away = layout.frame_marker_size / 2 + layout.label_radius
    for side in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        axes.add_patch(
            Circle(tuple(middle + away * np.array(side)), layout.dot_radius, color='black', lw=0)
        )
    x, z = 1e3 * layout.frame_centres[number]
    said = f'frame marker {number}, this side up: centre at x = {x:.0f} mm, z = {z:.0f} mm'
    axes.text(middle[0], middle[1] - half - _GAP / 2, said, ha='center', va='top', fontsize=7)


def _label_sheets(
    layout: MarkerLayout, paper: str, labels: Sequence[tuple[str, int]], title: str
) -> Iterator[Figure]:
    """Yield labels with a name and the number of a colour each."""
    side = 2 * layout.label_radius
    places = _grid(paper, side + _GAP, side + 2 * _GAP, f'labels of {1e3 * side:.0f} mm')
    for first in range(0, len(labels), len(places)):
        figure, axes = _sheet(paper, title)
        for (x, y), (name, colour) in zip(places, labels[first:], strict=False):
            paint = tuple(np.array(COLOURS[colour]) / 255.0)
            edge = {'edgecolor': '0.8', 'facecolor': 'white', 'linewidth': 0.3}
            axes.add_patch(Circle((x, y), layout.label_radius, **edge))
            axes.add_patch(Circle((x, y), layout.dot_radius, color=paint, lw=0))
            axes.text(x, y - layout.label_radius, name, ha='center', va='top', fontsize=5)
        yield figure


def _chessboard(paper: str) -> Figure:
    columns, rows, square = _BOARD
    figure, axes = _sheet(
        paper, f'chessboard of {columns - 1} x {rows - 1} inner corners, squares of 25 mm'
    )
    width, height = PAPERS[paper]
    # It stands upright on the sheet, which is higher than wide.
    low = np.array([(width - rows * square) / 2, (height - columns * square) / 2])
    for i in range(rows):
        for j in range(columns):
            if (i + j) % 2 == 0:
                axes.add_patch(_square(low + square * np.array([i, j]), square, 'black', 'black'))
    return figure


def _sheet(paper: str, title: str) -> tuple[Figure, Any]:
    """Return a sheet with a title and a ruler, whose coordinates are metres."""
    width, height = PAPERS[paper]
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    axes.axis('off')
    top = height - _MARGIN
    axes.text(_MARGIN, top, title, fontsize=9, va='top')
    axes.plot([_MARGIN, _MARGIN + _RULER], [top - 0.010] * 2, color='black', lw=0.5)
    for tick in range(11):
        x = _MARGIN + tick * _RULER / 10
        axes.plot([x, x], [top - 0.010, top - 0.008], color='black', lw=0.5)
    said = '100 mm: print without scaling, and measure'
    axes.text(_MARGIN + _RULER + 0.003, top - 0.010, said, fontsize=7)
    return figure, axes


def _grid(paper: str, width: float, height: float, what: str) -> Array:
    """Return the middles of places of a size on a sheet [m], row by row, shape (K, 2)."""
    across, up = PAPERS[paper]
    columns = int((across - 2 * _MARGIN) / width)
    rows = int((up - 2 * _MARGIN - _HEAD) / height)
    if columns < 1 or rows < 1:
        raise ValueError(
            f'{what} do not fit on {paper}; choose another paper of {", ".join(PAPERS)}, or '
            'smaller markers by markers.frame_marker_size and markers.label_diameter'
        )
    xs = _MARGIN + width * (np.arange(columns) + 0.5)
    ys = up - _MARGIN - _HEAD - height * (np.arange(rows) + 0.5)
    return np.array([(x, y) for y in ys for x in xs])


def _square(corner: Array, side: float, face: str, edge: str) -> Rectangle:
    return Rectangle(tuple(corner), side, side, facecolor=face, edgecolor=edge, linewidth=0.1)
