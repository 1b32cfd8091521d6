# SPDX-License-Identifier: Apache-2.0
"""Tables of walls are the chain's own walls between their points, too."""

from __future__ import annotations

import numpy as np
import pytest

from soliton_linkage.estimation.loops import wall_loops
from soliton_linkage.estimation.walls.wall_shapes import WallShapes
from soliton_linkage.linkage.chain import Chain, Motion, staggered, wrapped
from soliton_linkage.solitons.static_wall import static_wall

CHAINS = {
    'flipper': Chain(81, rest_angle=0.97),
    'wobbler': Chain(81, rotor_length=0.1, rest_angle=0.77),
    'spinner': Chain(121, rotor_length=0.2, rest_angle=1.18),
}
EDGE = 5


@pytest.mark.parametrize('name', CHAINS)
def test_a_kink_leaves_nothing_of_a_static_wall_and_its_image_nothing_of_an_image(
    name: str,
) -> None:
    chain, shapes = CHAINS[name], WallShapes(CHAINS[name])
    legs = (0, 1) if chain.motion is Motion.SPINNER else (0,)
    for leg in legs:
        for place in (40.0, 40.33, 41.07, 40.5):
            angles = static_wall(chain, place, leg)
            steps = wrapped(np.diff(angles - chain.uniform_state(1)))[EDGE:-EDGE]
            turn = int(np.sign(steps.sum())) if len(legs) > 1 else 0
            theta, last = staggered(angles), chain.number_of_rotors - 1
            for charge, seen, centre in (
                (1, theta, place),
                (-1, np.ascontiguousarray(theta[::-1]), last - place),
            ):
                table = shapes(charge, turn * charge).table
                inner = seen[EDGE:-EDGE]
                left = np.empty_like(inner)
                wall_loops.leave(inner, EDGE, table, centre, 1.0, left)
                assert np.abs(left).max() < 1e-4
                start = centre + 0.2
                found, *_ = wall_loops.fit(inner, EDGE, table, start, 1.0, 1e-2, 2.5, False)
                assert found == pytest.approx(centre, abs=1e-4)
