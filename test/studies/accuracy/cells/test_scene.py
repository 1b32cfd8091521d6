# SPDX-License-Identifier: Apache-2.0
"""Means over time leave steady ways as they are, and phonons out."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage_studies.accuracy.cells.scene import smoothed


def test_a_steady_way_is_its_own_mean_and_pushes_part_it() -> None:
    way = np.concatenate([0.3 * np.arange(40), 12.0 - 0.1 * np.arange(60)])
    means, slopes = smoothed(way, 5, [40])
    assert means == pytest.approx(way)
    assert slopes[:40] == pytest.approx(0.3)
    assert slopes[40:] == pytest.approx(-0.1)


def test_a_wave_of_the_length_of_the_mean_is_left_out() -> None:
    frames = np.arange(200)
    wave = np.sin(2 * np.pi * frames / 21)
    means, slopes = smoothed(0.01 * frames + wave, 10)
    inner = slice(30, -30)
    assert means[inner] == pytest.approx(0.01 * frames[inner], abs=1e-9)
    assert slopes[inner] == pytest.approx(0.01, abs=0.02)


def test_a_piece_shorter_than_the_mean_is_its_own_mean() -> None:
    means, slopes = smoothed(np.array([1.0, 5.0]), 9, [1])
    assert means == pytest.approx([1.0, 5.0])
    assert slopes == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize('wide', [1, 2, 9])
def test_slopes_of_a_bent_way_are_those_of_its_cubic(wide: int) -> None:
    times = np.arange(100.0) - 50
    _, slopes = smoothed(times**3 - 7 * times, wide, bent=True)
    inner = slice(30, -30)
    assert slopes[inner] == pytest.approx(3 * times[inner] ** 2 - 7)
