# SPDX-License-Identifier: Apache-2.0
"""Report of the soak test: results, slopes with their errors, and a page with curves."""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from soak_records import Entry, Ledger

from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies.palette import BLACK, COLOURS, GREY, ORANGE, SKY

WARMING = 120.0
FEWEST = 4
SIGNIFICANT = 3.0
FLAT = {'memory': 10.0, 'threads': 1.0, 'descriptors': 1.0}
UNITS = {'memory': 'MB', 'threads': 'threads', 'descriptors': 'descriptors'}
MOST_LOST = 1.0
MEETING = 10.0
MOST_DRIFT = 1e-3
MOST_NAMED = 3
KILL_DAMAGE = ('it was not finished', 'the file ends within the chunk')
OUTCOMES = (
    *('reached', 'cancelled', 'preempted', 'out of chain', 'out of reach', 'no soliton'),
    *('soliton lost', 'not held', 'invalid speed'),
)
HEAD = '<!doctype html><meta charset="utf-8"><title>Soak test</title>'
STYLE = (
    '<style>body{font:16px/1.5 sans-serif;max-width:1000px;margin:2em auto;padding:0 1em}'
    'td,th{padding:.1em .8em;text-align:right}td:first-child,th:first-child{text-align:left}'
    'img{max-width:100%}.bad{color:#b00}</style>'
)
CAPTION = (
    'Curves against the time since the start, from top to bottom. Resident memory, threads and '
    'open files of each node. Real-time factor, with the missed deadlines of the simulator per '
    'sample (orange, right scale). Energy of the chain, with the residual of its energy balance '
    '(orange, right scale). Memory of the script of the live page in the browser. Grey lines are '
    'kills.'
)


class Slope(NamedTuple):
    """Growth per hour and its standard error."""

    value: float
    error: float

    @property
    def is_flat(self) -> bool:
        """Return whether the growth is insignificant."""
        return not self.value > SIGNIFICANT * self.error


def slope(lives: Sequence[tuple[Array, Array]]) -> Slope:
    """Return the common slope of values against times [s] in several runs of a process.

    Each run has a separate offset. The error takes the correlation of successive values into
    account.
    """
    times = np.concatenate([t - t.mean() for t, _ in lives] or [np.zeros(0)])
    values = np.concatenate([v - v.mean() for _, v in lives] or [np.zeros(0)])
    spread = float(times @ times)
    if len(times) < FEWEST or not spread:
        return Slope(math.nan, math.nan)
    growth = float(times @ values) / spread
    rest = values - growth * times
    power = float(rest @ rest)
    alike = min(max(float(rest[1:] @ rest[:-1]) / power, 0.0), 0.99) if power else 0.0
    freedom = max(len(times) - len(lives) - 1, 1)
    error = math.sqrt(power / freedom / spread * (1 + alike) / (1 - alike))
    return Slope(3600 * growth, 3600 * error)


def slope_of(ledger: Ledger, node: str, what: str) -> Slope:
    """Return the slope of a resource of a node, without the first minutes of each process."""
    begun = {entry['life']: entry['time'] for entry in ledger.of('start')}
    pairs = []
    for life, (times, values) in lives_of(ledger, node, what).items():
        warm = times > begun[life] + WARMING
        if warm.sum() >= FEWEST:
            pairs.append((times[warm], values[warm]))
    return slope(pairs)


def lives_of(ledger: Ledger, node: str, what: str) -> dict[int, tuple[Array, Array]]:
    """Return times [s] and values of a resource of a node, for each process."""
    lives: dict[int, list[tuple[float, float]]] = {}
    for entry in ledger.of('sample'):
        if entry['node'] == node:
            lives.setdefault(entry['life'], []).append((entry['time'], entry[what]))
    return {life: tuple(np.array(found).T) for life, found in lives.items()}


def nodes_of(ledger: Ledger) -> list[str]:
    """Return the nodes in the order of their first start."""
    return list(dict.fromkeys(entry['node'] for entry in ledger.of('start')))


def verdicts(ledger: Ledger) -> list[tuple[str, bool]]:
    """Return each result as a sentence, and whether the result is as expected."""
    kills, bags = ledger.of('kill'), ledger.of('bag')
    died, length = ledger.of('died'), ledger.entries[-1]['time'] if ledger.entries else 0.0
    drift = max((abs(e.get('energy drift', 0.0)) for e in ledger.of('report')), default=0.0)
    frames = sum(bag['messages'].get('/joint_states', 0) for bag in bags)
    tails = [tail_of(bag, kills) for bag in bags if bag['killed']]
    gaps = unexplained_gaps(bags, kills)
    damage = [
        line
        for bag in bags
        for line in bag['damage']
        if not (bag['killed'] and line.startswith(KILL_DAMAGE))
    ]
    lost = sum(bag['lost'] for bag in bags)
    sent, recorded, excused = nudges_of(ledger)
    tail, shown = max(tails, default=0), '; '.join(damage[:MOST_NAMED])
    unrecorded = f'{excused} while no recorder was running'
    named = '; '.join(f'{e["node"]} at {e["time"]:.0f} s' for e in died[:MOST_NAMED])
    results = [
        (f'{length / 60:.1f} minutes, {len(kills)} kills', True),
        (f'{len(died)} nodes ended unexpectedly {named}'.rstrip(), not died),
        (f'{frames} frames recorded, {len(gaps)} gaps that no kill explains', not gaps),
        (f'{lost} lost messages reported by recorders', not lost),
        (f'killed recorders lost at most {tail:.3f} s, {len(tails)} kills', tail < MOST_LOST),
        (
            f'{len(damage)} damaged parts of bags that no kill explains {shown}'.rstrip(),
            not damage,
        ),
        (f'{recorded} of {sent} nudges recorded, {unrecorded}', recorded >= sent - excused),
        (f'energy drift {drift:.2g} at most', drift < MOST_DRIFT),
        (moves_of(ledger), True),
    ]
    for node in nodes_of(ledger):
        for what, flat in FLAT.items():
            grown = slope_of(ledger, node, what)
            growth = f'{grown.value:+.2f} ± {grown.error:.2f} {UNITS[what]}/h'
            good = grown.is_flat or grown.value < flat
            results.append((f'{what} of {node}: {growth}', good))
    return results


