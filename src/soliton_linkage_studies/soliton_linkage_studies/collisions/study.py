# SPDX-License-Identifier: Apache-2.0
"""Collision study: each collision or window edge in a settings file gives one row of a table.

A window is a range of speeds at which the walls escape after the same number of overlaps. The
walls overlap while no rotor leans left.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import groupby
from typing import Any

import numpy as np

from soliton_linkage.dynamics.integrators import INTEGRATORS
from soliton_linkage.linear.bands import penetration_depth
from soliton_linkage.linkage.chain import Chain
from soliton_linkage_studies.collisions.runs import Collision, CollisionRun
from soliton_linkage_studies.settings import Section
from soliton_linkage_studies.sweep.table import markdown_table

TURNING = ('back', 'onwards')
"""Whether the anti-kink turns the rotors of a spinner back, or onwards as the kink does."""
_SETTINGS = {
    'length': (30.0, 1000.0),
    'step': (1e-3, 2.0),
    'patience': (10.0, 1e5),
    'shift': (-1.0, 1.0),
}
"""Numeric settings of a collision, each with its smallest and its largest value."""
_HALVINGS = 13
"""Number of bisections in a full study [1]; they reduce a speed interval from 0.6 c to 1e-4 c."""
_FASTEST = 2.0
"""Largest speed in the settings [speed of sound]; flippers with d near 1 have supersonic walls."""


@dataclass(frozen=True)
class WindowEdge:
    """Search for an edge of the window in which walls escape after `collisions` overlaps."""

    collision: Collision
    collisions: int
    inside: float
    """Speed inside the window [speed of sound]."""
    outside: float
    """Speed outside the window [speed of sound]."""
    halvings: int

    def __call__(self) -> tuple[float, CollisionRun]:
        """Return the speed at the edge, and the run nearest to the edge inside the window.

        Raises ValueError unless the walls escape after `collisions` overlaps at the speed
        `inside`, but not at the speed `outside`.
        """
        inside, outside = self.inside, self.outside
        run = self._made(inside)
        for speed, wanted in ((inside, True), (outside, False)):
            if self._counts(run if wanted else self._made(outside)) is not wanted:
                raise ValueError(
                    f'at {speed:g} c walls {"do not" if wanted else "do"} escape after '
                    f'{self.collisions} collisions; give a speed at which they '
                    f'{"do" if wanted else "do not"}'
                )
        for _ in range(self.halvings):
            middle = (inside + outside) / 2
            tried = self._made(middle)
            if self._counts(tried):
                inside, run = middle, tried
            else:
                outside = middle
        return (inside + outside) / 2, run

    def _made(self, speed: float) -> CollisionRun:
        return replace(self.collision, speed=speed)()

    def _counts(self, run: CollisionRun) -> bool:
        return run.escaped and run.collisions == self.collisions and not run.broken


@dataclass(frozen=True)
class Entry:
    """Task that gives one row of the table."""

    part: str
    """Name of the part of the study, which is a key of the settings."""
    series: str
    """Name of the series to which the row belongs, as in the settings."""
    task: Collision | WindowEdge
    name: str = ''
    """Name of the window edge, or an empty text for a collision."""


@dataclass(frozen=True)
class CollisionStudy:
    """Collision study that a settings file describes; each entry gives one row of the table."""

    entries: tuple[Entry, ...]
    pictures: dict[str, Collision]
    """Collisions that are drawn as space-time diagrams, by title."""
    settings: dict[str, Any]
    """Settings on which the entries depend, as types that YAML can store."""
    name: str = 'runs'

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of the table."""
        run = (field.name for field in fields(CollisionRun))
        return ('row', 'part', 'series', 'name', 'rotors', 'speed', *run, 'failure')

    @property
    def rows(self) -> int:
        """Number of rows of the table."""
        return len(self.entries)

    def cells(self, row: int) -> list[str]:
        """Compute a row of the table as text; the last column is empty or an error message."""
        entry = self.entries[row]
        collision = entry.task if isinstance(entry.task, Collision) else entry.task.collision
        speed, values, failure = collision.speed, [''] * len(fields(CollisionRun)), ''
        try:
            if isinstance(entry.task, WindowEdge):
                speed, run = entry.task()
            else:
                run = entry.task()
            values = [repr(value) for value in asdict(run).values()]
        except (ArithmeticError, ValueError) as error:
            failure = ' '.join(str(error).split())
        rotors = str(collision.ring.number_of_rotors)
        labels = [entry.part, entry.series, entry.name, rotors, repr(speed)]
        return [str(row), *labels, *values, failure]

    def described(self) -> dict[str, Any]:
        """Return all settings on which the rows depend, as types that YAML can store."""
        return self.settings


