# SPDX-License-Identifier: Apache-2.0
"""A simulation is paused, stepped and reset by services, at the instants of frames."""

import numpy as np
from simulated_streams import CHAIN, RATE, Stream, kick, kick_message, torque_message

from soliton_linkage.dynamics.elastic import ElasticSimulation
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.runtime import interfaces


def test_a_pause_stops_time_at_once_and_steps_are_answered_when_done(graph):
    stream = Stream(graph)
    for _ in range(2):
        response = stream.pause()
        assert (response.success, response.message) == (True, 'paused')
    before = stream.settled()
    report = graph.next_report('simulator')
    assert (report.message, report.level) == ('paused', report.OK)
    assert len(stream.frames) == before
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = stream.step(25)
    assert response.success
    reached = stream.number(stream.frames[before - 1]) + 1 + 25
    assert response.message == f'reached t = {reached / RATE:g} s'
    assert stream.settled() == before + 25
    for _ in range(2):
        response = stream.pause(False)
        assert (response.success, response.message) == (True, 'running')
    stream.grow(10)
    (kicked,) = stream.explain([kick])
    assert kicked == stream.number(stream.frames[before])


def test_a_step_while_running_or_of_a_wrong_length_is_rejected(graph):
    stream = Stream(graph)
    response = stream.step(5)
    assert (response.success, response.message) == (
        False,
        'the simulation is running; pause it before stepping',
    )
    stream.pause()
    before = stream.settled()
    for periods in (0, 1001, 2**32 - 1):
        response = stream.step(periods)
        assert not response.success
        assert f'periods = {periods} must lie in the range 1 to 1000' in response.message
    assert stream.step(1).success
    assert stream.settled() == before + 1
    stream.explain([])


def test_a_reset_forgets_commands_but_not_the_time(graph):
    stream = Stream(graph)
    impulses = graph.speak(interfaces.ROTOR_IMPULSES)
    torques = graph.speak(interfaces.ROTOR_TORQUES)
    torques.publish(torque_message())
    stream.wait_for_motion()
    stream.pause()
    impulses.publish(kick_message())
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    for state, message in (
        (Reset.Request.INITIAL, 'in the initial state'),
        (Reset.Request.LEFT_LEANING, 'at rest, left-leaning'),
        (Reset.Request.RIGHT_LEANING, 'at rest, right-leaning'),
    ):
        response = stream.reset(state=state)
        assert (response.success, response.message) == (True, message)
    before = stream.settled()
    assert stream.step(200).success
    stream.settled()
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
    stream.pause()
    impulses.publish(RotorImpulses(name=['rotor_3'], impulse=[1e6]))
    graph.until(lambda: stream.node.control.status.pending, 'the kick')
    response = stream.step(10)
    assert not response.success
    assert 'call ~/reset to continue' in response.message
    graph.until(lambda: stream.node.control.status.failure, 'the failure')
    frames = stream.settled()
    report = graph.next_report('simulator')
    assert report.level == report.WARN
    assert report.message.startswith('paused, ')
    for response in (stream.pause(False), stream.step(1)):
        assert not response.success
        assert 'call ~/reset to continue' in response.message
    assert len(stream.frames) == frames
    assert stream.reset().success
    stream.pause(False)
    stream.grow(30)
    numbers = [stream.number(frame) for frame in stream.frames]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    for frame in stream.frames[frames:]:
        # Rounding of the springs' lengths moves a chain at rest by no more.
        np.testing.assert_allclose(frame.velocity, 0, atol=1e-10)
