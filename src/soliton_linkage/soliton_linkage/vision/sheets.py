# SPDX-License-Identifier: Apache-2.0
"""Sheets with the markers of a chain, for printing to scale, as PDF or SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from soliton_linkage.linkage.chain import Array
from soliton_linkage.vision.layout import COLOURS, MODULES, MarkerLayout, marker_cells

PAPERS = {'a4': (0.210, 0.297), 'a3': (0.297, 0.420), 'letter': (0.2159, 0.2794)}
"""Width and height of each paper [m]."""
_MARGIN = 0.010
"""Width of the margin of a sheet, in which printers cannot print [m]."""
_HEADER = 0.022
"""Height of the title and the ruler together [m]."""
_GAP = 0.002
"""Gap between two markers, and height of the text below a marker [m]."""
_RULER = 0.1
"""Length of the printed ruler that shows the scale of the print [m]."""
_INCH = 0.0254
"""Length of an inch [m]."""
_BOARD = (9, 6, 0.025)
"""Columns and rows of squares of the chessboard, and side of a square [m]."""


def write_sheets(layout: MarkerLayout, path: Path, paper: str = 'a4') -> list[Path]:
    """Write the sheets; return the paths of the files.

    Raises ValueError if a marker is larger than the paper, or if the suffix is neither .pdf nor
    .svg.
    """
    figures = list(_sheets(layout, paper))
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == '.svg':
        paths = [path.with_name(f'{path.stem}_{n}.svg') for n in range(1, len(figures) + 1)]
        for figure, each in zip(figures, paths, strict=True):
            figure.savefig(each)
        return paths
    if path.suffix.lower() != '.pdf':
        raise ValueError(f'{path} has neither the suffix .pdf nor .svg; choose one of them')
    with PdfPages(path) as pages:
        for figure in figures:
            pages.savefig(figure)
    return [path]


def _sheets(layout: MarkerLayout, paper: str) -> Iterator[Figure]:
    size, side = layout.paper_size, 2 * layout.label_radius
    frames = [partial(_draw_frame_marker, layout, n) for n in range(len(layout.frame_centres))]
    title = 'frame markers: x along the chain from pivot 0, z up'
    yield from _pages(
        paper, title, _grid(paper, size, f'frame markers of {1e3 * size:.0f} mm'), frames
    )
    labels = _grid(paper, side, f'labels of {1e3 * side:.0f} mm')
    colours = layout.colours.tolist()
    pivots = [partial(_draw_label, layout, f'p{n}', 0) for n in range(len(colours))]
    masses = [partial(_draw_label, layout, f'm{n}', each) for n, each in enumerate(colours)]
    yield from _pages(paper, 'pivots: p0, p1, ...', labels, pivots)
    yield from _pages(paper, 'masses: m0, m1, ...', labels, masses)
    yield _chessboard(paper)


def _pages(
    paper: str, title: str, centres: Array, markers: Sequence[Callable[[Any, Array], None]]
) -> Iterator[Figure]:
    for first in range(0, len(markers), len(centres)):
        figure, axes = _sheet(paper, title)
        for draw, centre in zip(markers[first:], centres, strict=False):
            draw(axes, centre)
        yield figure


def _draw_frame_marker(layout: MarkerLayout, number: int, axes: Any, centre: Array) -> None:
    half = layout.paper_size / 2
    axes.add_patch(_square(centre - half, 2 * half, 'white', '0.8'))
    cell = layout.frame_marker_size / MODULES
    corner = centre + np.array([-1, 1]) * layout.frame_marker_size / 2
    for row, column in np.argwhere(marker_cells(number) == 0).tolist():
        # Without the black edge, white hairlines appear between black cells.
        low = corner + cell * np.array([column, -row - 1])
        axes.add_patch(_square(low, cell, 'black', 'black'))
    away = layout.frame_marker_size / 2 + layout.label_radius
    for side in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        dot = tuple(centre + away * np.array(side))
        axes.add_patch(Circle(dot, layout.dot_radius, color='black', lw=0))
    x, z = 1e3 * layout.frame_centres[number]
    text = f'frame marker {number}, this side up: centre at x = {x:.6g} mm, z = {z:.6g} mm'
    axes.text(centre[0], centre[1] - half - _GAP / 2, text, ha='center', va='top', fontsize=7)


def _draw_label(layout: MarkerLayout, name: str, colour: int, axes: Any, centre: Array) -> None:
    x, y = centre
    edge = {'edgecolor': '0.8', 'facecolor': 'white', 'linewidth': 0.3}
    axes.add_patch(Circle((x, y), layout.label_radius, **edge))
    paint = tuple(np.array(COLOURS[colour]) / 255.0)
    axes.add_patch(Circle((x, y), layout.dot_radius, color=paint, lw=0))
    axes.text(x, y - layout.label_radius, name, ha='center', va='top', fontsize=5)


def _chessboard(paper: str) -> Figure:
    columns, rows, square = _BOARD
    title = f'chessboard of {columns - 1} x {rows - 1} inner corners, squares of 25 mm'
    figure, axes = _sheet(paper, title)
    width, height = PAPERS[paper]
    low = np.array([(width - rows * square) / 2, (height - columns * square) / 2])
    for i in range(rows):
        for j in range(columns):
            if (i + j) % 2 == 0:
                axes.add_patch(_square(low + square * np.array([i, j]), square, 'black', 'black'))
    return figure


def _sheet(paper: str, title: str) -> tuple[Figure, Any]:
    width, height = PAPERS[paper]
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis('off')
    top = height - _MARGIN
    axes.text(_MARGIN, top, title, fontsize=9, va='top')
    axes.plot([_MARGIN, _MARGIN + _RULER], [top - 0.010] * 2, color='black', lw=0.5)
    for tick in range(11):
        x = _MARGIN + tick * _RULER / 10
        axes.plot([x, x], [top - 0.010, top - 0.008], color='black', lw=0.5)
    text = '100 mm: print without scaling and check the length of this ruler'
    axes.text(_MARGIN + _RULER + 0.003, top - 0.010, text, fontsize=7)
    return figure, axes


def _grid(paper: str, size: float, what: str) -> Array:
    """Return the centres of K markers with a side `size` on a sheet, row by row [m], (K, 2)."""
    width, height = size + _GAP, size + 2 * _GAP
    across, up = PAPERS[paper]
    columns = int((across - 2 * _MARGIN) / width)
    rows = int((up - 2 * _MARGIN - _HEADER) / height)
    if columns < 1 or rows < 1:
        raise ValueError(
            f'{what} do not fit on {paper}; choose another paper ({", ".join(PAPERS)}), or '
            'reduce markers.frame_marker_size and markers.label_diameter'
        )
    xs = _MARGIN + width * (np.arange(columns) + 0.5)
    ys = up - _MARGIN - _HEADER - height * (np.arange(rows) + 0.5)
    return np.array([(x, y) for y in ys for x in xs])


def _square(corner: Array, side: float, face: str, edge: str) -> Rectangle:
    return Rectangle(tuple(corner), side, side, facecolor=face, edgecolor=edge, linewidth=0.1)
