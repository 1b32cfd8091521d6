# SPDX-License-Identifier: Apache-2.0
"""Statistics of the errors in test cells, and comparison of two tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies.accuracy.cells import CELL_COLUMNS, AccuracyCell, cell_values

_FAILURES = ('lost', 'false', 'wrong_leg')
COLUMNS = (
    *('speed', 'frames', 'walls_looked_for', 'position_rms', 'position_rms_error', 'position_99'),
    *('position_max', 'position_beyond_4', 'position_coverage_1', 'position_coverage_2'),
    *('position_bias', 'instant_rms', 'rate_rms', 'rate_rms_error', 'rate_99', 'rate_beyond_4'),
    *('rate_coverage_1', 'rate_coverage_2', 'rate_bias', 'kinetic_rms', 'error_rms'),
    *('deviation_median', 'shift_max', *_FAILURES),
)
"""Columns that are measured for a test cell (`AccuracyCell`). `speed` is the speed of the fastest
wall [speed of sound]. Columns that begin with `position`, `rate` or `kinetic` are statistics of
the error of wall position, wall velocity or kinetic energy, divided by its stated standard
deviation. `instant_rms` uses the wall position without an average over time. `rms` is the root
mean square and `rms_error` its standard error. `99` and `max` are the 99 % quantile and the
maximum of the absolute value. `beyond_4`, `coverage_1` and `coverage_2` are the fractions of
absolute values above 4, below 1 and below 2 [%]. `bias` is the mean. `error_rms` is the rms
position error and `deviation_median` the median of its stated standard deviation [rotor spacings].
`shift_max` is the largest shift of a position by a wrong reading, divided by the stated standard
deviation. `lost` and `false` are numbers of walls, and `wrong_leg` is a number of frames."""
WALL_VALUES = ('position', 'instant', 'rate', 'error', 'deviation', 'rate_error')
"""Values of each found wall. The first three are errors of the position averaged over time, of the
position at this instant and of the velocity, divided by their stated standard deviations [1]. The
others are the position error and its stated standard deviation [rotor spacings], and the relative
error of the velocity [1]."""
CONSISTENT = (0.95, 1.05)
"""Stated standard deviations are consistent if the rms normalised error is in this range [1]."""
_SIGNIFICANT = 3.0
"""A difference is significant if it is above this [standard errors]; one of 400 is above by
chance."""
_SINGLE_RECORD = 0.3
"""Assumed relative standard error of a root mean square over a single record [1]."""
_LARGER = 1.1
"""An error counts as larger if its ratio to the error in the earlier table is above this [1]."""
_USEFUL = 2.0
"""Position errors are compared only if `position_rms` in the earlier table was below this [1]."""
_FEWER = 0.01
"""Position errors are not compared if the fraction of lost walls has decreased by more than this
[1], because the new errors include the walls that were lost before."""
_ERRORS = ('position_rms', 'position_rms_error', 'rate_rms', 'rate_rms_error', 'error_rms')
_COMPARED = (*_ERRORS, *_FAILURES, 'frames', 'failure', 'position_beyond_4', 'walls_looked_for')
Row = Mapping[str, str]


@dataclass
class Scores:
    """Errors of the found walls in the frames of one record, and counts of failures."""

    walls: list[tuple[float, ...]] = field(default_factory=list)
    """Values of the found walls, in the order of `WALL_VALUES`."""
    kinetic: list[float] = field(default_factory=list)
    """Errors of the kinetic energy, divided by their stated standard deviations [1]."""
    shifts: list[float] = field(default_factory=list)
    """Shifts of positions by the wrong reading, divided by their stated standard deviations
    [1]."""
    speed: float = 0.0
    """Speed of the fastest wall of the scene [speed of sound]."""
    frames: int = 0
    walls_looked_for: int = 0
    """Number of true walls that count in the statistics (see `WallScene.scored`), summed over all
    frames [1]."""
    lost: int = 0
    false: int = 0
    wrong_leg: int = 0


def line_of(scores: Sequence[Scores]) -> dict[str, float]:
    """Return the values of `COLUMNS` from the scores of all records of a cell."""
    found = [np.array(each.walls).reshape(-1, len(WALL_VALUES)) for each in scores]
    line = {'speed': float(np.median([each.speed for each in scores]))}
    for name in ('frames', 'walls_looked_for', *_FAILURES):
        line[name] = sum(getattr(each, name) for each in scores)
    line |= _normalised('position', [each[:, 0] for each in found])
    line |= _normalised('rate', [each[:, 2] for each in found])
    whole = np.concatenate(found)
    line['instant_rms'] = _rms(_finite(whole[:, 1]))
    line['kinetic_rms'] = _rms(_finite(np.concatenate([each.kinetic for each in scores])))
    line['error_rms'] = _rms(whole[:, 3])
    line['deviation_median'] = _or_nan(np.median, whole[:, 4])
    line['shift_max'] = _or_nan(np.max, np.concatenate([each.shifts for each in scores]))
    return {name: float(line[name]) for name in COLUMNS if name in line}


def _normalised(name: str, errors: list[Array]) -> dict[str, float]:
    """Return the columns of normalised errors; `errors` has one array per record."""
    pieces = [_finite(each) for each in errors]
    whole = np.concatenate(pieces)
    size = np.abs(whole)
    squares = np.array([float(each @ each) for each in pieces])
    counts = np.array([len(each) for each in pieces])
    kept = len(whole) - counts
    without = np.sqrt((squares.sum() - squares)[kept > 0] / kept[kept > 0])
    spread = math.sqrt(max(len(without) - 1, 0)) * float(without.std()) if len(without) else 0.0
    return {
        f'{name}_rms': _rms(whole),
        f'{name}_rms_error': spread if len(without) > 1 else math.nan,
        f'{name}_99': _or_nan(lambda values: np.quantile(values, 0.99), size),
        f'{name}_max': _or_nan(np.max, size),
        f'{name}_beyond_4': _share(size > 4),
        f'{name}_coverage_1': _share(size < 1),
        f'{name}_coverage_2': _share(size < 2),
        f'{name}_bias': _or_nan(np.mean, whole),
    }


def _rms(values: Array) -> float:
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def _share(flags: NDArray[np.bool_]) -> float:
    return 100 * float(flags.mean()) if len(flags) else math.nan


def _or_nan(of: Callable[..., object], values: Array) -> float:
    return float(np.asarray(of(values))) if len(values) else math.nan


def _finite(values: Array) -> Array:
    return np.asarray(values[np.isfinite(values)])


def number_text(number: float) -> str:
    """Return a number as text with six significant digits; NaN becomes an empty text."""
    return '' if math.isnan(number) else f'{number:.6g}'


def check_comparable(cells: Sequence[AccuracyCell], seed: int, earlier: Sequence[Row]) -> None:
    """Raise ValueError unless the earlier table contains at least one of `cells`.

    A row contains a cell if it has the same name and the same values. `cells` were drawn with
    `seed`, which the error message reports. With another seed, random cells of the same names have
    other values. ValueError is also raised if the earlier table has no rows or lacks a column.
    """
    if not earlier or not {'cell', *CELL_COLUMNS, *_COMPARED} <= earlier[0].keys():
        raise ValueError('the earlier table does not contain cells; give a file cells.csv')
    known = {_key(row) for row in earlier}
    if known.isdisjoint((cell.name, *cell_values(cell)) for cell in cells):
        raise ValueError(
            f'no cell of seed {seed} is in the earlier table; give the --seed of that table'
        )


def worse_cells(rows: Sequence[Row], earlier: Sequence[Row]) -> list[str]:
    """Compare two tables; return a summary, and one line for each cell that has become worse."""
    before = {_key(row): row for row in earlier}
    both = [(row, before[_key(row)]) for row in rows if _key(row) in before]
    worse = [
        f'{row["cell"]} ({row["class"]}): {"; ".join(changes)}'
        for row, old in both
        if (changes := _worse(row, old))
    ]
    return [f'{len(worse)} of {len(both)} cells are worse', *worse]


def _key(row: Row) -> tuple[str, ...]:
    return row['cell'], *(row[name] for name in CELL_COLUMNS)


def _worse(row: Row, old: Row) -> list[str]:
    changes = [row['failure']] if row['failure'] and not old['failure'] else []
    useful = _number(old['position_rms']) < _USEFUL
    for name in ('position', 'rate'):
        changes += _less_consistent(name, row, old, useful)
    now, was = _number(row['error_rms']), _number(old['error_rms'])
    if useful and now > _LARGER * was and not _rate(old, 'lost') > _rate(row, 'lost') + _FEWER:
        changes.append(f'error {now:.3g} after {was:.3g} spacings')
    return changes + [each for name in _FAILURES for each in _more_failures(name, row, old)]


def _less_consistent(name: str, row: Row, old: Row, useful: bool) -> list[str]:
    now, was = _number(row[f'{name}_rms']), _number(old[f'{name}_rms'])
    if math.isnan(now):
        return [f'states no {name}'] if useful and was > 0 else []
    errors = (_number(each[f'{name}_rms_error']) for each in (row, old))
    chance = math.hypot(*(error / rms for error, rms in zip(errors, (now, was), strict=True)))
    chance = chance if math.isfinite(chance) else _SINGLE_RECORD
    if _inconsistency(now) - _inconsistency(was) > _SIGNIFICANT * chance:
        return [f'{name} rms {now:.3g} after {was:.3g}']
    return []


def _more_failures(name: str, row: Row, old: Row) -> list[str]:
    """Return one line if the failures `name` are significantly more frequent than in `old`."""
    share, earlier = _rate(row, name), _rate(old, name)
    misplaced = _large_errors(row), _large_errors(old)
    if name == 'lost' and math.isfinite(sum(misplaced)):
        share, earlier = share + misplaced[0], earlier + misplaced[1]
    frames = (_number(row['frames']), _number(old['frames']))
    both = (share * frames[0] + earlier * frames[1]) / sum(frames)
    chance = math.sqrt(max(both, 1 / sum(frames)) * sum(1 / each for each in frames))
    if share - earlier > _SIGNIFICANT * chance:
        return [f'{name} in {100 * share:.2g} % after {100 * earlier:.2g} %']
    return []


def _large_errors(row: Row) -> float:
    found = _number(row['walls_looked_for']) - _number(row['lost'])
    if not found:
        return 0.0
    return _number(row['position_beyond_4']) / 100 * found / max(_number(row['frames']), 1.0)


def _inconsistency(rms: float) -> float:
    if not rms > 0:
        return 0.0
    low, high = CONSISTENT
    return max(math.log(rms / high), math.log(low / rms), 0.0)


def _rate(row: Row, name: str) -> float:
    return _number(row[name]) / max(_number(row['frames']), 1.0)


def _number(text: str) -> float:
    return float(text) if text else math.nan
