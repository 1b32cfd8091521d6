# SPDX-License-Identifier: Apache-2.0
"""The path of a wall from rotor to rotor: the rotor that moves most, all the way round."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of

from soliton_linkage.linear.rigidity import zero_mode
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.deviations import drawn_deviations
from soliton_linkage.orbit.seed_path import SeedPath, seed_path
from soliton_linkage.solitons.static_wall import hung_from

ROTORS = 16
BESIDE = ROTORS - 1
EXAMPLES = pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])


def deviating(example: tuple[float, float]) -> Chain:
    drawn = drawn_deviations(ROTORS, 5, rotor_length=0.05, spacing=0.05, rest_length=0.05)
    return dataclasses.replace(chain_of(example, ROTORS), deviations=drawn)


def sides(path: SeedPath, piece: int) -> tuple[list[int], list[int]]:
    """Sides of all bars of the chain, picked from those beside the seed."""
    bars = np.arange(ROTORS - 1) - int(path.seeds[piece]) + BESIDE
    return path.left_sides[piece][bars].tolist(), path.right_sides[piece][bars].tolist()


@EXAMPLES
def test_the_seed_moves_most(example: tuple[float, float]) -> None:
    chain = deviating(example)
    path = seed_path(chain, BESIDE)
    for piece, seed in enumerate(path.seeds.tolist()):
        left, right = (np.array(each, dtype=np.float64) for each in sides(path, piece))
        for angle in np.linspace(path.begins[piece], path.ends[piece], 7).tolist():
            mode = np.abs(zero_mode(chain, hung_from(chain, seed, angle, left, right)))
            assert mode[seed] >= mode.max() * (1 - 1e-6)


@EXAMPLES
def test_every_rotor_is_a_seed_in_every_leg(example: tuple[float, float]) -> None:
    path = seed_path(deviating(example), BESIDE)
    ways = 2 if example == SPINNER else 4
    assert np.bincount(path.seeds, minlength=ROTORS)[1:-1].min() >= ways
    assert path.seeds[0] == path.seeds[-1]
