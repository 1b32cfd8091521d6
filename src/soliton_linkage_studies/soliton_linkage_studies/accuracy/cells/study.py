# SPDX-License-Identifier: Apache-2.0
"""The cells of a day as a table whose rows are measured one by one."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from soliton_linkage import estimation
from soliton_linkage_studies.accuracy.cells.cells import AccuracyCell, drawn_cells
from soliton_linkage_studies.accuracy.cells.hard_cells import hard_cells
from soliton_linkage_studies.accuracy.cells.runs import records
from soliton_linkage_studies.accuracy.cells.statistics import COLUMNS, line_of
from soliton_linkage_studies.program import chosen
from soliton_linkage_studies.settings import Section

GIVEN = (
    'class',
    'rotors',
    'rotor_length_ratio',
    'rest_angle',
    'd',
    'd_over_critical',
    'noise',
    'speed_wanted',
    'period',
    'run',
    'phonons',
    'walls',
)
"""Of a cell: noise [rad], speed over that of sound, period [time units], frames of a record,
phonons [rad / time unit]."""
_QUICK_FRAMES = 200
"""Of each cell in a quick study [1]."""
_QUICK_CELLS = 15
"""Of them drawn at random, five of a class [1]."""


@dataclass(frozen=True)
class CellStudy:
    """Cells drawn by a seed, and hard ones, of which some may be chosen by name."""

    seed: int
    count: int
    frames: int
    only: tuple[str, ...] = ()
    name: str = 'cells'

    @cached_property
    def all(self) -> list[AccuracyCell]:
        """The cells in the order of the rows."""
        known = [*drawn_cells(self.seed, self.count), *hard_cells()]
        names = chosen([cell.name for cell in known], self.only, '--cells')
        return [cell for cell in known if cell.name in names]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        return ('row', 'cell', *GIVEN, *COLUMNS, 'failure')

    @property
    def rows(self) -> int:
        """Number of cells."""
        return len(self.all)

    def cells(self, row: int) -> list[str]:
        """Measure a cell, as text; where it cannot be it says why."""
        cell = self.all[row]
        line: dict[str, float] = {}
        failure = ''
        # A seed of its own, whichever cells are chosen beside it.
        name = int.from_bytes(cell.name.encode(), 'big')
        random = np.random.default_rng([self.seed, name])
        try:
            line = line_of(list(records(cell, self.frames, random)))
        except (ArithmeticError, ValueError) as error:
            failure = ' '.join(str(error).split())
        measured = [_text(line.get(name, math.nan)) for name in COLUMNS]
        return [str(row), cell.name, *given_of(cell), *measured, failure]

    def described(self) -> dict[str, Any]:
        """All that the rows depend on, the estimator among it."""
        return {
            'seed': self.seed,
            'frames': self.frames,
            'cells': [cell.name for cell in self.all],
            'estimator': _fingerprint(),
        }


def read_cell_study(
    section: Section, quick: bool, seed: int, frames: int | None, only: Sequence[str]
) -> CellStudy:
    """Read the settings; raises ValueError for what cannot be studied."""
    section.allow('count', 'frames')
    count = section.whole_number('count', 0, 10_000)
    wanted = frames or section.whole_number('frames', 1, 10_000_000)
    if not quick:
        return CellStudy(seed, count, wanted, tuple(only))
    few = frames or min(wanted, _QUICK_FRAMES)
    return CellStudy(seed, min(count, _QUICK_CELLS), few, tuple(only), 'cells_quick')


def given_of(cell: AccuracyCell) -> list[str]:
    """`GIVEN` of a cell, as text."""
    chain = cell.chain
    numbers = (
        chain.rotor_length / chain.spacing,
        chain.rest_angle,
        chain.lean_ratio,
        chain.lean_ratio / chain.critical_lean_ratio,
        cell.noise,
        cell.speed,
        cell.period,
    )
    return [
        chain.motion.value,
        str(chain.number_of_rotors),
        *(f'{number:.6g}' for number in numbers),
        str(cell.run),
        f'{cell.phonons:.6g}',
        str(cell.walls),
    ]


def _text(number: float) -> str:
    return '' if math.isnan(number) else f'{number:.6g}'


def _fingerprint() -> str:
    """Of the sources of the estimator, so that no table is half of one and half of another."""
    found = hashlib.sha256()
    for folder in estimation.__path__:
        for path in sorted(Path(folder).rglob('*.py')):
            found.update(path.read_bytes())
    return found.hexdigest()[:16]
