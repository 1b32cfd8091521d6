# SPDX-License-Identifier: Apache-2.0
"""What the scores of a cell amount to: a line of the table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from soliton_linkage.linkage.chain import Array
from soliton_linkage_studies.accuracy.cells.runs import NUMBERS, Scores

COLUMNS = (
    'speed',
    'frames',
    'walls_looked_for',
    'place_rms',
    'place_rms_error',
    'place_99',
    'place_max',
    'place_beyond_4',
    'place_coverage_1',
    'place_coverage_2',
    'place_bias',
    'instant_rms',
    'rate_rms',
    'rate_rms_error',
    'rate_99',
    'rate_beyond_4',
    'rate_coverage_1',
    'rate_coverage_2',
    'rate_bias',
    'kinetic_rms',
    'error_rms',
    'deviation_median',
    'shift_max',
    'lost',
    'false',
    'wrong_leg',
)
"""Of a cell: speed of its fastest wall over that of sound. Errors of place and rate are over their
stated deviations: root mean square and its standard error, 99 % and largest of their sizes, shares
beyond 4 and within 1 and 2 [%], mean; `instant` is the place without a mean over time. Then error
of the place and its median stated deviation [rotor spacings], and by how many stated deviations
one wrong reading moved it. Walls are lost or false, frames have the wrong leg."""


def line_of(scores: Sequence[Scores]) -> dict[str, float]:
    """Columns of a cell from the scores of its records."""
    found = [np.array(each.walls).reshape(-1, len(NUMBERS)) for each in scores]
    line = {
        'speed': float(np.median([each.speed for each in scores])),
        'frames': sum(each.frames for each in scores),
        'walls_looked_for': sum(each.looked_for for each in scores),
        'lost': sum(each.lost for each in scores),
        'false': sum(each.false for each in scores),
        'wrong_leg': sum(each.wrong_leg for each in scores),
    }
    line |= _normalised('place', [each[:, 0] for each in found])
    line |= _normalised('rate', [each[:, 2] for each in found])
    whole = np.concatenate(found)
    line['instant_rms'] = _rms(_finite(whole[:, 1]))
    line['kinetic_rms'] = _rms(_finite(np.concatenate([each.kinetic for each in scores])))
    line['error_rms'] = _rms(whole[:, 3])
    line['deviation_median'] = _or_nan(np.median, whole[:, 4])
    line['shift_max'] = _or_nan(np.max, np.concatenate([each.shifts for each in scores]))
    return {name: float(line[name]) for name in COLUMNS if name in line}


def _normalised(name: str, errors: list[Array]) -> dict[str, float]:
    """Root mean square of errors over their deviations, and what else there is to say of them.

    The error of the root mean square is by the jackknife over the records, whose frames are alike.
    """
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
