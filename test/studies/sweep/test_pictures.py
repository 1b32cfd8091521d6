# SPDX-License-Identifier: Apache-2.0
"""Sweep pictures show each point at its coordinates, in the colour of its class or number."""

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from soliton_linkage.linkage.chain import Chain, Motion
from soliton_linkage_studies.palette import BLUE, MOTION_COLOURS, RED
from soliton_linkage_studies.sweep.config import Axis, SweepStudy
from soliton_linkage_studies.sweep.program import (
    class_label,
    draw_sweep,
    numbers,
    shares,
    sweep_figure,
)

RATIOS = Axis('rotor_length_ratio', tuple(np.geomspace(0.3, 6, 9).tolist()), logarithmic=True)
ANGLES = Axis('rest_angle', tuple(np.linspace(0.2, 1.3, 7).tolist()))
KICKS = Axis('kick', (0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
MECHANICS = Axis('mechanics', ('elastic', 'rigid'))
SCALES = Axis('deviations.scale', KICKS.values)


def drawn(study: SweepStudy, rows: list[dict[str, str]]) -> Any:
    return draw_sweep(Figure().subplots(), study, rows)


def rows_of(study: SweepStudy) -> list[dict[str, str]]:
    return [dict(zip(study.columns, study.cells(row), strict=True)) for row in range(study.rows)]


def speed_rows(study: SweepStudy, speed: Any) -> list[dict[str, str]]:
    """Return sweep rows whose speeds are a function of the axis values and the seed."""
    rows = []
    for row in range(study.rows):
        values, seed = study.point(row)
        rows.append({'outcome': 'returns', 'speed': repr(speed(*values.values(), seed))})
    return rows


def outcome_rows(study: SweepStudy, seeds: int) -> list[dict[str, str]]:
    """Return rows in which walls on bars return with the first seeds only."""
    points = [study.point(row) for row in range(study.rows)]
    return [
        {'outcome': 'returns' if values['mechanics'] == 'elastic' or seed < seeds else 'lost'}
        for values, seed in points
    ]


def test_a_map_of_classes_has_the_motion_of_each_chain_between_its_limits():
    study = SweepStudy('map', 'motion', {'spacing': 1.0}, (RATIOS, ANGLES), (0,))
    axes = drawn(study, rows_of(study))
    (mesh,) = axes.collections
    colours = np.asarray(mesh.get_array())
    (legend,) = (each for each in axes.artists if hasattr(each, 'legend_handles'))
    names = [text.get_text() for text in legend.get_texts()]
    of_class = {
        name: handle.get_facecolor()[:3]
        for name, handle in zip(names, legend.legend_handles, strict=True)
    }
    assert names == [*(motion.value for motion in Motion), 'blocked: a bond may stop the wall']
    corners = mesh.get_coordinates()
    for across, ratio in enumerate(RATIOS.values):
        for up, angle in enumerate(ANGLES.values):
            chain = Chain(spacing=1.0, rotor_length=float(ratio), rest_angle=float(angle))
            assert tuple(colours[up, across]) == pytest.approx(of_class[chain.motion.value])
            (left, low), (right, high) = corners[up, across], corners[up + 1, across + 1]
            assert left < ratio < right
            assert low < angle < high
    flipping, spinning = (np.array(line.get_data()).T for line in axes.lines)
    for border, lean in ((flipping, lambda _: 1.0), (spinning, lambda angle: 2 / np.sin(angle))):
        ratios, angles = border.T
        assert 2 * ratios * np.sin(angles) == pytest.approx(lean(angles), rel=1e-12)


def test_colours_are_paler_for_fewer_seeds_in_the_most_frequent_class():
    study = SweepStudy('map', 'motion', {}, (RATIOS, ANGLES), (0, 1, 2, 3))
    rows = rows_of(study)
    for row in rows[:4]:
        row['motion'] = 'spinner' if row['seed'] != '2' else 'flipper'
    assert shares(study, rows)[0, 0] == pytest.approx([0.25, 0, 0.75, 0])
    (mesh,) = drawn(study, rows).collections
    expected = 0.75 * np.array(to_rgb(MOTION_COLOURS[Motion.SPINNER])) + 0.25
    assert np.asarray(mesh.get_array())[0, 0] == pytest.approx(expected)


def test_a_map_of_numbers_shows_means_over_the_seeds_that_have_one():
    study = SweepStudy('map', 'speed', {}, (KICKS, ANGLES), (0, 1, 2))
    rows = speed_rows(study, lambda kick, angle, seed: kick * angle + seed)
    rows[1]['speed'] = 'nan'
    rows[2]['speed'] = ''
    for row in rows[3:6]:
        row['speed'] = 'nan'
    axes = drawn(study, rows)
    mesh = axes.collections[0]
    values = np.ma.filled(mesh.get_array(), np.nan)
    expected = np.outer(ANGLES.values, KICKS.values) + 1
    expected[0, 0] -= 1
    expected[1, 0] = np.nan
    assert values == pytest.approx(expected, nan_ok=True)
    assert axes.figure.axes[1].get_ylabel() == study.measure.label


def test_a_curve_of_numbers_shows_median_and_range():
    study = SweepStudy('curve', 'speed', {}, (KICKS,), (0, 1, 7))
    rows = speed_rows(study, lambda kick, seed: kick + seed)
    assert numbers(study, rows).shape == (6, 3)
    axes = drawn(study, rows)
    kicks = np.array(KICKS.values)
    median = axes.lines[-1]
    dots = np.array([line.get_ydata() for line in axes.lines[:-1]])
    for seed, heights in zip(study.seeds, dots, strict=True):
        assert heights == pytest.approx(kicks + seed)
    assert np.asarray(median.get_xdata()) == pytest.approx(kicks)
    assert np.asarray(median.get_ydata()) == pytest.approx(kicks + 1)
    band = axes.collections[0].get_datalim(axes.transData)
    assert (band.y0, band.y1) == pytest.approx((0.1, 0.6 + 7))


def test_a_second_axis_with_few_values_makes_one_curve_per_value():
    for axes_of_study in ((MECHANICS, SCALES), (SCALES, MECHANICS)):
        study = SweepStudy('curves', 'survival', {}, axes_of_study, (0, 1))
        axes = drawn(study, outcome_rows(study, 1))
        heights = {line.get_label(): set(np.asarray(line.get_ydata())) for line in axes.lines}
        assert heights == {'elastic': {1.0}, 'rigid': {0.5}}


def test_one_axis_with_classes_makes_one_curve_per_class():
    study = SweepStudy('curves', 'motion', {'rest_angle': 0.97}, (RATIOS,), (0,))
    lines = drawn(study, rows_of(study)).lines
    assert [line.get_label() for line in lines] == [
        class_label(name) for name in study.measure.classes
    ]
    heights = np.array([line.get_ydata() for line in lines])
    assert np.array_equal(heights.sum(axis=0), np.ones(9))


def test_more_than_two_axes_are_not_drawn():
    study = SweepStudy('cube', 'motion', {}, (RATIOS, ANGLES, Axis('spacing', (0.1, 0.2))), (0,))
    assert sweep_figure(study, []) is None


def test_fractions_are_drawn_from_0_to_1_with_errors_in_distinct_colours():
    study = SweepStudy('curves', 'survival', {}, (MECHANICS, SCALES), tuple(range(8)))
    axes = drawn(study, outcome_rows(study, 2))
    assert axes.get_ylim() == (-0.02, 1.02)
    beside: list[tuple[float, ...]] = []
    assert [line.get_color() for line in axes.lines] == [BLUE, RED]
    for bars, line, share in zip(axes.collections, axes.lines, (1.0, 0.25), strict=True):
        assert tuple(bars.get_colors()[0][:3]) == pytest.approx(to_rgb(line.get_color()))
        assert len(bars.get_segments()) == len(KICKS.values)
        for number, ((left, low), (right, high)) in zip(
            KICKS.values, bars.get_segments(), strict=True
        ):
            assert left == right == pytest.approx(number, abs=0.02)
            assert 0 <= low <= share <= high <= 1
        beside.append(tuple(segment[0][0] for segment in bars.get_segments()))
    assert np.abs(np.subtract(*beside)).min() > 0.01  # No bar hides another.
    assert 'standard error' in axes.get_ylabel()


def test_map_pixels_stay_within_the_range_of_rest_angles():
    angles = Axis('rest_angle', tuple(np.linspace(0.05, 1.55, 8).tolist()))
    study = SweepStudy('map', 'motion', {'number_of_rotors': 3}, (RATIOS, angles), (0,))
    axes = drawn(study, rows_of(study))
    (mesh,) = axes.collections
    heights = np.asarray(mesh.get_coordinates())[:, 0, 1]
    middles = np.convolve(angles.values, [0.5, 0.5], 'valid')
    assert heights == pytest.approx(np.array([0, *middles, np.pi / 2]))
    assert axes.get_ylim() == pytest.approx((0, np.pi / 2))
