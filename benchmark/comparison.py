# SPDX-License-Identifier: Apache-2.0
"""Results of the parts of the benchmark: comparisons and figures, written as JSON and a table.

A part runs our program and a peer (another tool) in turn on the same work. Ratios are computed
within a round, because the load of the machine changes between rounds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from soliton_linkage.progress import ProgressLine

Item = TypeVar('Item')

PARTS = (
    'integrate',
    'ensemble',
    'publish',
    'rate',
    'analyse',
    'react',
    'record',
    'growth',
    'live',
    'identification',
)
"""Names of the parts, in the order of execution and of the table."""

_COMPARISON_HEAD = (
    '| peer | work | theirs | ours | ratio (spread) |\n| --- | --- | --- | --- | --- |'
)
_FIGURE_HEAD = '| quantity | measured (spread) | goal |\n| --- | --- | --- |'
_PREFIXES = ((1.0, ''), (1e-3, 'm'), (1e-6, 'µ'), (1e-9, 'n'))


@dataclass(frozen=True)
class Comparison:
    """Same work done by a peer and by our program; each has one number per round.

    The ratio is above 1 if our program is better: theirs / ours for costs, ours / theirs for
    quantities that should be large.
    """

    peer: str
    work: str
    unit: str
    theirs: Sequence[float]
    ours: Sequence[float]
    more_is_better: bool = False

    def ratios(self) -> list[float]:
        """Return the ratio of each round, sorted."""
        pairs = zip(self.theirs, self.ours, strict=True)
        return sorted(o / t if self.more_is_better else t / o for t, o in pairs)

    def row(self) -> str:
        """Return the row of the table; `not reached` marks a program that failed."""
        sides = [_shown(side, self.unit) for side in (self.theirs, self.ours)]
        ratio = _spread(self.ratios()) if self.theirs and self.ours else ''
        return f'| {self.peer} | {self.work} | {sides[0]} | {sides[1]} | {ratio} |'


@dataclass(frozen=True)
class Figure:
    """Quantity that is compared with a goal instead of a peer; it has one number per round."""

    what: str
    unit: str
    values: Sequence[float]
    goal: str = ''

    def row(self) -> str:
        """Return the row of the table."""
        shown = _shown(self.values, self.unit)
        if len(self.values) > 1:
            ends = (_quantity(end(self.values), self.unit) for end in (min, max))
            shown += ' ({} to {})'.format(*ends)
        return f'| {self.what} | {shown} | {self.goal} |'


@dataclass(frozen=True)
class Part:
    """Results of a part of the benchmark."""

    name: str
    comparisons: Sequence[Comparison] = ()
    figures: Sequence[Figure] = ()
    details: dict[str, Any] = field(default_factory=dict)
    """Further content of the JSON file."""

    def table(self) -> str:
        """Return the comparisons followed by the figures, as Markdown."""
        parts = []
        if self.comparisons:
            parts.append('\n'.join([_COMPARISON_HEAD, *(each.row() for each in self.comparisons)]))
        if self.figures:
            parts.append('\n'.join([_FIGURE_HEAD, *(each.row() for each in self.figures)]))
        return '\n\n'.join(parts)


def parse(made: argparse.ArgumentParser, **choices: tuple[Any, Any]) -> argparse.Namespace:
    """Parse the command line; `choices` are the values of absent options, quick ones first."""
    options = made.parse_args()
    for name, (quick, usual) in choices.items():
        setattr(options, name, getattr(options, name, None) or (quick if options.quick else usual))
    return options


def parser(description: str | None) -> argparse.ArgumentParser:
    """Return a parser with the options of all parts."""
    made = argparse.ArgumentParser(description=(description or '').partition('\n')[0])
    made.add_argument('--quick', action='store_true', help='small and short, for a first test')
    about = 'number of rounds; in each, our program and the peer run once'
    made.add_argument('--rounds', type=int, help=about)
    made.add_argument('--output', type=Path, default=Path('out/benchmark.json'))
    return made


def tracked(items: Iterable[Item], title: str, ended: str = '{} done') -> Iterator[Item]:
    """Yield items and show the progress; `ended` is the final remark, with their number."""
    listed = list(items)
    progress = ProgressLine(title, len(listed))
    for number, item in enumerate(listed):
        progress.show(number)
        yield item
    progress.end(f'{title}: {ended.format(len(listed))}')


def write(part: Part, output: Path) -> None:
    """Add a part to the JSON file, rewrite the table, and print the table of this part."""
    stored = json.loads(output.read_text(encoding='utf-8')) if output.exists() else {}
    stored[part.name] = {**asdict(part), 'table': part.table()}
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps(stored, indent=2) + '\n', encoding='utf-8')
    tables = [f'## {name}\n\n{stored[name]["table"]}\n' for name in PARTS if name in stored]
    table = output.with_suffix('.md')
    table.write_text('\n'.join(tables), encoding='utf-8')
    sys.stdout.write(f'{part.table()}\n\nwritten to {output} and {table}\n')


def _shown(values: Sequence[float], unit: str) -> str:
    return _quantity(statistics.median(values), unit) if values else 'not reached'


def _spread(sorted_values: Sequence[float]) -> str:
    median = statistics.median(sorted_values)
    return f'{median:.3g} ({sorted_values[0]:.3g} to {sorted_values[-1]:.3g})'


def _quantity(value: float, unit: str) -> str:
    if unit != 's' or value == 0:
        return f'{value:.4g} {unit}'.rstrip()
    scale, prefix = next((p for p in _PREFIXES if abs(value) >= p[0]), _PREFIXES[-1])
    return f'{value / scale:.3g} {prefix}s'
