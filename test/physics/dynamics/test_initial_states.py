# SPDX-License-Identifier: Apache-2.0
"""Initial states: relaxed springs, and walls with a specified position and velocity."""

import math

import numpy as np
import pytest
from chains import CLASSES, EPS, chain_of
from deviating_chains import deviating, rounding

from soliton_linkage.dynamics.initial_states import leaning, with_soliton
from soliton_linkage.linear.rigidity import rigidity_matrix
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.solitons.static_wall import effective_mass, static_wall


@pytest.mark.parametrize('example', CLASSES)
def test_a_chain_that_leans_is_at_rest_with_its_springs_relaxed(example):
    for lean in [-1, 1]:
        bare = chain_of(example, 10)
        state = leaning(bare, lean)
        assert np.array_equal(state.angles, bare.uniform_state(lean))
        assert not state.rates.any()
        chain = deviating(bare, 2, 0.01)
        state = leaning(chain, lean)
        assert np.abs(chain.spring_extensions(state.angles)).max() <= 2 * rounding(chain)
        assert not state.rates.any()


@pytest.mark.parametrize('example', CLASSES)
def test_a_soliton_is_a_wall_with_its_kinetic_energy_and_stretches_no_spring(example):
    for velocity in [-0.2, 0.0, 1.5]:
        chain = chain_of(example, 30)
        state = with_soliton(chain, 11.3, velocity)
        assert np.array_equal(state.angles, static_wall(chain, 11.3))
        kinetic = effective_mass(chain) * velocity**2 / 2
        assert float(chain.kinetic_energy(state.rates)) == pytest.approx(kinetic, rel=1e-9)
        stretching = rigidity_matrix(chain, state.angles) @ state.rates
        assert np.abs(stretching).max() <= 100 * EPS * chain.rotor_length * 300


def test_a_velocity_that_is_no_number_is_rejected():
    for velocity in [math.nan, math.inf]:
        with pytest.raises(ValueError, match=f'velocity of the soliton = {velocity} m/s must be'):
            with_soliton(Chain(10), 5.0, velocity)


def test_a_place_beyond_the_chain_is_rejected():
    with pytest.raises(ValueError, match=r'site = 9\.5 must lie in the range 0 to'):
        with_soliton(Chain(10), 9.5, 1.0)
