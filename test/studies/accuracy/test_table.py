# SPDX-License-Identifier: Apache-2.0
"""Bias, spread and coverage are those of errors whose distribution is known."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage_studies.accuracy.table import (
    Accuracy,
    Line,
    accuracy_of,
    write_lines,
)

COUNT = 40_000


def test_a_normal_estimator_is_judged_as_what_it_is() -> None:
    errors = np.random.default_rng(1).normal(0.3, 0.02, COUNT)
    shifted = accuracy_of(np.column_stack([errors, np.full(COUNT, 1.0)]), 0.01)
    assert (shifted.frames, shifted.failures) == (COUNT, 0)
    assert shifted.bias_error == pytest.approx(0.02 / math.sqrt(COUNT), rel=0.03)
    assert abs(shifted.bias - 0.3) < 4 * shifted.bias_error
    assert shifted.ratio == pytest.approx(2, rel=4 / math.sqrt(2 * COUNT))
    assert shifted.coverage == 1


@pytest.mark.parametrize('factor', [0.5, 1.0, 2.0])
def test_coverage_of_a_normal_estimator_is_that_of_its_margins(factor: float) -> None:
    """Margins of 1.96 standard deviations cover 95 %, others what the error function says."""
    errors = np.random.default_rng(2).normal(0.0, 0.02, COUNT)
    margin = 1.959963984540054 * factor
    found = accuracy_of(np.column_stack([errors, np.full(COUNT, 0.02 * margin)]), 0.02)
    expected = math.erf(margin / math.sqrt(2))
    if factor == 1:
        assert expected == pytest.approx(0.95)
    limit = 4 * math.sqrt(expected * (1 - expected) / COUNT)
    assert found.coverage == pytest.approx(expected, abs=limit)


def test_failures_are_counted_and_left_out() -> None:
    samples = np.array([[0.1, 0.2], [math.nan, 0.2], [0.3, 0.2], [math.nan, math.nan]])
    found = accuracy_of(samples, 0.1)
    assert (found.frames, found.failures) == (4, 2)
    assert found.bias == pytest.approx(0.2)
    assert found.deviation == pytest.approx(0.1 * math.sqrt(2))
    assert found.coverage == 0.5


def test_what_cannot_be_told_is_nan() -> None:
    without_margin = accuracy_of(np.array([[0.1, math.nan], [0.2, math.nan]]), 0.1)
    assert math.isnan(without_margin.coverage)
    assert without_margin.bias == pytest.approx(0.15)
    for samples in (np.empty((0, 2)), np.array([[0.1, 0.1]]), np.full((3, 2), math.nan)):
        found = accuracy_of(samples, 0.1)
        assert found.frames == len(samples)
        assert math.isnan(found.bias)
        assert math.isnan(found.ratio)
        assert math.isnan(found.coverage)


def test_the_table_holds_its_lines(tmp_path: Path) -> None:
    flipper, spinner = chain_of(FLIPPER, 20), chain_of(SPINNER, 20)
    judged = Accuracy(1000, 3, -0.01234567, 0.0001, 0.02, 0.016, 0.945)
    unstated = Accuracy(10, 0, 0.5, 0.1, 0.02, 0.01, math.nan)
    write_lines(
        [Line(flipper, 0.05, 'one', judged), Line(spinner, 0.2, 'two', unstated)], tmp_path
    )
    text = (tmp_path / 'table.md').read_text(encoding='utf-8').splitlines()
    cells = [[cell.strip() for cell in line.strip('|').split('|')] for line in text]
    assert len(cells) == 4
    assert {len(row) for row in cells} == {7}
    assert cells[2] == [
        'flipper (0.5, 0.97)',
        '0.05',
        'one',
        '-0.0123 ± 0.0001',
        '1.250',
        '94.5 %',
        '3 of 1000',
    ]
    assert cells[3][5:] == ['', '0 of 10']
    with (tmp_path / 'table.csv').open(encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    assert [row['class'] for row in rows] == ['flipper', 'spinner']
    assert float(rows[0]['bias [spacings]']) == pytest.approx(judged.bias, rel=1e-5)
    assert float(rows[0]['std / bound']) == pytest.approx(1.25)
    assert float(rows[0]['coverage of 95 % [%]']) == pytest.approx(94.5)
    assert rows[1]['coverage of 95 % [%]'] == ''
    assert [row['failures'] for row in rows] == ['3', '0']
