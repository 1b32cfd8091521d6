# SPDX-License-Identifier: Apache-2.0
"""Stated standard deviations of the analyser agree with its errors in simulated records."""

import numpy as np
import pytest
from chains import FLIPPER, chain_of

from soliton_linkage_studies.accuracy.cells import AccuracyCell
from soliton_linkage_studies.accuracy.runs import records


@pytest.mark.parametrize('phonons', [0.0, 0.01])
def test_deviations_of_two_walls_agree_with_their_errors_with_and_without_waves(phonons):
    cell = AccuracyCell(
        'two', chain_of(FLIPPER, 60), 0.002, 0.3, 0.2, 100, phonons=phonons, walls=2
    )
    walls = np.array(
        [each for scores in records(cell, 800, np.random.default_rng(1)) for each in scores.walls]
    )
    for normalised in walls[:, [0, 2]].T:
        assert 0.6 < np.sqrt(np.mean(normalised**2)) < 1.5
