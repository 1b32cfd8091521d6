# SPDX-License-Identifier: Apache-2.0
"""Energy books: what kicks, torques, gravity and damping give and take is what the chain has."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from chains import FLIPPER, SPINNER, WOBBLER, chain_of
from deviating_chains import deviating

from soliton_linkage.chain import Array
from soliton_linkage.elastic_simulation import ElasticSimulation
from soliton_linkage.gravity import Gravity
from soliton_linkage.initial_states import with_soliton
from soliton_linkage.rigid_simulation import RigidSimulation
from soliton_linkage.simulation import Simulation

PERIOD = 0.01


def mechanical_energy(simulation: Simulation, springs: bool) -> float:
    chain, angles = simulation.chain, simulation.angles
    energy = float(chain.kinetic_energy(simulation.rates))
    energy += float(simulation.gravity.energy(chain, angles))
    return energy + (float(chain.elastic_energy(angles)) if springs else 0.0)


class Books:
    """Adds up the work of all that acts on a simulation, each from its own law."""

    def __init__(self, simulation: Simulation, springs: bool) -> None:
        self.simulation = simulation
        self.springs = springs
        self.start = self.energy
        self.given = 0.0
        self.largest = abs(self.start)

    @property
    def energy(self) -> float:
        return mechanical_energy(self.simulation, self.springs)

    def kick(self, impulses: Array) -> None:
        """W = sum_n J_n (rate before + rate after) / 2; bars bear what is not along the mode."""
        before = self.simulation.rates
        self.simulation.kick(impulses)
        self.given += float(impulses @ (before + self.simulation.rates)) / 2

    def turn(self, gravity: Gravity) -> None:
        before = self.energy
        self.simulation.turn_gravity(gravity)
        self.given += self.energy - before

    def advance(self, torques: Array) -> None:
        before = self.simulation.angles
        self.simulation.hold(torques)
        self.simulation.advance()
        self.given += float(torques @ (self.simulation.angles - before))
        self.largest = max(self.largest, abs(self.energy))

    @property
    def gap(self) -> float:
        missing = self.start + self.given - self.simulation.dissipated - self.energy
        return abs(missing) / self.largest


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
    books = Books(simulation, mechanics is ElasticSimulation)
    random = np.random.default_rng(2)
    scale = bare.moment_of_inertia
    for frame in range(90):
        if frame % 30 == 10:
            books.kick(scale * random.normal(size=12))
        if frame % 30 == 20:
            books.turn(Gravity(9.81, random.uniform(-0.5, 0.5)))
        pulse = 20 * scale * random.normal(size=12) if 30 <= frame < 60 else np.zeros(12)
        books.advance(pulse)
        assert books.gap < 1e-9
    assert abs(simulation.energy_drift) < 1e-9
    assert (simulation.dissipated > 0) == (damping > 0)
