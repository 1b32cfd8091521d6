# SPDX-License-Identifier: Apache-2.0
"""Which cells are worse than in an earlier table of the same cells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from soliton_linkage.studies.accuracy.cells.study import GIVEN

_TRUE = (0.95, 1.05)
"""Root mean squares of normalised errors that are as they should be."""
_SIGNIFICANT = 3.0
"""Standard errors from which on a difference is no chance: 1 in 400."""
_UNKNOWN = 0.3
"""Standard error, relative, of what one record tells."""
_LARGER = 1.1
"""Ratio of errors from which on they are larger."""
_FAILURES = ('lost', 'false', 'wrong_leg')

Row = Mapping[str, str]


def worse_cells(rows: Sequence[Row], earlier: Sequence[Row]) -> list[str]:
    """A line for each cell that is worse, saying in what.

    Raises ValueError where there is no cell that is the same in both.
    """
    before = {(row['cell'], *(row[name] for name in GIVEN)): row for row in earlier}
    said, found = [], 0
    for row in rows:
        old = before.get((row['cell'], *(row[name] for name in GIVEN)))
        if old is None:
            continue
        found += 1
        what = _worse(row, old)
        if what:
            said.append(f'{row["cell"]} ({row["class"]}): {"; ".join(what)}')
    if not found:
        raise ValueError('no cell is the same in both tables; give the --seed of the earlier one')
    return [f'{len(said)} of {found} cells are worse', *said]


def _worse(row: Row, old: Row) -> list[str]:
    what = []
    if row['failure'] and not old['failure']:
        what.append(row['failure'])
    for name in ('place', 'rate'):
        now, was = _number(row[f'{name}_rms']), _number(old[f'{name}_rms'])
        if math.isnan(now) and was > 0:
            what.append(f'states no {name}')
        chance = math.hypot(
            _number(row[f'{name}_rms_error']) / now, _number(old[f'{name}_rms_error']) / was
        )
        if _off(now) - _off(was) > _SIGNIFICANT * (chance if math.isfinite(chance) else _UNKNOWN):
            what.append(f'{name} rms {now:.3g} after {was:.3g}')
    now, was = _number(row['error_rms']), _number(old['error_rms'])
    if now > _LARGER * was and not _fewer_found(old, row):
        what.append(f'error {now:.3g} after {was:.3g} spacings')
    for name in _FAILURES:
        share, earlier = _share(row, name), _share(old, name)
        frames = (_number(row['frames']), _number(old['frames']))
        both = (share * frames[0] + earlier * frames[1]) / sum(frames)
        chance = math.sqrt(max(both, 1 / sum(frames)) * sum(1 / each for each in frames))
        if share - earlier > _SIGNIFICANT * chance:
            what.append(f'{name} in {100 * share:.2g} % after {100 * earlier:.2g} %')
    return what


def _off(rms: float) -> float:
    """How far a root mean square is from what it should be, as a logarithm."""
    if not rms > 0:
        return 0.0
    low, high = _TRUE
    return max(math.log(rms / high), math.log(low / rms), 0.0)


def _fewer_found(row: Row, other: Row) -> bool:
    """Whether a table lost many walls that the other found, which may be the hard ones."""
    return _share(row, 'lost') > _share(other, 'lost') + 0.01


def _share(row: Row, name: str) -> float:
    return _number(row[name]) / max(_number(row['frames']), 1.0)


def _number(text: str) -> float:
    return float(text) if text else math.nan
