# SPDX-License-Identifier: Apache-2.0
"""The topic delivery has the exact effect of commands on the chain, also after resets."""

import numpy as np
import pytest
from graphs import Graph
from sensor_msgs.msg import JointState
from simulated_streams import CHAIN, RATE, ROTORS, Paused

from soliton_linkage_msgs.msg import Delivery, RotorImpulses
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_from_msg

TORQUE = JointState(name=['rotor_2', 'rotor_0'], effort=[2e-3, -1e-3])
TORQUES = np.array([-1e-3, 0.0, 2e-3, *[0.0] * (ROTORS - 3)])
IMPULSE = RotorImpulses(name=['rotor_1'], impulse=[3e-4])


class Rig(Paused):
    """A paused simulator that is stepped, and its deliveries."""

    def __init__(self, graph: Graph) -> None:
        self.measured: list[Delivery] = graph.hear(interfaces.DELIVERY)
        super().__init__(graph, {'command_timeout': 0.0})
        self.publishers = {
            topic.name: graph.speak(topic)
            for topic in (interfaces.ROTOR_IMPULSES, interfaces.ROTOR_TORQUES)
        }
        self.play(1)

    def say(self, topic: interfaces.Topic, message: object) -> None:
        pending = self.node.control.status.pending
        self.publishers[topic.name].publish(message)
        self.graph.until(lambda: self.node.control.status.pending > pending, 'the command')

    def play(self, periods: int) -> None:
        """Publish frames, and wait for the deliveries that precede the next report."""
        self.taken(periods)
        self.graph.next_report('simulator')

    def energy(self) -> float:
        return float(self.node.control.status.energy)


@pytest.fixture
def rig(graph):
    return Rig(graph)


def test_nothing_is_measured_while_nothing_acts(rig):
    rig.play(5)
    (first,) = rig.measured
    assert (first.impulses, first.work_of_impulses, first.work_of_torques) == (0, 0.0, 0.0)
    assert not first.torques_act
    assert list(first.impulse_of_torques) == [0.0] * ROTORS


def test_torques_are_measured_frame_by_frame_and_once_more(rig):
    rig.say(interfaces.ROTOR_TORQUES, TORQUE)
    rig.play(4)
    rig.say(interfaces.ROTOR_TORQUES, JointState(name=['rotor_0'], effort=[0.0]))
    rig.play(5)
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
    rig.play(3)
    before = rig.measured[-1]
    assert before.impulses == 1
    assert before.work_of_impulses == pytest.approx((3e-4) ** 2 / (2 * CHAIN.moment_of_inertia))
    assert rig.reset().success
    rig.play(2)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.play(3)
    after = rig.measured[-1]
    assert after.impulses == 3
    gained = after.work_of_impulses - before.work_of_impulses
    assert gained == pytest.approx(rig.energy(), rel=1e-9)


def test_an_impulse_right_before_a_reset_is_measured(rig):
    rig.play(1)
    rig.say(interfaces.ROTOR_IMPULSES, IMPULSE)
    rig.play(1)
    assert rig.measured[-1].impulses == 0
    assert rig.reset().success
    rig.play(2)
    entry = rig.measured[-1]
    assert entry.impulses == 1
    assert entry.work_of_impulses == pytest.approx((3e-4) ** 2 / (2 * CHAIN.moment_of_inertia))