@dataclass(frozen=True)
class Row:
    """Row of the table, parsed from text."""

    part: str
    series: str
    name: str
    speed: float
    """Speed of each wall, or speed at the window edge [speed of sound]."""
    run: CollisionRun | None
    """Outcome of the collision, or None if the simulation failed."""
    failure: str


def read_row(cells: Mapping[str, str]) -> Row:
    """Parse a row of the table; `cells` maps column names to text."""
    run = None
    if not cells['failure']:
        kinds: dict[str, Any] = {
            'bool': lambda text: text == 'True',
            'int': int,
            'float': float,
        }
        values = {one.name: kinds[str(one.type)](cells[one.name]) for one in fields(CollisionRun)}
        run = CollisionRun(**values)
    part, series, name = (cells[key] for key in ('part', 'series', 'name'))
    return Row(part, series, name, float(cells['speed']), run, cells['failure'])


def read_collision_study(settings: Section, quick: bool) -> CollisionStudy:
    """Read the study from its settings. Raises ValueError for invalid settings."""
    settings.check_keys('collision', 'sweeps', 'variations', 'critical_speeds', 'pictures')
    common = settings.section('collision')
    common.check_keys(*_SETTINGS)
    entries: list[Entry] = []
    for name, section in _named(settings, 'sweeps').items():
        section.check_keys('rotor_length_ratio', 'rest_angle', 'turning', 'speeds')
        collision = _collision(section, common)
        entries += _at_speeds('sweeps', name, collision, section, quick)
    entries += _variations(settings.section('variations'), common, quick)
    entries += _critical_speeds(settings.section('critical_speeds'), common, quick)
    pictures = {}
    for name, section in _named(settings, 'pictures').items():
        section.check_keys('rotor_length_ratio', 'rest_angle', 'turning', 'speed')
        speed = section.number('speed', 1e-3, _FASTEST)
        pictures[name] = replace(_collision(section, common), speed=speed)
    decisive = {key: value for key, value in settings.values.items() if key != 'pictures'}
    return CollisionStudy(tuple(entries), pictures, {**decisive, 'quick': quick})


def _named(settings: Section, key: str) -> dict[str, Section]:
    found = settings.sections(key)
    if not found:
        raise settings.error(key, 'is empty; give one or more named sections')
    return found


def _variations(section: Section, common: Section, quick: bool) -> list[Entry]:
    section.check_keys('rotor_length_ratio', 'rest_angle', 'speeds', 'changes', 'edges')
    entries = []
    for name, change in _named(section, 'changes').items():
        change.check_keys(*_SETTINGS, 'integrator')
        collision = _collision(section, common, change)
        entries += _at_speeds('variations', name, collision, section, quick)
        edges = {} if quick else section.sections('edges')
        for title, edge in edges.items():
            task = _edge(edge, collision, edge.whole_number('collisions', 1, 100), _HALVINGS)
            entries.append(Entry('variations', name, task, title))
    return entries


def _critical_speeds(section: Section, common: Section, quick: bool) -> list[Entry]:
    section.check_keys('rings', 'inside', 'outside')
    entries = []
    for name, rings in _named(section, 'rings').items():
        rings.check_keys('rotor_length_ratio', 'lean_ratios')
        ratio = rings.number('rotor_length_ratio', 1e-3, 1e3)
        wanted = rings.numbers('lean_ratios', 1e-3, min(2 * ratio, 1.0))
        for lean_ratio in wanted[-1:] if quick else wanted:
            collision = _task(common, ratio, math.asin(lean_ratio / (2 * ratio)))
            task = _edge(section, collision, 1, 2 if quick else _HALVINGS)
            entries.append(Entry('critical_speeds', name, task, f'{lean_ratio:g}'))
    return entries


