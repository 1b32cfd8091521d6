# SPDX-License-Identifier: Apache-2.0
"""Computed travelling walls keep their shape and speed in simulations."""

import numpy as np
import pytest
from meeting_walls import NARROW, SINE_GORDON, ring_of
from scipy.integrate import solve_ivp

from soliton_linkage.dynamics.equation_of_motion import EquationOfMotion
from soliton_linkage.dynamics.integrators import SymplecticNystrom
from soliton_linkage.linear.bands import speed_of_sound
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.continuum import FlipperTheory
from soliton_linkage_studies.collisions.travelling_wall import travelling_wall


@pytest.mark.parametrize('charge', [1, -1])
@pytest.mark.parametrize(('example', 'most'), [(NARROW, 1e-6), (SINE_GORDON, 1e-5)])
def test_a_travelling_wall_keeps_its_shape(example, most, charge):
    ring = ring_of(example, 30.0)
    # The angles on both sides differ by about half a turn, which free ends allow.
    chain = Chain(ring.number_of_rotors, 1.0, ring.rotor_length, ring.rest_angle, 1.0, 1.0)
    velocity = 0.3 * speed_of_sound(chain)
    wall = travelling_wall(chain, velocity, charge)
    rotors = np.arange(chain.number_of_rotors)
    begin, way = len(rotors) // 2 - 4, 8
    angles, slopes = wall.at(rotors, begin)
    motion = EquationOfMotion(chain)
    moved = solve_ivp(
        motion,
        (0, way / velocity),
        motion.state(angles, -velocity * slopes),
        method=SymplecticNystrom,
        atol=1e-10,
        rtol=0,
    )
    expected, _ = wall.at(rotors, begin + way)
    assert np.abs(moved.y[: len(rotors), -1] - expected).max() < most


def test_a_travelling_wall_agrees_with_the_continuum_for_small_d():
    for charge in [1, -1]:
        errors = []
        for rest_angle in (0.1, 0.2):
            chain = ring_of((0.5, rest_angle))
            velocity = 0.4 * speed_of_sound(chain)
            wall = travelling_wall(chain, velocity, charge)
            rotors = np.arange(0, 2 * round(3 / rest_angle), 2)
            angles, _ = wall.at(rotors, float(rotors[-1] / 2))
            theory = FlipperTheory(chain)
            expected = theory.displacements(rotors, rotors[-1] / 2, velocity, charge) / theory.lean
            errors.append(np.abs(np.sin(angles) / np.sin(rest_angle) - expected).max())
        assert errors[0] < 2e-3
        assert 3 < errors[1] / errors[0] < 5


def test_a_missing_travelling_wall_is_reported():
    chain = ring_of((2.0, 1.18))
    with pytest.raises(ArithmeticError, match=r'charge -1 in a chain with d = 3\.7'):
        travelling_wall(chain, 0.2 * speed_of_sound(chain), -1)
