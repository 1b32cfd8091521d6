# SPDX-License-Identifier: Apache-2.0
"""Whatever is thrown at the actuator, the chain moves as the accepted commands alone have it."""

import math
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, Header

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg
from soliton_linkage_nodes.simulator.node import Simulator

ROTORS = 6
COMMANDS = 3000
SPEED = 0.25
STALE = Header(stamp=time_to_msg(10**18))


def flood() -> list[tuple[interfaces.Topic, Any]]:
    """Return commands, one in ten valid."""
    joints = interfaces.JOINT_COMMANDS
    wrong: list[tuple[interfaces.Topic, Any]] = [
        (interfaces.NUDGE, Float64(data=math.nan)),
        (interfaces.NUDGE, Float64(data=1e9)),
        (interfaces.EDGE_COMMAND, EdgeCommand(value=math.inf)),
        (interfaces.EDGE_COMMAND, EdgeCommand(header=STALE, value=1.0)),
        (interfaces.EDGE_COMMAND, EdgeCommand(kind=7, value=1.0)),
        (joints, JointState(name=['wheel'], effort=[1e-3])),
        (joints, JointState(name=['rotor_0'], effort=[math.nan])),
        (joints, JointState(header=STALE, name=['rotor_0'], effort=[1e-3])),
        (interfaces.EFFORT_COMMANDS, Float64MultiArray(data=[1e-3])),
    ]
    right = [(interfaces.NUDGE, Float64(data=sign * SPEED)) for sign in (1, -1)]
    return [
        command
        for number in range(COMMANDS // 10)
        for command in (*wrong[: number % 9], right[number % 2], *wrong[number % 9 :])
    ]


def test_the_chain_moves_as_the_accepted_commands_alone_have_it(graph, monkeypatch):
    kicks: list[tuple[int, Array]] = []
    kick = ElasticSimulation.kick

    def noted(self: ElasticSimulation, impulses: Array) -> None:
        kicks.append((self.frame, impulses))
        kick(self, impulses)

    monkeypatch.setattr(ElasticSimulation, 'kick', noted)
    actuator = graph.start(EdgeActuator, {'state_timeout': 60.0})
    simulator = graph.start(Simulator, {'chain.number_of_rotors': ROTORS, 'publish_rate': 100.0})
    topics = {topic.name: topic for topic, _ in flood()}
    publishers = {name: graph.speak(topic) for name, topic in topics.items()}
    graph.until(
        lambda: actuator.frames.taken and actuator.commands.chain, 'the chain and its state'
    )
    for publisher in actuator.publishers:
        if publisher.topic_name == '/rotor_impulses':
            graph.until(publisher.get_subscription_count, 'the simulator')

    for number, (topic, message) in enumerate(flood(), 1):
        publishers[topic.name].publish(message)
        if number % 200 == 0:
            # The queue of a topic holds 100 commands, more than its share of these.
            graph.until(
                lambda sent=number: actuator.carried_out + actuator.diagnostics.rejected == sent,
                f'{number} commands',
            )
    graph.until(lambda: len(kicks) == actuator.carried_out, 'the kicks of the simulator')
    simulator.control.pause(True)
    simulator.control.step(1)
    assert 0 < actuator.carried_out <= COMMANDS // 10
    assert actuator.diagnostics.rejected > actuator.carried_out
    chain = simulator.named.chain
    speeds = [np.linalg.norm(impulses) / chain.moment_of_inertia for _, impulses in kicks]
    np.testing.assert_allclose(speeds, SPEED)
    alone = ElasticSimulation(chain, chain.uniform_state(-1), period=0.01)
    monkeypatch.undo()
    end = simulator.control.simulation
    for frame in range(end.frame):
        for _, impulses in [kick for kick in kicks if kick[0] == frame]:
            alone.kick(impulses)
        alone.advance()
    np.testing.assert_array_equal(alone.angles, end.angles)
    np.testing.assert_array_equal(alone.rates, end.rates)
