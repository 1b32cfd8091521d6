# SPDX-License-Identifier: Apache-2.0
"""Shifts of walls by deviations, against chains that have one after the other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linear.statics import unstretched
from soliton_linkage.linkage.chain import Array, Chain
from soliton_linkage.linkage.deviations import Deviations
from soliton_linkage.orbit import UniformOrbit
from soliton_linkage.orbit.wall_shifts import WallShifts

ROTORS, SMALL = 13, 1e-5
FLIPPER, WOBBLER, SPINNER = (0.9, 0.7), (0.8, 1.6), (1.1, 3.4)
"""Rest angles [rad] and lean ratios d."""


def chain_of(rest_angle: float, lean_ratio: float) -> Chain:
    length = lean_ratio * Chain.spacing / (2 * math.sin(rest_angle))
    return Chain(ROTORS, rotor_length=length, rest_angle=rest_angle)


def left_share(chain: Chain, near: Array, bond: int) -> float:
    """Share of |t|^2 on the left of a bond, where all bars fit next to given angles."""
    return float(np.sum(zero_mode(chain, unstretched(chain, near))[: bond + 1] ** 2))


def deviating(chain: Chain) -> list[Chain]:
    """Chains of which one spacing or one rotor is longer by a small share each."""
    single = SMALL * np.eye(2 * ROTORS - 1)
    return [
        replace(chain, deviations=Deviations(tuple(row[: ROTORS - 1]), tuple(row[ROTORS - 1 :])))
        for row in single.tolist()
    ]


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
@pytest.mark.parametrize(('bond', 'leg'), [(5, 0), (6, 1), (1, 1)])
def test_a_wall_is_shifted_by_what_moves_half_of_its_mode(
    example: tuple[float, float], bond: int, leg: int
) -> None:
    chain = chain_of(*example)
    orbit = UniformOrbit(chain)
    arc = orbit.arc_at(bond + 0.5, leg)
    here, far = orbit.configuration(arc), orbit.configuration(orbit.arc_at(orbit.middle, 0))
    ahead, behind = (orbit.configuration(arc + step) for step in (SMALL, -SMALL))
    slope = (left_share(chain, ahead, bond) - left_share(chain, behind, bond)) / (2 * SMALL)
    even = left_share(chain, here, bond)
    shifts = [(left_share(each, here, bond) - even) / slope for each in deviating(chain)]
    turns = [unstretched(each, far)[1] - far[1] for each in deviating(chain)]
    expected = np.linalg.norm(shifts) / np.linalg.norm(turns)
    assert WallShifts(orbit).ratio(bond + 0.5, leg) == pytest.approx(expected, rel=1e-4)
