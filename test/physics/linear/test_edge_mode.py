# SPDX-License-Identifier: Apache-2.0
"""An actuator at an edge pushes the wall away from its edge, or is rejected."""

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, chain_of
from linkage_motion import wall_between

from soliton_linkage.dynamics.elastic import simulate
from soliton_linkage.linear.rigidity import Edge, edge_mode, mode_towards_last
from soliton_linkage.linkage.chain import Motion
from soliton_linkage.solitons.track import follow


def test_the_nearest_edge_is_the_one_that_the_wall_is_nearer_to():
    for example in EXAMPLES:
        chain = chain_of(example, 20)
        for rotor, nearest in ((3, Edge.FIRST), (15, Edge.LAST)):
            assert Edge.NEAREST.resolved(chain, wall_between(chain, rotor)) is nearest
        assert Edge.NEAREST.resolved(chain, chain.uniform_state(-1)) is Edge.FIRST
        assert Edge.NEAREST.resolved(chain, chain.uniform_state(1)) is Edge.LAST
        for edge in [Edge.FIRST, Edge.LAST]:
            assert edge.resolved(chain, wall_between(chain, 3)) is edge


@pytest.mark.parametrize('example', EXAMPLES)
def test_a_push_or_a_pull_at_an_edge_sends_the_wall_across_the_chain(example):
    for sense in [-1, 1]:
        for lean, rotors in [(-1, 12), (1, 13)]:
            chain = chain_of(example, rotors)
            start = chain.uniform_state(lean)
            speed = 0.8 if chain.motion is Motion.SPINNER else 0.06
            rate = sense * speed * chain.spacing / chain.rotor_length / chain.time_unit
            duration = 120 * chain.time_unit
            rates = rate * edge_mode(chain, start, Edge.NEAREST)
            recording = simulate(chain, start, rates, duration, duration / 40, 1e-6)
            places = follow(chain, recording).sites
            seen = places[np.isfinite(places)]
            from_edge = seen if lean < 0 else rotors - 1 - seen
            assert from_edge[0] < rotors / 3
            assert from_edge.max() > from_edge[0] + 1


def test_an_edge_that_the_mode_is_far_from_is_rejected_unless_it_may_be_anywhere():
    chain = chain_of(FLIPPER, 20)
    angles = wall_between(chain, 3)
    complaint = (
        r'the centre of the zero mode is at rotor 3\.5 of 0 to 19, nearer the first edge than the '
        'last; choose the first edge'
    )
    with pytest.raises(ValueError, match=complaint):
        edge_mode(chain, angles, Edge.LAST)
    pushed = edge_mode(chain, angles, Edge.LAST, anywhere=True)
    assert np.array_equal(pushed, -mode_towards_last(chain, angles))
