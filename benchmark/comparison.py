# SPDX-License-Identifier: Apache-2.0
"""What every part of the benchmark writes: comparisons, figures, one JSON and one table.

A part runs ours and a peer in turn, on the same work, in rounds, and hands over what each round
took. Ratios are taken within a round, as what else a machine does changes between them.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

PARTS = (
    'integrate',
    'publish',
    'rate',
    'analyse',
    'react',
    'record',
    'growth',
    'live',
    'identification',
)
"""In the order in which they run and stand in the table."""

_COMPARISON_HEAD = (
    '| peer | work | theirs | ours | ratio (spread) |\n| --- | --- | --- | --- | --- |'
)
_FIGURE_HEAD = '| what | measured (spread) | goal |\n| --- | --- | --- |'
_PREFIXES = ((1.0, ''), (1e-3, 'm'), (1e-6, 'µ'), (1e-9, 'n'))


@dataclass(frozen=True)
class Comparison:
    """The same work done by a peer and by us, a number a round of each.

    In seconds and other costs the ratio is theirs over ours; of what there is to be much of, such
    as messages a second, ours over theirs. It is above 1 where ours is better.
    """

    peer: str
    work: str
    unit: str
    theirs: Sequence[float]
    ours: Sequence[float]
    more_is_better: bool = False

    def ratios(self) -> list[float]:
        """How many times better ours is, a number a round, sorted."""
        pairs = zip(self.theirs, self.ours, strict=True)
        return sorted(o / t if self.more_is_better else t / o for t, o in pairs)

    def row(self) -> str:
        """Of the table; where one of the two could not do the work, it says so."""
        sides = [_shown(side, self.unit) for side in (self.theirs, self.ours)]
        ratio = _spread(self.ratios()) if self.theirs and self.ours else ''
        return f'| {self.peer} | {self.work} | {sides[0]} | {sides[1]} | {ratio} |'


@dataclass(frozen=True)
class Figure:
    """A quantity of ours that has a goal rather than a peer, a number a round."""

    what: str
    unit: str
    values: Sequence[float]
    goal: str = ''

    def row(self) -> str:
        """Of the table."""
        shown = _shown(self.values, self.unit)
        if len(self.values) > 1:
            ends = (_quantity(end(self.values), self.unit) for end in (min, max))
            shown += ' ({} to {})'.format(*ends)
        return f'| {self.what} | {shown} | {self.goal} |'


@dataclass(frozen=True)
class Part:
    """What a part of the benchmark found."""

    name: str
    comparisons: Sequence[Comparison] = ()
    figures: Sequence[Figure] = ()
    details: dict[str, Any] = field(default_factory=dict)
    """Whatever else the JSON is to keep."""

    def table(self) -> str:
        """The comparisons, then the figures."""
        parts = []
        if self.comparisons:
            parts.append('\n'.join([_COMPARISON_HEAD, *(each.row() for each in self.comparisons)]))
        if self.figures:
            parts.append('\n'.join([_FIGURE_HEAD, *(each.row() for each in self.figures)]))
        return '\n\n'.join(parts)


def parser(description: str | None) -> argparse.ArgumentParser:
    """Options that all parts have."""
    made = argparse.ArgumentParser(description=(description or '').partition('\n')[0])
    made.add_argument('--quick', action='store_true', help='small and short, to try it out')
    made.add_argument('--rounds', type=int, help='of ours and the peer in turn')
    made.add_argument('--output', type=Path, default=Path('out/benchmark.json'))
    return made


def write(part: Part, output: Path) -> None:
    """Put a part into the JSON beside the others, make the table anew, and show this part's."""
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
