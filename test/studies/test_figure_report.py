# SPDX-License-Identifier: Apache-2.0
"""A figure is saved with all its data, and the table compares paper, theory and simulation."""

import csv
import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from soliton_linkage_studies.figure_report import (
    Comparison,
    FigureReport,
    Formula,
    save_caption,
    write_table,
)


def plate_with(points: list[tuple[float, float]]) -> FigureReport:
    report = FigureReport(Figure(figsize=(2, 2)), 'A line over time.')
    axes = report.figure.subplots()
    across, up = np.transpose(points)
    axes.plot(across, up)
    report.add_points('a', 'line', ('time [s]', 'phi [rad]'), across, up)
    return report


def test_data_are_saved_without_loss_of_digits(tmp_path):
    points = [(0.1, 1 / 3), (math.pi, -2e-300), (5e20, math.nan)]
    plate_with(points).save(tmp_path, 'line')
    with (tmp_path / 'line.csv').open(newline='', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    kept = [(float(row['x']), float(row['y'])) for row in rows]
    assert np.array_equal(kept, points, equal_nan=True)
    kinds = {(row['panel'], row['series'], row['x_name'], row['y_name']) for row in rows}
    assert kinds == {('a', 'line', 'time [s]', 'phi [rad]')}


def test_the_same_figure_makes_the_same_files(tmp_path):
    for name in ('once', 'again'):
        plate_with([(0, 1), (1, 3)]).save(tmp_path, name)
    for suffix in ('png', 'pdf', 'csv', 'txt'):
        once, again = (tmp_path / f'{name}.{suffix}' for name in ('once', 'again'))
        assert once.read_bytes() == again.read_bytes()
    assert (tmp_path / 'once.png').read_bytes().startswith(b'\x89PNG')
    assert (tmp_path / 'once.pdf').read_bytes().startswith(b'%PDF')


def test_a_caption_is_saved_next_to_the_picture_in_short_lines(tmp_path):
    report = plate_with([(0, 1)])
    report.caption = f"""
    {'A blue line. ' * 20}

    And more.
    """
    report.save(tmp_path, 'line')
    text = (tmp_path / 'line.txt').read_text(encoding='utf-8')
    assert max(map(len, text.splitlines())) < 99
    first, second = text.split('\n\n')
    assert first.split() == ['A', 'blue', 'line.'] * 20
    assert second == 'And more.\n'


def test_a_picture_without_a_caption_is_rejected(tmp_path):
    for caption in ['', ' \n\n \n']:
        with pytest.raises(ValueError, match='line has no caption; describe its content'):
            save_caption(caption, tmp_path / 'line.txt')


def test_points_with_different_lengths_are_rejected():
    with pytest.raises(ValueError, match=r'argument \d is (shorter|longer)'):
        FigureReport(Figure(), 'Nothing.').add_points('a', 'line', ('x', 'y'), [1, 2], [3])


def test_the_error_is_relative_to_theory():
    for measured, expected, error in [
        (1.02, 1.0, '+2 %'),
        (0.5, 2.0, '-75 %'),
        (-1.1, -1.0, '+10 %'),
        (3e-9, 0.0, '3.0e-09'),
        (7.0, math.nan, ''),
        (1 + 1e-12, 1.0, '0 %'),
        (1 - 2e-11, 1.0, '-2e-09 %'),
        (0.0, 0.0, '0'),
    ]:
        assert Comparison('gap', 'w', 'w', measured, expected).error == error


def test_the_table_has_one_row_of_six_cells_per_comparison(tmp_path):
    report = plate_with([(0, 0)])
    report.add_comparison('gap', '|r|', 'q', 2.0, 1.0)
    report.add_comparison('overshoot', 'd³', 'none', 0.25)
    path = tmp_path / 'table.md'
    write_table({'figure': report.comparisons}, path, ['figure'])
    lines = path.read_text(encoding='utf-8').splitlines()
    assert len(lines) == 4
    assert {line.count('|') for line in lines} == {7}
    assert 'q = 1 | 2 | +1e+02 %' in lines[2]
    assert 'none | 0.25 |  |' in lines[3]


def test_a_row_prints_the_formula_of_its_number(tmp_path):
    report = plate_with([(0, 0)])
    report.add_comparison(
        'speed', 'v', Formula('|v| / Λ', 0.75, {'v': -3.0, 'Λ': 4.0}, 'slow'), 1.5
    )
    write_table({'figure': report.comparisons}, tmp_path / 'table.md', ['figure'])
    row = (tmp_path / 'table.md').read_text(encoding='utf-8').splitlines()[2]
    assert row == (
        '| figure | speed | v | ∣v∣ / Λ = 0.75 for v = -3, Λ = 4 (slow) | 1.5 | +1e+02 % |'
    )


def test_rows_of_figures_that_are_not_redrawn_are_kept_in_figure_order(tmp_path):
    order, path = ('b', 'a', 'd', 'c'), tmp_path / 'table.md'
    first = {name: [Comparison(f'{name}{n}', '|r|', 'q', n) for n in range(3)] for name in 'ab'}
    write_table(first, path, order)
    again = [Comparison('new', 'p', 'q', 7.0)]
    write_table({'c': again, 'a': again, 'd': []}, path, order)
    whole = tmp_path / 'whole.md'
    write_table({**first, 'c': again, 'a': again}, whole, order)
    assert path.read_text(encoding='utf-8') == whole.read_text(encoding='utf-8')
    rows = [row.split(' | ')[:2] for row in path.read_text(encoding='utf-8').splitlines()[2:]]
    assert rows == [['| b', 'b0'], ['| b', 'b1'], ['| b', 'b2'], ['| a', 'new'], ['| c', 'new']]
