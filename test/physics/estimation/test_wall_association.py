# SPDX-License-Identifier: Apache-2.0
"""Walls are paired so that all ways together are short, and never with another charge."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest

from soliton_linkage.estimation.lattice import LatticeCoordinates
from soliton_linkage.estimation.wall_track import WallMeasurement
from soliton_linkage.estimation.wall_tracker import PredictedWall, assign
from soliton_linkage.linkage.chain import Chain

LINE = LatticeCoordinates(Chain(60))
RING = LatticeCoordinates(Chain(60, periodic=True))


def seen(rotor: float, charge: int) -> WallMeasurement:
    return WallMeasurement(rotor, 0.01, charge, (math.nan, math.nan))


@pytest.mark.parametrize('seed', range(4))
def test_no_other_pairing_is_shorter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, after = rng.uniform(20, 30, (2, 4))
    expected = [PredictedWall(site, 4.0, 1) for site in before]
    pairs = assign(LINE, expected, [seen(site, 1) for site in after], 100.0)

    def way(order: tuple[int, ...]) -> float:
        return float(np.sum((after[list(order)] - before) ** 2))

    assert way(tuple(pairs[row] for row in range(4))) == min(map(way, permutations(range(4))))


def test_walls_of_another_charge_or_beyond_the_gate_are_not_the_same() -> None:
    expected = [PredictedWall(10.0, 0.25, 1), PredictedWall(20.0, 0.25, -1)]
    shown = [seen(10.5, -1), seen(10.8, 1), seen(22.5, -1)]
    assert assign(LINE, expected, shown, 4.0) == {0: 1}


def test_round_a_ring_the_shorter_way_counts() -> None:
    expected = [PredictedWall(59.8, 0.25, 1)]
    assert assign(RING, expected, [seen(0.3, 1)], 4.0) == {0: 0}
    assert assign(LINE, expected, [seen(0.3, 1)], 4.0) == {}
