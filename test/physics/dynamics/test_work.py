# SPDX-License-Identifier: Apache-2.0
"""Work of kicks, torques, gravity and damping is the energy that the chain gains."""

import numpy as np
import pytest
from chains import EXAMPLES, WIDE_FLIPPER, WIDE_SPINNER, chain_of

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.work import TorqueLedger, work_of_impulse
from soliton_linkage.linear.rigidity import Edge, mode_towards_last

PNEUMATICS = PneumaticActuator()
ORDERS = [
    EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.005, 0.1, 0.01, 0.03),
    EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 0.1, 0.02),
]


@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
@pytest.mark.parametrize('order', ORDERS, ids=lambda order: order.kind.value)
def test_the_work_entered_is_the_energy_that_the_chain_gains(order, mechanics):
    for example in (WIDE_FLIPPER, WIDE_SPINNER):
        chain = chain_of(example, 10)
        simulation = mechanics(chain, chain.uniform_state(-1), period=0.005)
        drive = TorqueDrive(chain, PNEUMATICS, timeout=0.0)
        drive.edges.command(order, Edge.FIRST, 0.0)
        drive.joints.follow(
            np.array([4, 2]), np.array([0.1, 0.2]), np.array([[1e-3, -2e-3], [0.0, 0.0]]), 0.0
        )
        ledger = TorqueLedger(10)
        before = simulation.energy
        for _ in range(80):
            start, angles = simulation.time, simulation.angles
            torques = drive.torques(angles, start, start + simulation.period).torques
            simulation.hold(torques)
            simulation.advance()
            ledger.add(torques, simulation.angles - angles, simulation.period)
        gained = simulation.energy - before
        assert gained > 1e-6
        assert ledger.totals.work == pytest.approx(gained, rel=1e-8)
        assert 0 < ledger.totals.peak_torque < 0.02
        assert 0.1 < ledger.totals.duration <= 0.4 + 1e-9


def test_a_torque_of_known_size_gives_its_impulse():
    ledger = TorqueLedger(3)
    torques = np.array([1.0, 0.0, -2.0])
    ledger.add(torques, np.array([0.5, 9.0, 0.25]), 0.1)
    ledger.add(0 * torques, np.ones(3), 0.3)
    totals = ledger.totals
    np.testing.assert_allclose(totals.impulse, [0.1, 0.0, -0.2])
    assert totals.work == pytest.approx(0.0)
    assert totals.peak_torque == pytest.approx(np.sqrt(5))
    assert totals.duration == pytest.approx(0.1)


@pytest.mark.parametrize('example', EXAMPLES)
def test_the_work_of_an_impulse_is_the_energy_of_the_kick(example):
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
