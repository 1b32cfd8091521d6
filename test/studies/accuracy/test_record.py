# SPDX-License-Identifier: Apache-2.0
"""The bound of a record is the bound of a line fit, and the filter has the stated errors."""

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, chain_of

from soliton_linkage_studies.accuracy.estimators import bound
from soliton_linkage_studies.accuracy.record import RecordStudy

CHAINS = (chain_of(FLIPPER, 24), chain_of(SPINNER, 24))
STUDY = RecordStudy(CHAINS, 0.05, speed=5.0, frame_rate=1000.0, frames=300, runs=4, seed=5)


def test_the_bound_is_the_bound_of_end_and_slope_of_a_line_fit():
    of_position, of_velocity = STUDY.bounds(CHAINS[0])
    for number, frames in enumerate(STUDY.shown.tolist()):
        before = (np.arange(frames) - (frames - 1)) / STUDY.frame_rate
        design = np.column_stack([np.ones(frames), before])
        covariance = np.linalg.inv(design.T @ design) * bound(CHAINS[0], 0.05) ** 2
        assert of_position[number] == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)
        assert of_velocity[number] * 5.0 == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-9)


@pytest.mark.parametrize('chain', [0, 1])
def test_filter_errors_agree_with_the_stated_deviations_and_are_near_the_bound(chain):
    found = STUDY.run(chain, 0)
    assert found.shape == (4, len(STUDY.shown))
    errors, stated = found[:2], found[2:]
    late = STUDY.shown > 100
    assert (np.abs(errors[:, late]) < 5 * stated[:, late]).all()
    for number, least in enumerate(STUDY.bounds(CHAINS[chain])):
        assert stated[number, -1] == pytest.approx(least[-1], rel=0.2)


def test_runs_differ_and_are_reproducible():
    np.testing.assert_array_equal(STUDY.run(0, 1), STUDY.run(0, 1))
    assert STUDY.run(0, 1)[0, -1] != STUDY.run(0, 2)[0, -1]


def test_evaluated_frames_start_early_and_end_with_the_last():
    shown = STUDY.shown
    assert shown[0] == 3
    assert shown[-1] == 300
    assert (np.diff(shown) > 0).all()
