# SPDX-License-Identifier: Apache-2.0
"""Energies are those within reach, and turns have the sense in which rotors turn."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.estimation.lattice import LatticeCoordinates, WallFrame
from soliton_linkage.estimation.state_report import EXACT, FrameState, StateReporter, energy_reach
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import static_wall

RING = Chain(60, periodic=True)
SPINNER = Chain(80, rotor_length=0.2, rest_angle=1.18)


def frame_of(chain: Chain, angles: Array, rates: Array | None) -> WallFrame:
    line = LatticeCoordinates(chain)
    return WallFrame(StateReporter(chain), line, angles, rates, EXACT)


def near(where: Array, places: list[float], reach: float) -> Array:
    """Which of some places round the ring are within reach of any of the others."""
    ways = where[:, None] - np.array(places)
    ways -= 60 * np.rint(ways / 60)
    return np.asarray((np.abs(ways) <= reach).any(axis=1))


def test_the_energy_of_walls_is_that_of_all_within_reach() -> None:
    rng = np.random.default_rng(1)
    angles = RING.uniform_state(1) + rng.normal(0, 0.1, 60)
    rates = rng.normal(0, 1.0, 60)
    frame = frame_of(RING, angles, rates)
    kinetic = 0.5 * RING.moments_of_inertia * rates**2
    elastic = 0.5 * RING.stiffnesses * FrameState(RING, angles).springs[0] ** 2
    reach = energy_reach(RING)
    for places in ([58.3], [2.0, 30.7], [5.0 * n for n in range(12)]):
        whole = sum(
            energy[near(np.arange(60) + beyond, places, reach)].sum()
            for energy, beyond in ((kinetic, 0.0), (elastic, 0.5))
        )
        assert frame.energy(places) == pytest.approx(whole, rel=1e-12)
    assert np.isnan(frame_of(RING, angles, None).energy([3.0]))


@pytest.mark.parametrize('leg', [0, 1])
def test_a_turn_is_that_of_the_rotors_in_the_wall(leg: int) -> None:
    angles = static_wall(SPINNER, 30.4, leg)
    before = SPINNER.uniform_state(1)
    turned = np.unwrap((angles - before)[5:60])
    frame = frame_of(SPINNER, angles, None)
    assert frame.turn(30.4, 70.0) == np.sign(turned[-1] - turned[0])
