# SPDX-License-Identifier: Apache-2.0
"""Which cells are worse than in an earlier table of the same cells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from soliton_linkage_studies.accuracy.cells.study import GIVEN, CellStudy, given_of

_TRUE = (0.95, 1.05)
"""Root mean squares of normalised errors that are as they should be."""
_SIGNIFICANT = 3.0
"""Standard errors from which on a difference is no chance: 1 in 400."""
_UNKNOWN = 0.3
"""Standard error, relative, of what one record tells."""
_LARGER = 1.1
"""Ratio of errors from which on they are larger."""
_BELIEVED = 2.0
"""Root mean square of normalised errors up to which a place is better stated than not [1]."""
_FEWER = 0.01
"""Share of walls that were lost, and are found now, from which on errors are of other walls."""
_FAILURES = ('lost', 'false', 'wrong_leg')
_ERRORS = ('place_rms', 'place_rms_error', 'rate_rms', 'rate_rms_error', 'error_rms')
_COMPARED = (*_ERRORS, *_FAILURES, 'frames', 'failure', 'place_beyond_4', 'walls_looked_for')

Row = Mapping[str, str]


def check_comparable(study: CellStudy, earlier: Sequence[Row]) -> None:
    """Raise ValueError where no cell of a study is in an earlier table, or it is none of cells."""
    if not earlier or not {'cell', *GIVEN, *_COMPARED} <= earlier[0].keys():
        raise ValueError('what to compare with is no table of cells; give a cells.csv')
    known = {_key(row) for row in earlier}
    if known.isdisjoint((cell.name, *given_of(cell)) for cell in study.all):
        raise ValueError(
            f'no cell of seed {study.seed} is in the earlier table; give the --seed of that one'
        )


def worse_cells(rows: Sequence[Row], earlier: Sequence[Row]) -> list[str]:
    """How many cells that are in both tables are worse, and a line for each that says in what."""
    before = {_key(row): row for row in earlier}
    both = [(row, before[_key(row)]) for row in rows if _key(row) in before]
    said = [
        f'{row["cell"]} ({row["class"]}): {"; ".join(what)}'
        for row, old in both
        if (what := _worse(row, old))
    ]
    return [f'{len(said)} of {len(both)} cells are worse', *said]


def _key(row: Row) -> tuple[str, ...]:
    return row['cell'], *(row[name] for name in GIVEN)


def _worse(row: Row, old: Row) -> list[str]:
    what = [row['failure']] if row['failure'] and not old['failure'] else []
    believed = _number(old['place_rms']) < _BELIEVED
    for name in ('place', 'rate'):
        what += _less_true(name, row, old, believed)
    now, was = _number(row['error_rms']), _number(old['error_rms'])
    if believed and now > _LARGER * was and not _share(old, 'lost') > _share(row, 'lost') + _FEWER:
        what.append(f'error {now:.3g} after {was:.3g} spacings')
    return what + [each for name in _FAILURES for each in _more_failures(name, row, old)]


def _less_true(name: str, row: Row, old: Row, believed: bool) -> list[str]:
    """Whether stated deviations of place or rate are further from the errors."""
    now, was = _number(row[f'{name}_rms']), _number(old[f'{name}_rms'])
    if math.isnan(now):
        return [f'states no {name}'] if believed and was > 0 else []
    chance = math.hypot(
        _number(row[f'{name}_rms_error']) / now, _number(old[f'{name}_rms_error']) / was
    )
    if _off(now) - _off(was) > _SIGNIFICANT * (chance if math.isfinite(chance) else _UNKNOWN):
        return [f'{name} rms {now:.3g} after {was:.3g}']
    return []


def _more_failures(name: str, row: Row, old: Row) -> list[str]:
    """Whether there are more failures than chance makes; a wall is lost where it is misplaced."""
    share, earlier = _share(row, name), _share(old, name)
    misplaced = _misplaced(row), _misplaced(old)
    if name == 'lost' and math.isfinite(sum(misplaced)):
        share, earlier = share + misplaced[0], earlier + misplaced[1]
    frames = (_number(row['frames']), _number(old['frames']))
    both = (share * frames[0] + earlier * frames[1]) / sum(frames)
    chance = math.sqrt(max(both, 1 / sum(frames)) * sum(1 / each for each in frames))
    if share - earlier > _SIGNIFICANT * chance:
        return [f'{name} in {100 * share:.2g} % after {100 * earlier:.2g} %']
    return []


def _misplaced(row: Row) -> float:
    """Share of the frames in which a wall is more than four stated deviations off."""
    found = _number(row['walls_looked_for']) - _number(row['lost'])
    if not found:
        return 0.0
    return _number(row['place_beyond_4']) / 100 * found / max(_number(row['frames']), 1.0)


def _off(rms: float) -> float:
    """How far a root mean square is from what it should be, as a logarithm."""
    if not rms > 0:
        return 0.0
    low, high = _TRUE
    return max(math.log(rms / high), math.log(low / rms), 0.0)


def _share(row: Row, name: str) -> float:
    return _number(row[name]) / max(_number(row['frames']), 1.0)


def _number(text: str) -> float:
    return float(text) if text else math.nan
