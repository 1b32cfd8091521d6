# SPDX-License-Identifier: Apache-2.0
"""The topic delivery has the exact effect of commands on the chain, also after resets."""

import numpy as np
import pytest
from graphs import Graph
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg
from soliton_linkage_nodes.simulator.node import Simulator

ROTORS = 6
RATE = 200.0
CHAIN = Chain(number_of_rotors=ROTORS)
TORQUE = JointState(name=['rotor_2', 'rotor_0'], effort=[2e-3, -1e-3])
TORQUES = np.array([-1e-3, 0.0, 2e-3, 0.0, 0.0, 0.0])
IMPULSE = RotorImpulses(name=['rotor_1'], impulse=[3e-4])


class Rig:
    """A paused simulator that is stepped, and its deliveries."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.measured: list[Delivery] = graph.hear(interfaces.DELIVERY)
        given = {'chain.number_of_rotors': ROTORS, 'publish_rate': RATE, 'command_timeout': 0.0}
        self.node = graph.start(Simulator, given)
        self.publishers = {
            topic.name: graph.speak(topic)
            for topic in (interfaces.ROTOR_IMPULSES, interfaces.ROTOR_TORQUES)
        }
        assert graph.call(SetBool, 'simulator/pause', data=True).success
        self.step(1)
        graph.until(lambda: self.measured, 'the first entry')

    def say(self, topic: interfaces.Topic, message: object) -> None:
        pending = self.node.control.status.pending
        self.publishers[topic.name].publish(message)
        self.graph.until(lambda: self.node.control.status.pending > pending, 'the command')

    def step(self, periods: int) -> None:
        """Step one by one, because a latched topic keeps only the last message."""
        for _ in range(periods):
            assert self.node.control.step(1) is None
            self.graph.next_report('simulator')

    def energy(self) -> float:
        return float(self.node.control.status.energy)


@pytest.fixture
def rig(graph):
    return Rig(graph)


def test_nothing_is_measured_while_nothing_acts(rig):
    rig.step(5)
    (first,) = rig.measured
    assert (first.impulses, first.work_of_impulses, first.work_of_torques) == (0, 0.0, 0.0)
    assert not first.torques_act
    assert list(first.impulse_of_torques) == [0.0] * ROTORS


def test_torques_are_measured_frame_by_frame_and_once_more(rig):
    rig.say(interfaces.ROTOR_TORQUES, TORQUE)
    rig.step(4)
    rig.say(interfaces.ROTOR_TORQUES, JointState(name=['rotor_0'], effort=[0.0]))
    rig.step(5)
    entries = rig.measured[1:]
    assert [entry.torques_act for entry in entries] == [True] * 4 + [False]
    stamps = np.diff([time_from_msg(entry.header.stamp) for entry in entries])
    np.testing.assert_allclose(stamps, 1e9 / RATE, atol=1)
    for number, entry in enumerate(entries, start=1):
        acted = min(number, 4) / RATE
        np.testing.assert_allclose(entry.impulse_of_torques, acted * TORQUES, rtol=1e-12)
    assert entries[-1].work_of_torques == pytest.approx(rig.energy(), rel=1e-9)
    assert entries[-1].work_of_impulses == 0.0


def test_the_energy_balance_continues_through_a_reset(rig):
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.step(3)
    before = rig.measured[-1]
    assert before.impulses == 1
    assert before.work_of_impulses == pytest.approx((3e-4) ** 2 / (2 * CHAIN.moment_of_inertia))
    assert rig.graph.call(Reset, 'simulator/reset').success
    rig.step(2)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.step(3)
    after = rig.measured[-1]
    assert after.impulses == 3
    gained = after.work_of_impulses - before.work_of_impulses
    assert gained == pytest.approx(rig.energy(), rel=1e-9)


def test_an_impulse_right_before_a_reset_is_measured(rig):
    rig.step(1)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.step(1)
    assert rig.measured[-1].impulses == 0
    assert rig.graph.call(Reset, 'simulator/reset').success
    rig.step(2)
    entry = rig.measured[-1]
    assert entry.impulses == 1
    assert entry.work_of_impulses == pytest.approx((3e-4) ** 2 / (2 * CHAIN.moment_of_inertia))