def _edge(section: Section, collision: Collision, collisions: int, halvings: int) -> WindowEdge:
    inside, outside = (section.number(key, 1e-3, _FASTEST) for key in ('inside', 'outside'))
    return WindowEdge(collision, collisions, inside, outside, halvings)


def _collision(section: Section, common: Section, change: Section | None = None) -> Collision:
    ratio = section.number('rotor_length_ratio', 1e-3, 1e3)
    rest_angle = section.number('rest_angle', 1e-3, 1.57)
    onwards = section.text('turning', TURNING, TURNING[0]) == TURNING[1]
    return replace(_task(common, ratio, rest_angle, change), onwards=onwards)


def _task(
    common: Section, ratio: float, rest_angle: float, change: Section | None = None
) -> Collision:
    def number(key: str, default: float | None = None) -> float:
        value = common.number(key, *_SETTINGS[key], default)
        return value if change is None else change.number(key, *_SETTINGS[key], value)

    integrator = Collision.integrator
    if change is not None:
        integrator = change.text('integrator', tuple(INTEGRATORS), integrator)
    chain = Chain(2, 1.0, ratio, rest_angle, 1.0, 1.0)
    half = math.ceil(number('length') * penetration_depth(chain))
    ring = replace(chain, number_of_rotors=2 * half, periodic=True)
    step, shift, patience = number('step'), number('shift', 0.0), number('patience')
    return Collision(ring, 0.0, False, step, integrator, shift, patience)


def _at_speeds(
    part: str, series: str, collision: Collision, section: Section, quick: bool
) -> list[Entry]:
    given = section.section('speeds')
    given.check_keys('from', 'to', 'points')
    first, last = (given.number(end, 1e-3, _FASTEST) for end in ('from', 'to'))
    speeds = np.linspace(first, last, given.whole_number('points', 2, 100_000)).round(7)
    chosen = speeds[:: 40 if quick else 1].tolist()
    return [Entry(part, series, replace(collision, speed=speed)) for speed in chosen]


