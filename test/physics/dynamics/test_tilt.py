# SPDX-License-Identifier: Apache-2.0
"""A tilt drives the soft mode: the wall falls from edge to edge (paper, Movie S2)."""

import dataclasses
import math

import numpy as np
import pytest
from chains import FLIPPER, WIDE_FLIPPER, WOBBLER, chain_of

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import leaning
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.linear.rigidity import mode_centre, zero_mode
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.solitons.static_wall import static_wall

STRENGTH = 9.81


def test_two_rotors_on_a_wall_has_fallen_by_twice_their_swing():
    """U(X + 2) - U(X) = -4 M g ubar sin(tilt): each rotor goes from -ubar to ubar."""
    for example in [FLIPPER, WIDE_FLIPPER, WOBBLER]:
        for tilt in [-1.0, 0.0, 0.3]:
            chain = chain_of(example, 80)
            field = Gravity(STRENGTH, tilt)
            swing = chain.rotor_length * math.sin(chain.rest_angle)
            expected = -4 * chain.mass * STRENGTH * swing * math.sin(tilt)
            for place in (38.5, 39.1):
                here, there = static_wall(chain, place), static_wall(chain, place + 2)
                fallen = float(field.energy(chain, there) - field.energy(chain, here))
                assert fallen == pytest.approx(expected, rel=1e-9, abs=1e-12 * field.scale(chain))


@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
def test_tilting_to_and_fro_sends_the_wall_from_edge_to_edge_and_back(mechanics):
    chain = dataclasses.replace(chain_of(FLIPPER, 12), damping=3e-4)
    start = leaning(chain, -1)
    simulation = mechanics(chain, start.angles, start.rates, 0.05, 1e-8, Gravity(STRENGTH, -0.25))

    def centre() -> float:
        return mode_centre(zero_mode(chain, simulation.angles))

    centres = []
    for tilt in (0.25, -0.25, 0.25):
        simulation.set_gravity(Gravity(STRENGTH, tilt))
        for _ in range(60):
            simulation.advance()
        centres.append(centre())
    assert [centre > 6 for centre in centres] == [True, False, True]
    assert np.abs(np.array(centres) - 5.5).min() > 4.5
    assert simulation.dissipated > 0
    assert np.abs(simulation.energy_drift) < 1e-6
