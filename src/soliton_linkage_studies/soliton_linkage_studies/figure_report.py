# SPDX-License-Identifier: Apache-2.0
"""Figure reports: a figure, its caption, its data and a comparison of results with the paper."""

from __future__ import annotations

import csv
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from soliton_linkage.linear.bands import couplings
from soliton_linkage.linkage.chain import Chain

_DIGITS = 5
"""Number of significant digits in a table [1]."""
_FUNCTIONS = ('sin', 'cos', 'ln', 'min', 'max')
_ROUNDING = 1e-11
"""Smaller errors are rounding errors and written as 0 in a table [1]."""


@dataclass(frozen=True)
class Formula:
    """Formula for a table, its value, and the values of its symbols."""

    text: str
    value: float
    symbols: Mapping[str, float] = field(default_factory=dict)
    remark: str = ''
    """Note that is printed in parentheses after the formula."""

    def __str__(self) -> str:
        symbols = ', '.join(f'{name} = {value:.8g}' for name, value in self.symbols.items())
        remark = f' ({self.remark})' if self.remark else ''
        return f'{self.text} = {self.value:.5g}{f" for {symbols}" if symbols else ""}{remark}'


def chain_formula(
    text: str, value: float, chain: Chain, remark: str = '', **more: float
) -> Formula:
    """Return a formula; the values of the symbols in `text` are taken from `chain` and `more`."""
    plus, minus = couplings(chain)
    symbols = {
        'r': chain.rotor_length,
        'a': chain.spacing,
        'θ̄': chain.rest_angle,
        'l̄': chain.rest_length,
        'ū': chain.rotor_length * math.sin(chain.rest_angle),
        'd': chain.lean_ratio,
        'q₊': plus,
        'q₋': minus,
        **more,
    }
    words = re.findall('|'.join([*_FUNCTIONS, *sorted(symbols, key=len, reverse=True)]), text)
    return Formula(text, value, {name: symbols[name] for name in symbols if name in words}, remark)


@dataclass(frozen=True)
class Comparison:
    """Values of one quantity from the paper, from theory and from the simulation.

    The theory does not contain the errors of the paper that docs/physics.md lists.
    """

    quantity: str
    """Name of the quantity, with the chain and the unit."""
    paper: str | Formula
    """Value or formula from the paper, with the equation number."""
    theory: str | Formula
    """Formula for the discrete chain, or a text that names the source of the value `stated`."""
    measured: float
    """Value measured on the simulated chain."""
    stated: float = math.nan
    """Theoretical value if `theory` is a text; NaN if no value is known."""

    @property
    def expected(self) -> float:
        """Theoretical value: `theory.value` if `theory` is a formula, otherwise `stated`."""
        return self.theory.value if isinstance(self.theory, Formula) else self.stated

    @property
    def error(self) -> str:
        """Relative difference between measured value and theory [%], as a text.

        If the theoretical value is 0, the text is the measured value; without theory, it is empty.
        """
        if not math.isfinite(self.expected):
            return ''
        if self.expected == 0:
            return f'{self.measured:.1e}' if abs(self.measured) > _ROUNDING else '0'
        error = self.measured / self.expected - 1
        return f'{100 * error:+.2g} %' if abs(error) > _ROUNDING else '0 %'


@dataclass
class FigureReport:
    """Figure with its caption, its drawn points (`rows`), and its comparisons for a table."""

    figure: Figure
    caption: str
    """Description of the figure, and of the symbols, lines and colours that its legend omits."""
    rows: list[tuple[str, str, float, float, str, str]] = field(default_factory=list)
    """Drawn points, as (panel, series, x, y, x_name, y_name)."""
    comparisons: list[Comparison] = field(default_factory=list)

    def add_points(
        self, panel: str, series: str, names: tuple[str, str], x: ArrayLike, y: ArrayLike
    ) -> None:
        """Add drawn points to `rows`; `names` are the names of x and y, with their units."""
        for across, up in zip(np.ravel(x), np.ravel(y), strict=True):
            self.rows.append((panel, series, float(across), float(up), *names))

    def plot(
        self,
        axes: Axes,
        where: tuple[str, str],
        names: tuple[str, str],
        x: ArrayLike,
        y: ArrayLike,
        form: str = '-',
        **style: Any,
    ) -> None:
        """Plot points with `Axes.plot` and add them to `rows`; `where` names panel and series."""
        axes.plot(x, y, form, **style)
        self.add_points(*where, names, x, y)

    def add_comparison(
        self,
        quantity: str,
        paper: str | Formula,
        theory: str | Formula,
        measured: float,
        stated: float = math.nan,
    ) -> None:
        """Add a row to the table that compares the paper, the theory and the simulation."""
        self.comparisons.append(Comparison(quantity, paper, theory, measured, stated))

    def save(self, folder: Path, name: str) -> None:
        """Write the figure as PNG and PDF, the caption as a text file and `rows` as CSV."""
        save_pictures(self.figure, folder, name)
        save_caption(self.caption, folder / f'{name}.txt')
        with (folder / f'{name}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(['panel', 'series', 'x', 'y', 'x_name', 'y_name'])
            writer.writerows(
                (panel, series, repr(x), repr(y), *names)
                for panel, series, x, y, *names in self.rows
            )


def new_report(caption: str, width: float, height: float) -> FigureReport:
    """Return a report with an empty figure of a width and a height [inches]."""
    return FigureReport(Figure(figsize=(width, height), layout='constrained'), caption)


def save_page(report: FigureReport, folder: Path, name: str, table: str = 'table.md') -> str:
    """Save a report and its table of comparisons; return a text with the table and folder."""
    report.save(folder, name)
    write_table({name: report.comparisons}, folder / table, [name])
    table = (folder / table).read_text(encoding='utf-8')
    return f'{table}\npage and table are in {folder}'


def save_pictures(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG and PDF with the same layout, and return the paths."""
    paths = [folder / f'{name}.{suffix}' for suffix in ('png', 'pdf')]
    for path in paths:
        save_figure(figure, path)
        # To compute the layout takes as long as to draw.
        figure.set_layout_engine('none')
    return paths


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the path's suffix; equal figures give equal files."""
    metadata = {'CreationDate': None} if path.suffix == '.pdf' else None
    figure.savefig(path, dpi=150, metadata=metadata)


def save_caption(caption: str, path: Path) -> None:
    """Write a caption as Markdown with wrapped lines. Raises ValueError for an empty caption."""
    paragraphs = [' '.join(each.split()) for each in re.split(r'\n\s*\n', caption.strip())]
    if not any(paragraphs):
        raise ValueError(f'{path.stem} has no caption; describe its content and its colours')
    text = '\n\n'.join(textwrap.fill(each, 95) for each in paragraphs)
    path.write_text(f'{text}\n', encoding='utf-8')


def write_table(
    drawn: Mapping[str, Sequence[Comparison]], path: Path, order: Sequence[str]
) -> None:
    """Write a Markdown table of the comparisons in `drawn`, whose keys are figure names.

    If the file exists, its rows of other figures remain. The table contains only the figures in
    `order`, in this order.
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
    measured = f'{comparison.measured:.{_DIGITS}g}'
    cells = name, comparison.quantity, str(comparison.paper), theory, measured, comparison.error
    return '| ' + ' | '.join(cell.replace('|', '∣') for cell in cells) + ' |'
