# SPDX-License-Identifier: Apache-2.0
"""Statistics of errors: consistent deviations give an rms of 1, and failures are summed."""

import csv
import math

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage_studies.accuracy.cells import CELL_COLUMNS, cell_values
from soliton_linkage_studies.accuracy.frames import Accuracy, Line, accuracy_of, write_lines
from soliton_linkage_studies.accuracy.runs import CellStudy
from soliton_linkage_studies.accuracy.statistics import (
    COLUMNS,
    WALL_VALUES,
    Scores,
    check_comparable,
    line_of,
    worse_cells,
)


def scores(random: np.random.Generator, scale: float, alike: int = 1) -> Scores:
    drawn = np.repeat(random.standard_normal((100 // alike, len(WALL_VALUES))), alike, axis=0)
    rows = [tuple(row) for row in (scale * drawn).tolist()]
    return Scores(walls=rows, frames=100, walls_looked_for=100, lost=1, false=2, wrong_leg=3)


def test_consistent_deviations_give_a_root_mean_square_of_1():
    random = np.random.default_rng(1)
    line = line_of([scores(random, 1.0) for _ in range(50)])
    assert tuple(line) == COLUMNS
    assert line['position_rms'] == pytest.approx(1, abs=4 * line['position_rms_error'])
    assert line['position_rms_error'] == pytest.approx(1 / math.sqrt(2 * 5000), rel=0.4)
    assert line['position_coverage_1'] == pytest.approx(68.3, abs=3)
    assert line['rate_coverage_2'] == pytest.approx(95.4, abs=1.5)
    assert (line['lost'], line['false'], line['wrong_leg']) == (50, 100, 150)


def test_correlated_frames_increase_the_standard_error():
    random = np.random.default_rng(2)
    apart, alike = ([scores(random, 1.0, count) for _ in range(50)] for count in (1, 25))
    assert line_of(alike)['position_rms_error'] > 3 * line_of(apart)['position_rms_error']


def test_a_cell_without_found_walls_reports_only_failures():
    line = line_of([Scores(frames=9, walls_looked_for=9, lost=9)])
    assert line['lost'] == 9
    assert math.isnan(line['position_rms'])
    assert math.isnan(line['rate_rms_error'])


COUNT = 40_000


def test_a_normal_estimator_has_its_known_statistics():
    errors = np.random.default_rng(1).normal(0.3, 0.02, COUNT)
    shifted = accuracy_of(np.column_stack([errors, np.full(COUNT, 1.0)]), 0.01)
    assert (shifted.frames, shifted.failures) == (COUNT, 0)
    assert shifted.bias_error == pytest.approx(0.02 / math.sqrt(COUNT), rel=0.03)
    assert abs(shifted.bias - 0.3) < 4 * shifted.bias_error
    assert shifted.ratio == pytest.approx(2, rel=4 / math.sqrt(2 * COUNT))
    assert shifted.coverage == 1


def test_coverage_of_a_normal_estimator_follows_from_its_margins():
    """Margins of 1.96 standard deviations cover 95 %, others follow the error function."""
    for factor in [0.5, 1.0, 2.0]:
        errors = np.random.default_rng(2).normal(0.0, 0.02, COUNT)
        margin = 1.959963984540054 * factor
        found = accuracy_of(np.column_stack([errors, np.full(COUNT, 0.02 * margin)]), 0.02)
        expected = math.erf(margin / math.sqrt(2))
        if factor == 1:
            assert expected == pytest.approx(0.95)
        limit = 4 * math.sqrt(expected * (1 - expected) / COUNT)
        assert found.coverage == pytest.approx(expected, abs=limit)


def test_failures_are_counted_and_excluded():
    samples = np.array([[0.1, 0.2], [math.nan, 0.2], [0.3, 0.2], [math.nan, math.nan]])
    found = accuracy_of(samples, 0.1)
    assert (found.frames, found.failures) == (4, 2)
    assert found.bias == pytest.approx(0.2)
    assert found.deviation == pytest.approx(0.1 * math.sqrt(2))
    assert found.coverage == 0.5


def test_undefined_statistics_are_nan():
    without_margin = accuracy_of(np.array([[0.1, math.nan], [0.2, math.nan]]), 0.1)
    assert math.isnan(without_margin.coverage)
    assert without_margin.bias == pytest.approx(0.15)
    for samples in (np.empty((0, 2)), np.array([[0.1, 0.1]]), np.full((3, 2), math.nan)):
        found = accuracy_of(samples, 0.1)
        assert found.frames == len(samples)
        assert math.isnan(found.bias)
        assert math.isnan(found.ratio)
        assert math.isnan(found.coverage)


def test_the_table_contains_its_lines(tmp_path):
    flipper, spinner = chain_of(FLIPPER, 20), chain_of(SPINNER, 20)
    scored = Accuracy(1000, 3, -0.01234567, 0.0001, 0.02, 0.016, 0.945)
    unstated = Accuracy(10, 0, 0.5, 0.1, 0.02, 0.01, math.nan)
    write_lines(
        [Line(flipper, 0.05, 'one', scored), Line(spinner, 0.2, 'two', unstated)], tmp_path
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
    assert float(rows[0]['bias [spacings]']) == pytest.approx(scored.bias, rel=1e-5)
    assert float(rows[0]['std / bound']) == pytest.approx(1.25)
    assert float(rows[0]['coverage of 95 % [%]']) == pytest.approx(94.5)
    assert rows[1]['coverage of 95 % [%]'] == ''
    assert [row['failures'] for row in rows] == ['3', '0']


NOT_STATED = {'position_rms': '', 'lost': 1000, 'position_beyond_4': ''}


def row(**others: object) -> dict[str, str]:
    plain = dict.fromkeys((*CELL_COLUMNS, *COLUMNS, 'failure'), '')
    known = {'cell': '3', 'class': 'flipper', 'frames': 1000, 'lost': 0, 'false': 0}
    known |= {
        'wrong_leg': 0,
        'walls_looked_for': 1000,
        'position_rms': 1.0,
        'position_rms_error': 0.05,
        'error_rms': 0.01,
    }
    return plain | {name: str(value) for name, value in (known | others).items()}


def test_worse_results_are_reported():
    for now, was, what in [
        ({'position_rms': 1.6}, {}, 'position rms 1.6 after 1'),
        ({'position_rms': 0.4}, {}, 'position rms 0.4 after 1'),
        ({'error_rms': 0.02}, {}, 'error 0.02 after 0.01 spacings'),
        ({'lost': 30}, {}, 'lost in 3 % after 0 %'),
        ({'position_beyond_4': 5}, {'position_beyond_4': 0}, 'lost in 5 % after 0 %'),
        ({'failure': 'jams'}, {}, 'jams'),
        ({'position_rms': ''}, {}, 'states no position'),
    ]:
        said = worse_cells([row(**now)], [row(**was)])
        assert said == ['1 of 1 cells are worse', f'3 (flipper): {what}']


def test_insignificant_changes_and_improvements_are_not_reported():
    for now, was in [
        ({}, {}),
        ({'position_rms': 1.15}, {}),
        ({'position_rms': 1.0}, {'position_rms': 3.0}),
        ({'lost': 1}, {}),
        ({'error_rms': 0.02}, {'lost': 200}),
        ({}, {'position_rms': ''}),
        (NOT_STATED, {'position_rms': 90, 'lost': 100, 'position_beyond_4': 100}),
        ({'error_rms': 3.0}, {'position_rms': 90}),
    ]:
        assert worse_cells([row(**now)], [row(**was)]) == ['0 of 1 cells are worse']


def test_tables_of_other_cells_are_rejected():
    study = CellStudy(1, 3, 10)
    cell = study.all[1]
    with pytest.raises(ValueError, match='does not contain cells; give a file cells'):
        check_comparable(study.all, study.seed, [{'cell': '1'}])
    same = row() | {'cell': cell.name} | dict(zip(CELL_COLUMNS, cell_values(cell), strict=True))
    check_comparable(study.all, study.seed, [row(**same)])
    with pytest.raises(ValueError, match='no cell of seed 1 is in the earlier table; give the'):
        check_comparable(study.all, study.seed, [row(**same | {'noise': 0.3})])
    assert worse_cells([row()], [row(noise=0.3)]) == ['0 of 0 cells are worse']
