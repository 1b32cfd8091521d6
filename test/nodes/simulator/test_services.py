# SPDX-License-Identifier: Apache-2.0
"""A simulation is paused, stepped and reset by services, at the instants of frames."""

from typing import Any

import numpy as np
from graphs import Graph
from simulated_streams import CHAIN, RATE, Stream, kick, kick_message, torque_message
from std_srvs.srv import SetBool

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes.runtime import interfaces


def pause(graph: Graph, paused: bool) -> Any:
    return graph.call(SetBool, 'simulator/pause', data=paused)


def step(graph: Graph, periods: int) -> Any:
    return graph.call(Step, 'simulator/step', periods=periods)


def reset(graph: Graph, state: int = Reset.Request.INITIAL) -> Any:
    return graph.call(Reset, 'simulator/reset', state=state)


def settled(stream: Stream) -> int:
    """Return the number of frames once everything that was published has come."""
    last = stream.node.control.status.frames
    stream.graph.until(lambda: stream.number(stream.frames[-1]) == last - 1, 'the last frame')
    return len(stream.frames)


def test_a_pause_stops_time_at_once_and_can_be_repeated(graph):
    stream = Stream(graph)
    stream.kick()
    stream.grow(60)
    for _ in range(2):
        response = pause(graph, True)
        assert (response.success, response.message) == (True, 'paused')
    paused_at = settled(stream)
    report = graph.next_report('simulator')
    assert (report.message, report.level) == ('paused', report.OK)
    assert len(stream.frames) == paused_at
    for _ in range(2):
        response = pause(graph, False)
        assert (response.success, response.message) == (True, 'running')
    stream.grow(60)
    stream.explain([kick])


def test_steps_are_taken_while_paused_and_answered_when_done(graph):
    stream = Stream(graph)
    pause(graph, True)
    before = settled(stream)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = step(graph, 25)
    assert response.success
    reached = stream.number(stream.frames[before - 1]) + 1 + 25
    assert response.message == f'reached t = {reached / RATE:g} s'
    assert settled(stream) == before + 25
    (kicked,) = stream.explain([kick])
    assert kicked == stream.number(stream.frames[before])


def test_a_step_while_running_or_of_a_wrong_length_is_rejected(graph):
    stream = Stream(graph)
    response = step(graph, 5)
    assert (response.success, response.message) == (
        False,
        'the simulation is running; pause it before stepping',
    )
    pause(graph, True)
    before = settled(stream)
    for periods in (0, 1001, 2**32 - 1):
        response = step(graph, periods)
        assert not response.success
        assert f'periods = {periods} must lie in the range 1 to 1000' in response.message
    assert step(graph, 1).success
    assert settled(stream) == before + 1
    stream.explain([])


def test_a_reset_forgets_commands_but_not_the_time(graph):
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    graph.until(lambda: any(stream.frames[-1].velocity), 'the motion')
    pause(graph, True)
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    for state, message in (
        (Reset.Request.INITIAL, 'in the initial state'),
        (Reset.Request.LEFT_LEANING, 'at rest, left-leaning'),
        (Reset.Request.RIGHT_LEANING, 'at rest, right-leaning'),
    ):
        response = reset(graph, state)
        assert (response.success, response.message) == (True, message)
    before = settled(stream)
    assert step(graph, 200).success
    settled(stream)
    numbers = [stream.number(frame) for frame in stream.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    twin = ElasticSimulation(CHAIN, CHAIN.uniform_state(1), period=1 / RATE)
    for frame in stream.frames[before:]:
        np.testing.assert_array_equal(frame.position, twin.angles)
        np.testing.assert_array_equal(frame.velocity, twin.rates)
        twin.advance()


def test_a_motion_too_fast_to_compute_pauses_until_a_reset(graph):
    stream = Stream(graph, {'impulse_limit': 1e6})
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    pause(graph, True)
    impulses.publish(RotorImpulses(name=['rotor_3'], impulse=[1e6]))
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = step(graph, 10)
    assert not response.success
    assert 'call ~/reset to continue' in response.message
    graph.until(lambda: stream.node.control.status.failure, 'the failure')
    frames = settled(stream)
    report = graph.next_report('simulator')
    assert report.level == report.WARN
    assert report.message.startswith('paused, ')
    for response in (pause(graph, False), step(graph, 1)):
        assert not response.success
        assert 'call ~/reset to continue' in response.message
    assert len(stream.frames) == frames
    assert reset(graph).success
    pause(graph, False)
    stream.grow(30)
    numbers = [stream.number(frame) for frame in stream.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    for frame in stream.frames[frames:]:
        # Rounding of the springs' lengths moves a chain at rest by no more.
        np.testing.assert_allclose(frame.velocity, 0, atol=1e-10)
