# SPDX-License-Identifier: Apache-2.0
"""The program nudge kicks the chain and reports the executed kick or the failure."""

import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from graphs import Graph

from soliton_linkage_msgs.msg import LastKick
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.view_conversions import describe_kick
from soliton_linkage_nodes.programs.nudge import NudgeClient
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.simulator.node import Simulator

QUICK = {'chain.number_of_rotors': 8, 'publish_rate': 100.0}


def nudged(graph: Graph, speed: float, timeout: float = 60.0) -> str:
    """Return the report of a nudge, or its error message."""
    nudger = NudgeClient(threading.Event(), context=graph.context)
    try:
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(nudger.nudge, speed, 1, timeout)
            graph.until(answer.done, 'the answer')
        kick = answer.result()
        assert kick is not None
        return describe_kick(kick)
    except ValueError as error:
        return str(error)
    finally:
        nudger.destroy_node()
        graph.until(lambda: 'nudge' not in graph.user.get_node_names(), 'a nudger that is gone')


def test_it_reports_the_results_of_the_actuator_and_the_simulator(graph):
    graph.start(EdgeActuator, {'state_timeout': 60.0})
    graph.start(Simulator, QUICK)
    kicks, nudges = graph.hear(interfaces.LAST_KICK), graph.hear(interfaces.NUDGE)
    said = nudged(graph, -2.5)
    assert said.startswith('a kick of -2.5 rad/s at the first edge; an impulse of ')
    graph.until(lambda: kicks, 'the kick')
    assert said.endswith(f'a work of {kicks[0].work:.3g} J, measured by the simulator')
    # Neither an earlier kick nor a subscribed recorder counts as a report.
    refused = 'speed = 500 rad/s must lie in the range -100 to 100 rad/s'
    assert f'/edge_actuator rejected the nudge: {refused}' in nudged(graph, 500.0)
    assert [message.data for message in nudges] == [-2.5, 500.0]


def test_an_actuator_without_a_simulator_names_it(graph):
    graph.start(EdgeActuator)
    said = nudged(graph, 10.0, timeout=10.0)
    assert said.startswith(
        '/edge_actuator rejected the nudge: nothing subscribes to rotor_impulses'
    )


def test_without_an_actuator_it_fails(graph):
    missing = 'no node subscribes to /nudge after 0.5 s; start edge_actuator first'
    assert nudged(graph, 10.0, timeout=0.5) == missing
    heard = graph.hear(interfaces.NUDGE)
    graph.hear(interfaces.LAST_KICK)
    said = nudged(graph, 10.0, timeout=1.0)
    assert said == ('only /user subscribes to /nudge after 1 s; start edge_actuator first')
    assert heard == []


def test_a_kick_that_the_simulator_did_not_execute_is_a_failure():
    with pytest.raises(ValueError, match='the simulator did not execute the command'):
        describe_kick(LastKick(cut_short=True, measured=True))


def test_as_a_person_runs_it_in_a_namespace(graph, start):
    graph.start(EdgeActuator, {'state_timeout': 60.0}, namespace='left')
    graph.start(Simulator, QUICK, namespace='left')
    program = start('nudge', '10', '--ros-args', '-r', '__ns:=/left')
    graph.until(lambda: program.process.poll() is not None, 'the end of nudge')
    assert program.process.returncode == 0
    (line,) = program.said
    assert line.startswith('nudge: a kick of 10 rad/s at the first edge; an impulse of ')


def test_it_stops_waiting_on_a_signal(graph, start):
    program = start('nudge', '10')
    graph.until(lambda: 'nudge' in graph.user.get_node_names(), 'the node nudge')
    assert program.stop(signal.SIGTERM) == 130
    assert program.said == []
