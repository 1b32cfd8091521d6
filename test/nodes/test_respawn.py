# SPDX-License-Identifier: Apache-2.0
"""A killed and restarted node resumes its work by itself."""

from std_msgs.msg import Float64

from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

SPEED = 0.5
SPACING = 0.1
MOVING = {
    'initial_state': 'soliton',
    'initial_position': 5.0,
    'initial_velocity': SPEED,
    'chain.spacing': SPACING,
    'publish_rate': 250.0,
}


def test_an_analyser_has_the_soliton_again_within_two_passages_of_a_rotor(graph):
    heard = graph.hear(interfaces.SOLITON_STATE)
    graph.start(Simulator, MOVING)
    for _ in range(2):
        heard.clear()
        analyser = graph.start(SolitonAnalyser, {'longest_lag': 0.0})
        graph.until(lambda: len(heard) > 200, 'states')
        graph.stop(analyser)
        tracked = next(
            state for state in heard if state.status == SolitonState.TRACKING and state.solitons
        )
        taken = time_from_msg(tracked.header.stamp) - time_from_msg(heard[0].header.stamp)
        assert taken / SECOND < 2 * SPACING / SPEED


def test_a_simulator_that_comes_back_is_followed_and_driven(graph):
    heard = graph.hear(interfaces.SOLITON_STATE)
    graph.start(SolitonAnalyser)
    graph.start(EdgeActuator, {'state_timeout': 60.0})
    for _ in range(2):
        simulator = graph.start(Simulator, {'chain.number_of_rotors': 8, 'publish_rate': 100.0})
        nudge = graph.speak(interfaces.NUDGE)
        heard.clear()
        graph.until(lambda: len(heard) > 10, 'states')
        rest = simulator.control.status.energy
        nudge.publish(Float64(data=1.0))
        graph.until(
            lambda e=rest, s=simulator: s.control.status.energy > e, 'the energy of a kick'
        )
        graph.stop(simulator)
        graph.user.destroy_publisher(nudge)
