# SPDX-License-Identifier: Apache-2.0
"""Numbers that the collisions show: windows, critical speeds, and what changes them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from soliton_linkage_studies.collisions.runs import CollisionRun
from soliton_linkage_studies.collisions.study import Row, series_of

PHI4_SPEED = 0.2598
"""Critical speed of phi^4 theory over that of light [1] (Campbell, Schonfeld and Wingate 1983)."""
CRITICAL_SPEED = 'critical speed / c [1]'
"""Name of the speed above which walls part after one collision."""
_SHAPE_MODE = math.sqrt(3)
"""Frequency of the shape mode of a phi^4 wall over c / w [1]; w is a reach for d << 1."""
_FEWEST = 2
"""Neighbouring speeds with the same outcome that make a window [1]."""


@dataclass(frozen=True)
class BounceWindow:
    """Neighbouring speeds at which walls part after the same number of collisions."""

    collisions: int
    first: float
    last: float
    fastest: CollisionRun
    """The one that leaves with most of its speed."""

    @property
    def phase(self) -> float:
        """Cycles of the shape mode between the first two collisions [1]."""
        return _SHAPE_MODE * self.fastest.between / (2 * math.pi)


def escaped_after(row: Row) -> int | None:
    """Number of collisions after which walls parted as kink and anti-kink, or None."""
    run = row.run
    return run.collisions if run and run.escaped and not run.broken else None


def windows(rows: Sequence[Row]) -> list[BounceWindow]:
    """Windows of two collisions and more in a sweep, slowest first."""
    found: list[BounceWindow] = []
    group: list[Row] = []
    for row in [*rows, None]:
        after = escaped_after(row) if row else None
        if row and group and after == escaped_after(group[-1]):
            group.append(row)
            continue
        count = escaped_after(group[-1]) if group else None
        if count and count > 1 and len(group) >= _FEWEST:
            runs = [each.run for each in group if each.run]
            fastest = max(runs, key=lambda run: run.speed_after)
            found.append(BounceWindow(count, group[0].speed, group[-1].speed, fastest))
        group = [row] if row and after is not None else []
    return found


def finding_lines(rows: Sequence[Row]) -> list[str]:
    """Tables in Markdown: rings, windows, what changes them, and critical speeds."""
    variations = series_of(rows, 'variations')
    whole = [row for row in next(iter(variations.values()), []) if not row.name]
    return [
        *_sweep_lines(series_of(rows, 'sweeps')),
        '',
        *_window_lines(windows(whole)),
        '',
        *_variation_lines(variations),
        '',
        *_critical_lines(series_of(rows, 'critical_speeds')),
    ]


def _sweep_lines(series: dict[str, list[Row]]) -> list[str]:
    lines = [
        '| ring | collisions made | captured | anti-kink broken | largest share radiated '
        '| speed after over before | largest drift of the energy |',
        '| --- | --- | --- | --- | --- | --- | --- |',
    ]
    for name, rows in series.items():
        runs = [row.run for row in rows if row.run]
        if not runs:
            continue
        parted = [run for run in runs if run.escaped and not run.broken]
        kept = [run.speed_after / run.speed_before for run in parted]
        cells = [
            name,
            f'{len(runs)} of {len(rows)}',
            str(sum(not run.escaped and not run.broken for run in runs)),
            str(sum(run.broken for run in runs)),
            f'{max(run.radiated for run in runs):.3f}',
            f'{min(kept):.3f} to {max(kept):.3f}' if kept else '',
            f'{max(run.drift for run in runs):.1e}',
        ]
        lines.append(f'| {" | ".join(cells)} |')
    return lines


def _window_lines(found: Sequence[BounceWindow]) -> list[str]:
    return [
        '| collisions | v / c from | to | speed after / c | time between the first two [2 l / c] '
        '| in cycles of the shape mode |',
        '| --- | --- | --- | --- | --- | --- |',
        *(
            f'| {each.collisions} | {each.first:.4f} | {each.last:.4f} '
            f'| {each.fastest.speed_after:.4f} | {each.fastest.between:.2f} | {each.phase:.2f} |'
            for each in found
        ),
    ]


def _variation_lines(series: dict[str, list[Row]]) -> list[str]:
    """Share of the outcomes that stay, largest change of the speed afterwards, and the edges."""
    base = next(iter(series.values()), [])
    edges = [row.name for row in base if row.name]
    lines = [
        f'| changed | same outcome | largest change of v′ / c, of those | {" | ".join(edges)} |',
        f'| --- | --- | --- |{" --- |" * len(edges)}',
    ]
    for name, rows in series.items():
        pairs = [
            (one.run, other.run)
            for one, other in zip(base, rows, strict=True)
            if one.run and other.run and not one.name
        ]
        same = [pair for pair in pairs if _outcome(pair[0]) == _outcome(pair[1])]
        change = max((abs(a.speed_after - b.speed_after) for a, b in same), default=math.nan)
        found = [f'{row.speed:.5f}' if row.run else row.failure for row in rows if row.name]
        share = f'{len(same)} of {len(pairs)}'
        lines.append(f'| {name} | {share} | {change:.1e} | {" | ".join(found)} |')
    return lines


def _critical_lines(series: dict[str, list[Row]]) -> list[str]:
    """Critical speeds, and their limit d -> 0 by a parabola through the first two."""
    lines = [f'| rings | d | {CRITICAL_SPEED} |', '| --- | --- | --- |']
    for name, rows in series.items():
        found = [(float(row.name), row.speed) for row in rows if row.run]
        lines += [f'| {name} | {lean:g} | {speed:.4f} |' for lean, speed in found]
        if len(found) > 1:
            (d1, v1), (d2, v2) = found[:2]
            limit = v1 + (v1 - v2) * d1**2 / (d2**2 - d1**2)
            lines.append(f'| {name} | to 0, with d² | {limit:.4f} (phi⁴: {PHI4_SPEED:g}) |')
    return lines


def _outcome(run: CollisionRun) -> tuple[bool, int]:
    """What is compared: captured pairs are alike however often they overlapped."""
    return run.escaped, run.collisions if run.escaped else 0
