# SPDX-License-Identifier: Apache-2.0
"""Energies within reach add up to the whole, and turns have the sense in which rotors turn."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.estimation.settings import DEFAULTS
from soliton_linkage.estimation.state_report import EXACT, FrameState, StateReporter
from soliton_linkage.estimation.walls.wall_frame import WallFrame
from soliton_linkage.estimation.walls.wall_line import WallLine
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.solitons.static_wall import static_wall

RING = Chain(60, periodic=True)
SPINNER = Chain(80, rotor_length=0.2, rest_angle=1.18)


def frame_of(chain: Chain, angles: Array, rates: Array | None) -> WallFrame:
    line = WallLine(chain, DEFAULTS.walls, DEFAULTS.report)
    return WallFrame(chain, line, FrameState(chain, angles), rates, EXACT)


def test_what_is_within_reach_and_the_wake_are_the_whole() -> None:
    rng = np.random.default_rng(1)
    angles = RING.uniform_state(1) + rng.normal(0, 0.1, 60)
    rates = rng.normal(0, 1.0, 60)
    frame = frame_of(RING, angles, rates)
    reporter = StateReporter(RING)
    for places in ([58.3], [2.0, 30.7], [5.0 * n for n in range(12)]):
        energies = reporter.energies(FrameState(RING, angles), places, rates)
        assert frame.energy(places) == pytest.approx(energies.wall, rel=1e-12)
    assert frame.energy([float(n) for n in range(60)]) == pytest.approx(energies.whole, rel=1e-12)
    assert np.isnan(frame_of(RING, angles, None).energy([3.0]))


@pytest.mark.parametrize('leg', [0, 1])
def test_a_turn_is_that_of_the_rotors_in_the_wall(leg: int) -> None:
    angles = static_wall(SPINNER, 30.4, leg)
    before = SPINNER.uniform_state(1)
    turned = np.unwrap((angles - before)[5:60])
    frame = frame_of(SPINNER, angles, None)
    assert frame.turn(30.4, 70.0) == np.sign(turned[-1] - turned[0])
