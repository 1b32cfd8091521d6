# SPDX-License-Identifier: Apache-2.0
"""What is measured of each of many bags, as rows of a table that survives interruptions."""

from __future__ import annotations

import csv
import io
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.messages.chain_source import chain_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime.stamps import SECOND
from soliton_linkage_studies.sweep.table import Table, read_rows
from soliton_linkage_studies.workers import Pool, cluster, local_processes, measure_rows

_STATES = 'soliton_state.csv'
COLUMNS = (
    'number',
    'bag',
    'motion',
    'frames',
    'duration [s]',
    'frames tracked',
    'frames with a soliton',
    'largest speed [m/s]',
    'mean noise [rad]',
    'failure',
)


@dataclass(frozen=True)
class ManyBags:
    """Bags by the name of the folder of each, and how they are analysed."""

    bags: tuple[tuple[str, Path], ...]
    folder: Path
    analyse: Callable[[Path, Path, NamedChain | None, float | None], int]
    """Writes the states of a bag, given with its folder, chain and noise [rad]."""
    chain: Path | None = None
    noise: float | None = None
    name: str = 'bags'
    columns: tuple[str, ...] = field(default=COLUMNS)

    @property
    def rows(self) -> int:
        """How many bags there are."""
        return len(self.bags)

    def described(self) -> dict[str, Any]:
        """What decides the rows."""
        return {
            'bags': [str(bag) for _, bag in self.bags],
            'chain': str(self.chain) if self.chain else None,
            'noise': self.noise,
        }

    def cells(self, row: int) -> list[str]:
        """Analyse a bag into its folder, and return what its row holds."""
        name, bag = self.bags[row]
        given = chain_of_file(self.chain) if self.chain else None
        try:
            # Processes side by side would write over each other's lines.
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                measured = self._measured(name, bag, given)
            failure = ''
        except (ArithmeticError, OSError, ValueError) as error:
            measured, failure = [''] * (len(COLUMNS) - 3), ' '.join(str(error).split())
        return [str(row), str(bag), *measured, failure]

    def _measured(self, name: str, bag: Path, given: NamedChain | None) -> list[str]:
        folder = self.folder / name
        self.analyse(bag, folder, given, self.noise)
        with (folder / _STATES).open(encoding='utf-8', newline='') as file:
            return summary(csv.DictReader(file))


def summary(states: Iterable[dict[str, str]]) -> list[str]:
    """Cells from the motion on, of the rows of a table of states."""
    motions: Counter[str] = Counter()
    stamps: list[int] = []
    tracked = seen = 0
    fastest, noise = 0.0, 0.0
    for state in states:
        stamps.append(int(state['stamp [ns]']))
        motions[state['motion_name']] += 1
        tracked += int(state['status']) == SolitonState.TRACKING
        velocity = float(state['soliton_velocity [m/s]'])
        seen += int(state['solitons']) > 0
        fastest = fastest if math.isnan(velocity) else max(fastest, abs(velocity))
        noise += float(state['noise [rad]'])
    duration = (stamps[-1] - stamps[0]) / SECOND
    (motion, _), *_ = motions.most_common(1)
    means = (f'{fastest:.6g}', f'{noise / len(stamps):.6g}')
    return [motion, str(len(stamps)), f'{duration:.6g}', str(tracked), str(seen), *means]


def named_bags(paths: Sequence[Path]) -> tuple[tuple[str, Path], ...]:
    """Bags with names that are different; those of one name have that of their folder before it.

    Raises ValueError where one is given twice.
    """
    bags = [path.resolve() for path in paths]
    twice = [str(bag) for bag, count in Counter(bags).items() if count > 1]
    if twice:
        raise ValueError(f'bag {twice[0]} is given twice; give each once')
    names = Counter(bag.name for bag in bags)
    common = Path(os.path.commonpath(bags))
    return tuple(
        (bag.name if names[bag.name] == 1 else '_'.join(bag.relative_to(common).parts), bag)
        for bag in bags
    )


def analyse_many(study: ManyBags, workers: int, scheduler: str | None = None) -> int:
    """Analyse the bags that are not in the table yet; return how many could not be.

    Where a process has ended, others go on with what is left, as long as there is progress.
    """
    with Table(study, study.folder) as table:
        while missing := table.missing:
            ready = cluster(scheduler) if scheduler else local_processes(workers)
            try:
                with ready as pool:
                    _fill(study, table, pool)
            except ChildProcessError as error:
                if table.missing == missing:
                    raise
                print(f'analyse_bag: {error}; others go on', file=sys.stderr)
        table.finish()
    failed = [row for row in read_rows(table.path) if row['failure']]
    for row in failed:
        print(f'{row["bag"]}: {row["failure"]}', file=sys.stderr)
    print(f'{study.rows - len(failed)} of {study.rows} bags in {table.path}')
    return len(failed)


def _fill(study: ManyBags, table: Table, pool: Pool) -> None:
    line = ProgressLine('analysing', study.rows)
    for cells in measure_rows(pool, study, table.missing):
        table.append(cells)
        done = study.rows - len(table.missing)
        line.show(done, f'{done} of {study.rows} bags')
    line.clear()
