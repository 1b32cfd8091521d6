# SPDX-License-Identifier: Apache-2.0
"""Finished figures: the picture, the data in it, and what it says beside the paper."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

_RESOLUTION = 150
_DIGITS = 5


@dataclass(frozen=True)
class Comparison:
    """One quantity as the paper has it, as the corrected theory has it, and as measured."""

    quantity: str
    """What it is, with the chain that it is of and its unit."""
    paper: str
    """What the paper says, with its equation."""
    theory: str
    """What holds for the discrete chain."""
    measured: float
    """What the simulated chain does."""
    expected: float = math.nan
    """The theory as a number, where it is one."""

    @property
    def error(self) -> str:
        """Relative distance of the measured number from the theory's, in per cent."""
        if not math.isfinite(self.expected):
            return ''
        if self.expected == 0:
            return f'{self.measured:.1e}'
        return f'{100 * (self.measured / self.expected - 1):+.2g} %'


@dataclass
class Plate:
    """A figure in the making: panels to draw on, and the data that was drawn."""

    figure: Figure
    rows: list[tuple[str, str, float, float]] = field(default_factory=list)
    """Every point drawn, as (panel, series, x, y)."""
    comparisons: list[Comparison] = field(default_factory=list)

    def note(self, panel: str, series: str, x: ArrayLike, y: ArrayLike) -> None:
        """Keep points for the table of the figure, x and y of the same shape (K,)."""
        for across, up in zip(np.ravel(x), np.ravel(y), strict=True):
            self.rows.append((panel, series, float(across), float(up)))

    def compare(
        self, quantity: str, paper: str, theory: str, measured: float, expected: float = math.nan
    ) -> None:
        """Add a line to the table that sets paper, theory and measurement side by side."""
        self.comparisons.append(Comparison(quantity, paper, theory, measured, expected))

    def save(self, folder: Path, name: str) -> None:
        """Write the picture as PNG and PDF, and its data as CSV."""
        for suffix in ('png', 'pdf'):
            # Without a date the same data make the same file.
            metadata = {'CreationDate': None} if suffix == 'pdf' else None
            self.figure.savefig(folder / f'{name}.{suffix}', dpi=_RESOLUTION, metadata=metadata)
        with (folder / f'{name}.csv').open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(['panel', 'series', 'x', 'y'])
            writer.writerows(
                (panel, series, repr(x), repr(y)) for panel, series, x, y in self.rows
            )


def write_table(comparisons: Sequence[tuple[str, Comparison]], path: Path) -> None:
    """Write the comparisons of all figures, each with the name of its figure, as Markdown."""
    lines = [
        '| figure | quantity | paper | corrected theory | measured here | error |',
        '| --- | --- | --- | --- | --- | --- |',
    ]
    for name, comparison in comparisons:
        theory = comparison.theory
        if math.isfinite(comparison.expected):
            theory = f'{theory} = {comparison.expected:.{_DIGITS}g}'
        cells = [
            name,
            comparison.quantity,
            comparison.paper,
            theory,
            f'{comparison.measured:.{_DIGITS}g}',
            comparison.error,
        ]
        lines.append('| ' + ' | '.join(cell.replace('|', '∣') for cell in cells) + ' |')
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
