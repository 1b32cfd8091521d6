# SPDX-License-Identifier: Apache-2.0
"""Work of kicks, torques, gravity and damping is the energy that the chain gains."""

import dataclasses

import numpy as np
import pytest
from chains import EXAMPLES, FLIPPER, SPINNER, WOBBLER, chain_of
from deviating_chains import deviating
from energy_balance import EnergyBalance

from soliton_linkage.actuation.actuators import PneumaticActuator
from soliton_linkage.actuation.edge_command import CommandKind, EdgeCommand
from soliton_linkage.actuation.torque_drive import TorqueDrive
from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.dynamics.rigid import RigidSimulation
from soliton_linkage.dynamics.work import TorqueLedger, work_of_impulse
from soliton_linkage.linear.rigidity import Edge, mode_towards_last
from soliton_linkage.linkage.gravity import Gravity

PERIOD = 0.01
PNEUMATICS = PneumaticActuator()
ORDERS = [
    EdgeCommand(Edge.FIRST, CommandKind.PULSE, 0.005, 0.1, 0.01, 0.03),
    EdgeCommand(Edge.FIRST, CommandKind.PRESSURE, 1e5, 0.1, 0.02),
]


@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
@pytest.mark.parametrize('example', [FLIPPER, WOBBLER, SPINNER])
def test_the_balance_closes_over_a_run_with_all_that_can_act(example, mechanics):
    for damping in [0.0, 0.5]:
        bare = chain_of(example, 12)
        chain = dataclasses.replace(bare, damping=damping * bare.moment_of_inertia)
        chain = deviating(chain, 5, 0.01)
        state = with_soliton(chain, 4.2, 0.5)
        simulation = mechanics(chain, state.angles, state.rates, PERIOD, 1e-12, Gravity(9.81, 0.2))
        balance = EnergyBalance(simulation)
        random = np.random.default_rng(2)
        scale = bare.moment_of_inertia
        for frame in range(90):
            if frame % 30 == 10:
                balance.kick(scale * random.normal(size=12))
            if frame % 30 == 20:
                balance.turn(Gravity(9.81, random.uniform(-0.5, 0.5)))
            pulse = 20 * scale * random.normal(size=12) if 30 <= frame < 60 else np.zeros(12)
            balance.advance(pulse)
            assert balance.imbalance < 1e-9
        assert abs(simulation.energy_drift) < 1e-9
        assert (simulation.dissipated > 0) == (damping > 0)


def test_unrecorded_work_is_missing():
    chain = chain_of(FLIPPER, 6)
    rates = np.ones(6)
    simulation = ElasticSimulation(chain, chain.uniform_state(-1), rates, PERIOD)
    balance = EnergyBalance(simulation)
    before = simulation.energy
    simulation.kick(chain.moments_of_inertia)
    assert simulation.energy == pytest.approx(4 * before)
    assert balance.imbalance == pytest.approx(3 / 4)


def test_without_energy_none_is_missing():
    chain = chain_of(FLIPPER, 6)
    simulation = RigidSimulation(chain, chain.uniform_state(-1), None, PERIOD)
    assert EnergyBalance(simulation).imbalance == 0


@pytest.mark.parametrize('mechanics', [ElasticSimulation, RigidSimulation])
@pytest.mark.parametrize('order', ORDERS, ids=lambda order: order.kind.value)
def test_the_work_entered_is_the_energy_that_the_chain_gains(order, mechanics):
    for example in EXAMPLES[:1] + EXAMPLES[2:3] + EXAMPLES[4:5]:
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
