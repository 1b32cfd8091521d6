# SPDX-License-Identifier: Apache-2.0
"""Tails beside a wall: of two kinds, exact beside exact walls."""

import math

import numpy as np
import pytest
from chains import FLIPPER, STRONG_WOBBLER, WOBBLER, chain_of
from linkage_motion import wall_between

from soliton_linkage.linear.bands import exact_tail
from soliton_linkage.linkage.chain import staggered


def test_the_tail_changes_its_kind_at_d_1():
    rest_angle = 0.77
    for share, oscillates in ((1 - 1e-9, False), (1 + 1e-9, True)):
        chain = chain_of((share / (2 * math.sin(rest_angle)), rest_angle), 2)
        tail = exact_tail(chain)
        assert tail.wave_number == (math.pi / chain.spacing if oscillates else 0)
        assert tail.decay_length < chain.spacing / 20


@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, (1.2, 0.77), STRONG_WOBBLER, (1.8, 0.77)])
def test_the_exact_tail_is_that_of_the_exact_wall(example):
    chain = chain_of(example, 80)
    tail = exact_tail(chain)
    displacements = np.sin(staggered(wall_between(chain, 39))) - math.sin(chain.rest_angle)
    # From the wall outwards, deviations small beside 1 and large beside rounding.
    far = np.flatnonzero(np.abs(displacements[:39]) < 1e-5)
    far = far[np.abs(displacements[far]) > 1e-10]
    ratios = displacements[far[1:]] / displacements[far[1:] - 1]
    growth = math.exp(chain.spacing / tail.decay_length)
    growth *= math.cos(tail.wave_number * chain.spacing)
    assert len(ratios) >= 2
    assert ratios == pytest.approx(growth, rel=1e-3)