def series_of(rows: Sequence[Row], part: str) -> dict[str, list[Row]]:
    """Return the rows of one part of the study, grouped by series in their original order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row.part == part:
            found.setdefault(row.series, []).append(row)
    return found


PHI4_SPEED = 0.2598
"""Critical speed of phi^4 theory / c [1] (Campbell, Schonfeld and Wingate 1983)."""
CRITICAL_SPEED = 'critical speed / c [1]'
"""Label of the critical speed, above which walls separate after one overlap."""
_SHAPE_MODE = math.sqrt(3)
"""Angular frequency of the shape mode of a phi^4 wall of width w, divided by c / w [1]."""
_FEWEST = 2
"""Smallest number of adjacent speeds with the same outcome that count as a window [1]."""


@dataclass(frozen=True)
class BounceWindow:
    """Bounce window: adjacent speeds at which walls escape after the same number of overlaps."""

    collisions: int
    """Number of overlaps."""
    first: float
    """Smallest simulated speed in this window [speed of sound]."""
    last: float
    """Largest simulated speed in this window [speed of sound]."""
    fastest: CollisionRun
    """Run in this window with the largest speed of the escaping walls."""

    @property
    def phase(self) -> float:
        """Number of cycles of the shape mode between the first two overlaps of `fastest` [1]."""
        return _SHAPE_MODE * self.fastest.between / (2 * math.pi)


def escaped_after(row: Row) -> int | None:
    """Return the number of overlaps before both walls escaped intact, or None if they did not."""
    run = row.run
    return run.collisions if run and run.escaped and not run.broken else None


def windows(rows: Sequence[Row]) -> list[BounceWindow]:
    """Return the windows in which the walls escape after two or more overlaps.

    `rows` are sorted by speed, and the windows have the same order. A window contains at least two
    adjacent rows.
    """
    found: list[BounceWindow] = []
    for count, equal in groupby(rows, key=escaped_after):
        group = list(equal)
        if count and count > 1 and len(group) >= _FEWEST:
            runs = [each.run for each in group if each.run]
            fastest = max(runs, key=lambda run: run.speed_after)
            found.append(BounceWindow(count, group[0].speed, group[-1].speed, fastest))
    return found


_SWEEP_TITLES = (
    *('ring', 'collisions', 'captured', 'anti-kink broken', 'largest radiated fraction'),
    *('speed after / speed before', 'largest energy drift'),
)
_WINDOW_TITLES = (
    *('collisions', 'v / c from', 'to', 'speed after / c'),
    *('time between the first two [2 l / c]', 'in cycles of the shape mode'),
)


def finding_tables(rows: Sequence[Row]) -> str:
    """Return four Markdown tables: outcomes, windows, changed settings and critical speeds."""
    variations = series_of(rows, 'variations')
    whole = [row for row in next(iter(variations.values()), []) if not row.name]
    tables = _sweep_table(series_of(rows, 'sweeps')), _window_table(windows(whole))
    critical = _critical_table(series_of(rows, 'critical_speeds'))
    return '\n'.join([*tables, _variation_table(variations), critical])


def _sweep_table(series: dict[str, list[Row]]) -> str:
    lines = []
    for name, rows in series.items():
        runs = [row.run for row in rows if row.run]
        if not runs:
            continue
        parted = [run for run in runs if run.escaped and not run.broken]
        kept = [run.speed_after / run.speed_before for run in parted]
        captured = sum(not run.escaped and not run.broken for run in runs)
        counts = f'{len(runs)} of {len(rows)}', str(captured), str(sum(run.broken for run in runs))
        radiated, drift = (max(getattr(run, key) for run in runs) for key in ('radiated', 'drift'))
        ratio = f'{min(kept):.3f} to {max(kept):.3f}' if kept else ''
        lines.append([name, *counts, f'{radiated:.3f}', ratio, f'{drift:.1e}'])
    return markdown_table(_SWEEP_TITLES, lines)


def _window_table(found: Sequence[BounceWindow]) -> str:
    lines = []
    for each in found:
        speeds = [f'{one:.4f}' for one in (each.first, each.last, each.fastest.speed_after)]
        times = [f'{each.fastest.between:.2f}', f'{each.phase:.2f}']
        lines.append([str(each.collisions), *speeds, *times])
    return markdown_table(_WINDOW_TITLES, lines)


def _variation_table(series: dict[str, list[Row]]) -> str:
    base = next(iter(series.values()), [])
    edges = [row.name for row in base if row.name]
    change = 'largest change of v′ / c for the same outcome'
    titles = ['changed setting', 'same outcome', change, *edges]
    lines = []
    for name, rows in series.items():
        pairs = [
            (one.run, other.run)
            for one, other in zip(base, rows, strict=True)
            if one.run and other.run and not one.name
        ]
        same = [pair for pair in pairs if _outcome(pair[0]) == _outcome(pair[1])]
        largest = max((abs(a.speed_after - b.speed_after) for a, b in same), default=math.nan)
        found = [f'{row.speed:.5f}' if row.run else row.failure for row in rows if row.name]
        lines.append([name, f'{len(same)} of {len(pairs)}', f'{largest:.1e}', *found])
    return markdown_table(titles, lines)


def _critical_table(series: dict[str, list[Row]]) -> str:
    """Return a table of critical speeds, with limits d -> 0 (extrapolated linearly in d^2)."""
    lines = []
    for name, rows in series.items():
        found = [(float(row.name), row.speed) for row in rows if row.run]
        lines += [[name, f'{lean:g}', f'{speed:.4f}'] for lean, speed in found]
        if len(found) > 1:
            (d1, v1), (d2, v2) = found[:2]
            limit = v1 + (v1 - v2) * d1**2 / (d2**2 - d1**2)
            lines.append([name, 'to 0, with d²', f'{limit:.4f} (phi⁴: {PHI4_SPEED:g})'])
    return markdown_table(('rings', 'd', CRITICAL_SPEED), lines)


def _outcome(run: CollisionRun) -> tuple[bool, int]:
    return run.escaped, run.collisions if run.escaped else 0
