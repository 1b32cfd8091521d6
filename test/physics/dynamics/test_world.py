# SPDX-License-Identifier: Apache-2.0
"""The world by its parameters: mechanics, states to start from, joints by name or number."""

import dataclasses

import numpy as np
import pytest

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.world import World, WorldParameters, joint_numbers
from soliton_linkage.linkage.chain import Chain
from soliton_linkage.linkage.gravity import NO_GRAVITY, Gravity

CHAIN = Chain(number_of_rotors=8)
NAMES = tuple(f'rotor_{rotor}' for rotor in range(8))


def world(chain: Chain = CHAIN, **parameters: object) -> World:
    return World(chain, NAMES, dataclasses.replace(WorldParameters(), **parameters), 0.01)


def test_the_mechanics_are_springs_or_bars():
    for mechanics, kind in [('elastic', ElasticSimulation), ('rigid', RigidSimulation)]:
        one = world(mechanics=mechanics, tolerance=1e-6)
        gravity = Gravity(9.81, 0.2)
        simulation = one.begin(one.initial_state(), gravity)
        assert type(simulation) is kind
        assert (simulation.period, simulation.tolerance) == (0.01, 1e-6)
        assert simulation.gravity == gravity


def test_it_starts_leaning_to_a_side():
    for name, lean in [('left_leaning', -1), ('right_leaning', 1)]:
        state = world(initial_state=name).initial_state()
        assert np.array_equal(state.angles, CHAIN.uniform_state(lean))
        assert not state.rates.any()


def test_it_starts_with_a_soliton():
    one = world(initial_state='soliton', initial_position=3.25, initial_velocity=-0.5)
    expected = with_soliton(CHAIN, 3.25, -0.5)
    assert np.array_equal(one.initial_state().angles, expected.angles)
    assert np.array_equal(one.initial_state().rates, expected.rates)


def test_bars_between_periodic_ends_and_bars_with_a_fixed_rotor_are_rejected():
    ring = dataclasses.replace(CHAIN, periodic=True)
    for stuck in (world(ring, mechanics='rigid'), world(mechanics='rigid', fixed_rotors=('1',))):
        with pytest.raises(ValueError, match='or choose elastic mechanics'):
            stuck.begin(stuck.initial_state(), NO_GRAVITY)


def test_fixed_rotors_are_those_of_the_simulation():
    one = world(fixed_rotors=('rotor_7', '2', 'rotor_2'))
    assert one.begin(one.initial_state(), NO_GRAVITY).fixed == (2, 7)


def test_a_joint_is_identified_by_its_name_or_else_its_number():
    assert joint_numbers('these', ('b', '0', 'a'), ('a', 'b', 'c')) == (0, 1)
    assert joint_numbers('these', ('0',), ('1', '0')) == (1,)
    assert joint_numbers('these', (), ('a', 'b')) == ()
    with pytest.raises(ValueError, match=r"these names joint '3', which is none of 'a' to 'c' or"):
        joint_numbers('these', ('3',), ('a', 'b', 'c'))
