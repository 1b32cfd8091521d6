# SPDX-License-Identifier: Apache-2.0
"""What errors of estimators amount to - bias, spread, coverage, failures - and their table."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage_studies.captions import class_and_shape

_COLUMNS = (
    'class',
    'r/a',
    'rest angle [rad]',
    'noise [rad]',
    'estimator',
    'frames',
    'bias [spacings]',
    'standard error of the bias [spacings]',
    'std [spacings]',
    'bound [spacings]',
    'std / bound',
    'coverage of 95 % [%]',
    'failures',
)


@dataclass(frozen=True)
class Accuracy:
    """How well an estimator tells a place, over many frames; a bias is the mean error.

    Bias, deviation and coverage are those of the frames in which it did not fail, and NaN where
    there are fewer than two of them.
    """

    frames: int
    """In which it was tried."""
    failures: int
    bias: float
    """Mean error [rotor spacings]."""
    bias_error: float
    """Standard error of the bias [rotor spacings]."""
    deviation: float
    """Standard deviation of the error [rotor spacings]."""
    bound: float
    """Least standard deviation that an unbiased estimator has [rotor spacings]."""
    coverage: float
    """Share of the frames in which the stated interval holds the place; NaN without interval."""

    @property
    def ratio(self) -> float:
        """Standard deviation over its bound [1]."""
        return self.deviation / self.bound


@dataclass(frozen=True)
class Line:
    """A line of the table: one estimator with one chain and noise."""

    chain: Chain
    noise: float
    """Standard deviation of an angle [rad]."""
    estimator: str
    accuracy: Accuracy


def accuracy_of(samples: Array, bound: float) -> Accuracy:
    """Judge errors and margins, shape (frames, 2), NaN where it failed, by the bound on them."""
    succeeded = samples[np.isfinite(samples[:, 0])]
    errors, margins = succeeded.T
    known = len(errors) > 1
    deviation = float(errors.std(ddof=1)) if known else math.nan
    stated = known and bool(np.isfinite(margins).all())
    return Accuracy(
        frames=len(samples),
        failures=len(samples) - len(errors),
        bias=float(errors.mean()) if known else math.nan,
        bias_error=deviation / math.sqrt(len(errors)) if known else math.nan,
        deviation=deviation,
        bound=bound,
        coverage=float((np.abs(errors) <= margins).mean()) if stated else math.nan,
    )


def write_lines(lines: Sequence[Line], folder: Path) -> None:
    """Write the lines as table.md and table.csv."""
    rows = [
        '| class (r/a, θ̄) | noise [rad] | estimator | bias [spacings] | std / bound '
        '| coverage of 95 % | failures |',
        '| --- | --- | --- | --- | --- | --- | --- |',
        *(_markdown(line) for line in lines),
    ]
    (folder / 'table.md').write_text('\n'.join(rows) + '\n', encoding='utf-8')
    with (folder / 'table.csv').open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(_COLUMNS)
        writer.writerows(_cells(line) for line in lines)


def _markdown(line: Line) -> str:
    found = line.accuracy
    cells = [
        class_and_shape(line.chain),
        f'{line.noise:g}',
        line.estimator,
        f'{found.bias:+.4f} ± {found.bias_error:.4f}',
        f'{found.ratio:.3f}',
        '' if math.isnan(found.coverage) else f'{100 * found.coverage:.1f} %',
        f'{found.failures} of {found.frames}',
    ]
    return '| ' + ' | '.join(cells) + ' |'


def _cells(line: Line) -> list[str]:
    chain, found = line.chain, line.accuracy
    numbers = (
        found.bias,
        found.bias_error,
        found.deviation,
        found.bound,
        found.ratio,
        100 * found.coverage,
    )
    return [
        chain.motion.value,
        f'{chain.rotor_length / chain.spacing:g}',
        f'{chain.rest_angle:g}',
        f'{line.noise:g}',
        line.estimator,
        str(found.frames),
        *('' if math.isnan(number) else f'{number:.6g}' for number in numbers),
        str(found.failures),
    ]
