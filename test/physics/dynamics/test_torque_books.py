# SPDX-License-Identifier: Apache-2.0
"""The books of impulses and torques agree with the energy of the chain."""

from __future__ import annotations

import numpy as np
import pytest
from chains import EXAMPLES, chain_of

from soliton_linkage.actuation.edge_drive import EdgeOrder, Kind
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.dynamics.torque_books import TorqueBooks, work_of_impulse
from soliton_linkage.linear.rigidity import Edge, mode_towards_last

PNEUMATICS = PneumaticActuator()
ORDERS = [
    EdgeOrder(Edge.FIRST, Kind.PULSE, 0.005, 0.1, 0.01, 0.03),
    EdgeOrder(Edge.FIRST, Kind.PRESSURE, 1e5, 0.1, 0.02),
]


@pytest.mark.parametrize('example', EXAMPLES[:1] + EXAMPLES[2:3] + EXAMPLES[4:5])
@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
@pytest.mark.parametrize('order', ORDERS, ids=lambda order: order.kind.value)
def test_the_work_booked_is_the_energy_that_the_chain_gains(
    order: EdgeOrder, mechanics: type[Simulation], example: tuple[float, float]
) -> None:
    chain = chain_of(example, 10)
    simulation = mechanics(chain, chain.uniform_state(-1), period=0.005)
    drive = TorqueDrive(chain, PNEUMATICS, timeout=0.0)
    drive.edges.obey(order, Edge.FIRST, 0.0)
    drive.joints.follow(
        np.array([4, 2]), np.array([0.1, 0.2]), np.array([[1e-3, -2e-3], [0.0, 0.0]]), 0.0
    )
    books = TorqueBooks(10)
    before = simulation.energy
    for _ in range(80):
        start, angles = simulation.time, simulation.angles
        torques = drive.torques(angles, start, start + simulation.period).torques
        simulation.hold(torques)
        simulation.advance()
        books.add(torques, simulation.angles - angles, simulation.period)
    gained = simulation.energy - before
    assert gained > 1e-6
    assert books.account.work == pytest.approx(gained, rel=1e-8)
    assert 0 < books.account.peak_torque < 0.02
    assert 0.1 < books.account.duration <= 0.4 + 1e-9


def test_a_torque_of_known_size_gives_its_impulse() -> None:
    books = TorqueBooks(3)
    torques = np.array([1.0, 0.0, -2.0])
    books.add(torques, np.array([0.5, 9.0, 0.25]), 0.1)
    books.add(0 * torques, np.ones(3), 0.3)
    account = books.account
    np.testing.assert_allclose(account.impulse, [0.1, 0.0, -0.2])
    assert account.work == pytest.approx(0.0)
    assert account.peak_torque == pytest.approx(np.sqrt(5))
    assert account.duration == pytest.approx(0.1)


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_work_of_an_impulse_is_what_the_kick_gives(example: tuple[float, float]) -> None:
    chain = chain_of(example, 8)
    start = chain.uniform_state(-1)
    simulation = ElasticSimulation(chain, start, 2.0 * mode_towards_last(chain, start), 0.05)
    simulation.advance()
    impulses = np.random.default_rng(5).normal(scale=1e-4, size=8)
    expected = work_of_impulse(chain, simulation.rates, impulses)
    before = simulation.energy
    simulation.kick(impulses)
    gained = simulation.energy - before
    assert expected == pytest.approx(gained, rel=1e-9)
    assert (simulation.kicks, simulation.kick_work) == (1, pytest.approx(gained, rel=1e-9))
