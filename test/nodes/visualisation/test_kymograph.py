# SPDX-License-Identifier: Apache-2.0
"""Laws of the picture of the last seconds."""

import numpy as np
import pytest
from matplotlib import colormaps

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.visualisation.kymograph import Kymograph
from soliton_linkage_studies.palette import LEANS_LEFT, LEANS_RIGHT

RATE = 30
CHAIN = Chain(number_of_rotors=8)
BLANK, BLACK = [217] * 3, [0] * 3


def colour(name: str) -> list[int]:
    return [int(name[at : at + 2], 16) for at in (1, 3, 5)]


def filled(seconds: float, rate: float = RATE, wall: float = float('nan')) -> Kymograph:
    kymograph = Kymograph(CHAIN, 2.0)
    angles = CHAIN.uniform_state(1)
    angles[4:] = CHAIN.uniform_state(-1)[4:]
    for number in range(round(seconds * rate)):
        kymograph.add(100 + number / rate, angles, [wall] if np.isfinite(wall) else [])
    return kymograph


@pytest.mark.parametrize('rate', [RATE, 250, 4])
def test_time_runs_to_the_right_and_rotors_upwards_in_the_colours_of_the_figures(rate):
    picture = filled(1.0, rate).picture()
    assert picture.shape == (400, 60, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_allclose(picture[390, -1], colour(LEANS_RIGHT), atol=3)
    np.testing.assert_allclose(picture[10, -1], colour(LEANS_LEFT), atol=3)
    begin = 60 - round((1 - 1 / rate) * RATE) - 1
    assert picture[:, begin - 1].tolist() == 400 * [BLANK]
    assert (picture[:, begin + 1 :] != BLANK).any(axis=2).all()


def test_the_track_is_drawn_at_the_wall():
    picture = filled(1.0, wall=3.5).picture()
    black = (picture[:, -1] == BLACK).all(axis=1)
    assert abs(np.flatnonzero(black).mean() - (400 - 4.0 * 50)) <= 2


def test_a_track_is_continuous_except_at_a_reset():
    kymograph = Kymograph(CHAIN, 2.0)
    for number, place in enumerate([1.0, 2.0, 3.0, 7.0]):
        kymograph.add(number / RATE, CHAIN.uniform_state(1), [place])
    black = (kymograph.picture() == BLACK).all(axis=2)
    heights = [np.ptp(np.flatnonzero(black[:, column])) for column in range(-4, 0)]
    assert min(heights[:2]) >= 49
    assert max(heights[2:]) <= 4


def test_a_step_back_in_time_clears_the_picture():
    kymograph = filled(2.0)
    kymograph.add(5.0, CHAIN.uniform_state(1), [])
    assert kymograph.picture()[:, :-1].tolist() == 400 * [59 * [BLANK]]


def test_missing_joints_are_blank():
    kymograph = Kymograph(CHAIN, 2.0)
    angles = CHAIN.uniform_state(1)
    angles[2] = np.nan
    kymograph.add(0.0, angles, [])
    column = kymograph.picture()[::-1, -1].reshape(8, 50, 3)
    assert [(rotor == BLANK).all() for rotor in column] == [n == 2 for n in range(8)]


def test_long_chains_have_no_more_rows_than_a_screen():
    long = Chain(number_of_rotors=30_000)
    kymograph = Kymograph(long, 1.0)
    kymograph.add(0.0, long.uniform_state(1), [15_000.0])
    picture = kymograph.picture()
    assert len(picture) <= 1000
    black = np.flatnonzero((picture[:, -1] == BLACK).all(axis=1))
    assert abs(black.mean() / len(picture) - 0.5) < 0.01


def test_white_is_upright():
    kymograph = Kymograph(CHAIN, 2.0)
    kymograph.add(0.0, np.zeros(8), [])
    middle = [255 * share for share in colormaps['PuOr'](0.5)[:3]]
    np.testing.assert_allclose(kymograph.picture()[0, -1], middle, atol=3)
