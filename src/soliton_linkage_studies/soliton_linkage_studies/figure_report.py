# SPDX-License-Identifier: Apache-2.0
"""Finished figures: the picture, its caption, its data, and what it says beside the paper."""

from __future__ import annotations

import csv
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from soliton_linkage_studies.formulas import Formula

_RESOLUTION = 150
"""Of pictures as PNG [pixels per inch]: 1200 to 2000 pixels across."""
_DIGITS = 5
"""Significant digits of numbers in a table, more than most theories are good for."""
_LINE = 95
"""Letters in a line of a caption."""
_ROUNDING = 1e-11
"""Error that a table shows as none: what rounding leaves of a sum of some thousand terms."""


@dataclass(frozen=True)
class Comparison:
    """One quantity as the paper has it, as the corrected theory has it, and as measured."""

    quantity: str
    """What it is, with the chain that it is of and its unit."""
    paper: str | Formula
    """What the paper says, with its equation."""
    theory: str | Formula
    """What holds for the discrete chain: a formula, or where its number is from in words."""
    measured: float
    """What the simulated chain does."""
    stated: float = math.nan
    """The number of a theory in words, where it has one."""

    @property
    def expected(self) -> float:
        """The theory as a number, that of its formula; NaN where there is none."""
        return self.theory.value if isinstance(self.theory, Formula) else self.stated

    @property
    def error(self) -> str:
        """Relative distance of the measured number from the theory's, in per cent."""
        if not math.isfinite(self.expected):
            return ''
        if self.expected == 0:
            return f'{self.measured:.1e}' if abs(self.measured) > _ROUNDING else '0'
        error = self.measured / self.expected - 1
        return f'{100 * error:+.2g} %' if abs(error) > _ROUNDING else '0 %'


@dataclass
class FigureReport:
    """A figure in the making: panels to draw on, and the data that was drawn."""

    figure: Figure
    caption: str
    """What it shows, and each symbol, line and colour that no legend names."""
    rows: list[tuple[str, str, float, float, str, str]] = field(default_factory=list)
    """Every point drawn, as (panel, series, x, y, x_name, y_name)."""
    comparisons: list[Comparison] = field(default_factory=list)

    def add_points(
        self, panel: str, series: str, names: tuple[str, str], x: ArrayLike, y: ArrayLike
    ) -> None:
        """Keep points for the data of the figure, x and y of the same shape (K,).

        The names say what x and y are, with their units.
        """
        for across, up in zip(np.ravel(x), np.ravel(y), strict=True):
            self.rows.append((panel, series, float(across), float(up), *names))

    def add_comparison(
        self,
        quantity: str,
        paper: str | Formula,
        theory: str | Formula,
        measured: float,
        stated: float = math.nan,
    ) -> None:
        """Add a line to the table that sets paper, theory and measurement side by side."""
        self.comparisons.append(Comparison(quantity, paper, theory, measured, stated))

    def save(self, folder: Path, name: str) -> None:
        """Write the picture as PNG and PDF, its caption as text, and its data as CSV."""
        for suffix in ('png', 'pdf'):
            save_figure(self.figure, folder / f'{name}.{suffix}')
        save_caption(self.caption, folder / f'{name}.txt')
        with (folder / f'{name}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(['panel', 'series', 'x', 'y', 'x_name', 'y_name'])
            writer.writerows(
                (panel, series, repr(x), repr(y), *names)
                for panel, series, x, y, *names in self.rows
            )


def save_figure(figure: Figure, path: Path) -> None:
    """Write a picture, of the kind that the suffix says; the same figure makes the same file."""
    metadata = {'CreationDate': None} if path.suffix == '.pdf' else None
    figure.savefig(path, dpi=_RESOLUTION, metadata=metadata)


def save_caption(caption: str, path: Path) -> None:
    """Write a caption in lines that fit a page, its paragraphs apart, as Markdown reads it."""
    paragraphs = [' '.join(each.split()) for each in re.split(r'\n\s*\n', caption.strip())]
    if not any(paragraphs):
        raise ValueError(f'{path.stem} has no caption; say what it shows and what its colours are')
    text = '\n\n'.join(textwrap.fill(each, _LINE) for each in paragraphs)
    path.write_text(f'{text}\n', encoding='utf-8')


def write_table(
    drawn: Mapping[str, Sequence[Comparison]], path: Path, order: Sequence[str]
) -> None:
    """Write the comparisons of figures, by the name of the figure, as Markdown.

    Figures stand in the given order. Where the file is there, it keeps the rows of those that
    were not drawn now.
    """
    rows = _rows_by_figure(path)
    for name, comparisons in drawn.items():
        rows[name] = [_row(name, comparison) for comparison in comparisons]
    lines = [
        '| figure | quantity | paper | corrected theory | measured here | error |',
        '| --- | --- | --- | --- | --- | --- |',
        *(row for name in order for row in rows.get(name, ())),
    ]
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')


def _rows_by_figure(path: Path) -> dict[str, list[str]]:
    """Rows of a table as they are, by their first cell."""
    rows: dict[str, list[str]] = {}
    if path.exists():
        for line in path.read_text(encoding='utf-8').splitlines():
            if line.startswith('| '):
                rows.setdefault(line.split('|')[1].strip(), []).append(line)
    return rows


def _row(name: str, comparison: Comparison) -> str:
    theory = str(comparison.theory)
    if math.isfinite(comparison.stated):
        theory = f'{theory} = {comparison.stated:.{_DIGITS}g}'
    cells = [
        name,
        comparison.quantity,
        str(comparison.paper),
        theory,
        f'{comparison.measured:.{_DIGITS}g}',
        comparison.error,
    ]
    return '| ' + ' | '.join(cell.replace('|', '∣') for cell in cells) + ' |'