def tail_of(bag: Entry, kills: Sequence[Entry]) -> float:
    """Return the time [s] from the last frame of a recorder to its kill; 0 without frames."""
    at = next(k['time'] for k in kills if k['life'] == bag['life'])
    away = any(
        k['node'] == 'simulator' and k['time'] - MOST_LOST < bag['last'] < k['time'] + MEETING
        for k in kills
    )
    return 0.0 if away else max(0.0, at - bag['last'])


def unexplained_gaps(bags: Sequence[Entry], kills: Sequence[Entry]) -> list[list[float]]:
    """Return the gaps between frames during which no simulator was killed."""
    killed = [kill['time'] for kill in kills if kill['node'] == 'simulator']
    return [
        gap
        for bag in bags
        for gap in bag['gaps']
        if not any(gap[0] - MOST_LOST <= at <= gap[1] + MOST_LOST for at in killed)
    ]


def nudges_of(ledger: Ledger) -> tuple[int, int, int]:
    """Return numbers of nudges: sent, recorded, and sent while no recorder was running."""
    sent = [entry['time'] for entry in ledger.of('nudge')]
    recorded = sum(bag['messages'].get('/nudge', 0) for bag in ledger.of('bag'))
    begun = [e['time'] for e in ledger.of('start') if e['node'] == 'bag_recorder']
    excused = sum(any(at - MOST_LOST <= t <= at + MEETING for at in begun) for t in sent)
    return len(sent), recorded, excused


def moves_of(ledger: Ledger) -> str:
    """Return a sentence about the results of the moves."""
    ended = [OUTCOMES[entry['outcome']] for entry in ledger.of('moved')]
    counts = ', '.join(f'{ended.count(name)} {name}' for name in dict.fromkeys(ended))
    return f'{len(ledger.of("move"))} moves requested: {counts or "none ended"}'


def write_page(folder: Path, ledger: Ledger) -> Path:
    """Write the report page."""
    picture = io.BytesIO()
    drawn(ledger).savefig(picture, format='png', dpi=110)
    data = base64.b64encode(picture.getvalue()).decode()
    lines = [
        f'<li{"" if good else " class=bad"}>{html.escape(line)}' for line, good in verdicts(ledger)
    ]
    page = folder / 'soak.html'
    page.write_text(
        f'{HEAD}{STYLE}<h1>Soak test of the suite</h1><ul>{"".join(lines)}</ul>'
        f'<img alt="curves of the test" src="data:image/png;base64,{data}"><p>{CAPTION}</p>',
        encoding='utf-8',
    )
    return page


def drawn(ledger: Ledger) -> Figure:
    """Return the figure with the curves."""
    figure = Figure(figsize=(10, 14), layout='constrained')
    axes = figure.subplots(6, 1, sharex=True)
    colours = [*COLOURS, ORANGE, SKY]
    for ax, what in zip(axes, FLAT, strict=False):
        for number, node in enumerate(nodes_of(ledger)):
            colour = colours[number % len(colours)]
            for times, values in lives_of(ledger, node, what).values():
                ax.plot(times / 60, values, color=colour, lw=1)
            ax.plot([], [], color=colour, label=node)
        ax.set_ylabel('memory [MB]' if what == 'memory' else f'{what} [1]')
    axes[0].legend(ncols=4, loc='lower left', fontsize='small')
    _draw_two(axes[3], ledger, 'real-time factor', 'missed deadlines')
    _draw_two(axes[4], ledger, 'energy [J]', 'energy drift')
    pages = ledger.of('page')
    heaps = [[e['time'] / 60 for e in pages], [e['heap'] for e in pages]]
    axes[5].plot(*heaps, color=BLACK, marker='.')
    axes[5].set(ylabel='live page [MB]', xlabel='time [min]')
    for ax in axes:
        for kill in ledger.of('kill'):
            ax.axvline(kill['time'] / 60, color=GREY, lw=0.5, alpha=0.5)
    return figure


def _draw_two(ax: Axes, ledger: Ledger, left: str, right: str) -> None:
    reports = [e for e in ledger.of('report') if left in e and right in e]
    times = [e['time'] / 60 for e in reports]
    values = [e[right] for e in reports]
    if right == 'missed deadlines':
        values = [max(0.0, grown) for grown in np.diff(values, prepend=0.0)]
    ax.plot(times, [e[left] for e in reports], color=BLACK, lw=1)
    ax.set_ylabel(left if '[' in left else f'{left} [1]')
    other = ax.twinx()
    other.plot(times, values, color=ORANGE, lw=1)
    other.set_ylabel(f'{right} [1]', color=ORANGE)
