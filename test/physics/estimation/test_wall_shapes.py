# SPDX-License-Identifier: Apache-2.0
"""Tables of walls are the chain's own walls between their points, too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from soliton_linkage.estimation import wall_loops
from soliton_linkage.estimation.wall_shapes import WallShape, WallShapes
from soliton_linkage.linkage.chain import Array, Chain, Motion, staggered
from soliton_linkage.solitons.anti_kink import anti_kink_path, resting_anti_kink
from soliton_linkage.solitons.static_wall import static_wall

CHAINS = {
    'flipper': Chain(81, rest_angle=0.97),
    'wobbler': Chain(81, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(121, rotor_length=0.2, rest_angle=1.18),
    'pinned wobbler': Chain(81, rotor_length=0.083, rest_angle=1.247),
}
EDGE = 5


def leaves_nothing(shape: WallShape, theta: Array, site: float) -> bool:
    """Whether a shape leaves nothing of the staggered angles of a wall, and finds its place."""
    inner = theta[EDGE:-EDGE]
    left = np.empty_like(inner)
    wall_loops.set_residuals(inner, EDGE, shape.table, site, 1.0, left)
    found, *_ = wall_loops.fit(inner, EDGE, shape.table, site + 0.2, 1.0, 1e-2, 2.5, False)
    return bool(np.abs(left).max() < 1e-4) and abs(found - site) < 1e-4


@pytest.mark.parametrize('name', CHAINS)
def test_a_kink_leaves_nothing_of_a_static_wall(name: str) -> None:
    chain, shapes = CHAINS[name], WallShapes(CHAINS[name])
    for leg in range(2 if chain.motion is Motion.SPINNER else 1):
        for site in (40.0, 40.33, 41.07, 40.5):
            theta = staggered(static_wall(chain, site, leg))
            assert leaves_nothing(shapes.of_leg(leg), theta, site)
            if name == 'wobbler':
                image = np.ascontiguousarray(theta[::-1])
                last = chain.number_of_rotors - 1
                assert leaves_nothing(shapes.anti_kinks[0], image, last - site)


def test_an_anti_kink_of_flippers_leaves_nothing_of_a_state_of_least_energy() -> None:
    chain, shapes = CHAINS['flipper'], WallShapes(CHAINS['flipper'])
    states = CubicSpline(*anti_kink_path(chain, 40.0))
    for site in (40.0, 40.33, 41.07, 41.5):
        assert leaves_nothing(shapes.anti_kinks[0], staggered(states(site)), site)


@pytest.mark.parametrize('name', ['spinner', 'pinned wobbler'])
def test_a_pinned_anti_kink_leaves_nothing_where_it_rests_and_its_image_a_rotor_on(
    name: str,
) -> None:
    chain, shapes = CHAINS[name], WallShapes(CHAINS[name])
    site, angles = resting_anti_kink(chain, 40.5)
    one, other = shapes.anti_kinks
    assert leaves_nothing(one, staggered(angles), site)
    assert leaves_nothing(other, np.roll(staggered(angles), 1), site + 1)
