# SPDX-License-Identifier: Apache-2.0
"""Energy books: what kicks, torques, gravity and damping give and take is what the chain has."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of
from deviating_chains import deviating

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.energy_books import EnergyBooks
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.gravity import Gravity

PERIOD = 0.01


@pytest.mark.parametrize('damping', [0.0, 0.5])
@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_the_books_close_over_a_run_with_all_that_can_act(
    example: tuple[float, float], mechanics: type[Simulation], damping: float
) -> None:
    bare = chain_of(example, 12)
    chain = dataclasses.replace(bare, damping=damping * bare.moment_of_inertia)
    chain = deviating(chain, 5, 0.01)
    state = with_soliton(chain, 4.2, 0.5)
    simulation = mechanics(chain, state.angles, state.rates, PERIOD, 1e-12, Gravity(9.81, 0.2))
    books = EnergyBooks(simulation)
    random = np.random.default_rng(2)
    scale = bare.moment_of_inertia
    for frame in range(90):
        if frame % 30 == 10:
            books.kick(scale * random.normal(size=12))
        if frame % 30 == 20:
            books.turn(Gravity(9.81, random.uniform(-0.5, 0.5)))
        pulse = 20 * scale * random.normal(size=12) if 30 <= frame < 60 else np.zeros(12)
        books.advance(pulse)
        assert books.imbalance < 1e-9
    assert abs(simulation.energy_drift) < 1e-9
    assert (simulation.dissipated > 0) == (damping > 0)


def test_what_is_not_booked_is_missing() -> None:
    chain = chain_of(FLIPPER, 6)
    rates = np.ones(6)
    simulation = ElasticSimulation(chain, chain.uniform_state(-1), rates, PERIOD)
    books = EnergyBooks(simulation)
    before = books.energy
    simulation.kick(chain.moments_of_inertia)
    assert books.energy == pytest.approx(4 * before)
    assert books.imbalance == pytest.approx(3 / 4)


def test_where_there_is_no_energy_none_is_missing() -> None:
    chain = chain_of(FLIPPER, 6)
    simulation = RigidSimulation(chain, chain.uniform_state(-1), None, PERIOD)
    assert EnergyBooks(simulation).imbalance == 0
