# SPDX-License-Identifier: Apache-2.0
"""A line tells what errors are: true deviations make 1, failures are added up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from soliton_linkage_studies.accuracy.cells.runs import NUMBERS, Scores
from soliton_linkage_studies.accuracy.cells.statistics import COLUMNS, line_of


def scores(random: np.random.Generator, scale: float, alike: int = 1) -> Scores:
    drawn = np.repeat(random.standard_normal((100 // alike, len(NUMBERS))), alike, axis=0)
    rows = [tuple(row) for row in (scale * drawn).tolist()]
    return Scores(walls=rows, frames=100, looked_for=100, lost=1, false=2, wrong_leg=3)


def test_true_deviations_make_a_root_mean_square_of_1() -> None:
    random = np.random.default_rng(1)
    line = line_of([scores(random, 1.0) for _ in range(50)])
    assert tuple(line) == COLUMNS
    assert line['place_rms'] == pytest.approx(1, abs=4 * line['place_rms_error'])
    assert line['place_rms_error'] == pytest.approx(1 / math.sqrt(2 * 5000), rel=0.4)
    assert line['place_coverage_1'] == pytest.approx(68.3, abs=3)
    assert line['rate_coverage_2'] == pytest.approx(95.4, abs=1.5)
    assert (line['lost'], line['false'], line['wrong_leg']) == (50, 100, 150)


def test_frames_that_are_alike_tell_less() -> None:
    random = np.random.default_rng(2)
    apart, alike = ([scores(random, 1.0, count) for _ in range(50)] for count in (1, 25))
    assert line_of(alike)['place_rms_error'] > 3 * line_of(apart)['place_rms_error']


def test_where_nothing_was_found_nothing_is_told_but_failures() -> None:
    line = line_of([Scores(frames=9, looked_for=9, lost=9)])
    assert line['lost'] == 9
    assert math.isnan(line['place_rms'])
    assert math.isnan(line['rate_rms_error'])
