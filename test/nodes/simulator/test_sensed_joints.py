# SPDX-License-Identifier: Apache-2.0
"""Joint states: exact without errors, else as encoders show them, without the missing joints."""

from dataclasses import replace

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.encoders import EncoderErrors
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.simulator.frame_publisher import SensedJoints

PERIOD = 0.01
NOISY = EncoderErrors(noise=0.05, quantisation=0.001, offsets=(0.1,) * 8, seed=4)


def moving(named: NamedChain) -> Simulation:
    chain = named.chain
    return ElasticSimulation(chain, chain.uniform_state(-1), np.linspace(-5, 5, 8), PERIOD)


def read(joints: SensedJoints, frame: int, simulation: Simulation) -> JointState:
    return deserialize_message(bytes(joints.fill(10**9, frame, simulation)), JointState)


def test_without_errors_the_readings_are_exact(named):
    for missing in [(), (0, 5), (7,)]:
        joints, simulation = SensedJoints(named, PERIOD, EncoderErrors(), missing), moving(named)
        shown = [rotor for rotor in range(8) if rotor not in missing]
        for frame in range(3):
            message = read(joints, frame, simulation)
            assert message.name == [f'rotor_{rotor}' for rotor in shown]
            assert list(message.position) == simulation.angles[shown].tolist()
            assert list(message.velocity) == simulation.rates[shown].tolist()
            assert list(message.effort) == simulation.link_torques[shown].tolist()
            simulation.advance()


def test_known_offsets_are_read_besides_errors(named):
    known = np.linspace(-0.1, 0.1, 8)
    biased = replace(named, encoder_offsets=tuple(known))
    simulation = moving(named)
    for errors in (EncoderErrors(), EncoderErrors(offsets=(0.2,) * 8)):
        joints = SensedJoints(biased, PERIOD, errors, ())
        expected = simulation.angles + known + (errors.offsets or 0.0)
        np.testing.assert_allclose(read(joints, 0, simulation).position, expected, atol=1e-15)


def test_another_simulation_has_no_frame_before(named):
    joints = SensedJoints(named, PERIOD, NOISY, ())
    read(joints, 0, moving(named))
    simulation = moving(named)
    assert not any(read(joints, 1, simulation).velocity)
    simulation.advance()
    assert all(read(joints, 2, simulation).velocity)
