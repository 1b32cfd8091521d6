# SPDX-License-Identifier: Apache-2.0
"""Every frame of joint states gets its solitons, none as an empty list."""

import copy
import dataclasses
import math
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from graphs import Graph, values
from joint_frames import PERIOD, frame_of, kicked_frames
from rclpy.serialization import serialize_message
from recordings import analysed_states
from sensor_msgs.msg import JointState

from soliton_linkage.linkage.chain import Chain
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

CHAINS = {
    'flipper': (Chain(number_of_rotors=16), 10.0),
    'wobbler': (Chain(number_of_rotors=12, rotor_length=0.1, rest_angle=0.77), 4.0),
    'spinner': (Chain(number_of_rotors=16, rotor_length=0.2, rest_angle=1.18), 12.5),
}
EVERY_FRAME = {'longest_lag': 0.0}


def named_chain(chain: Chain) -> NamedChain:
    return NamedChain(chain, default_joint_names(chain.number_of_rotors))


def tell_chain(graph: Graph, named: NamedChain) -> None:
    interfaces.CHAIN.publisher(graph.user).publish(chain_to_msg(named, time_to_msg(0)))


class Analysed:
    """An analyser between a test that publishes joint states and one that receives states."""

    def __init__(
        self, graph: Graph, named: NamedChain | None, parameters: Mapping[str, Any] = EVERY_FRAME
    ) -> None:
        self._graph = graph
        self.states = graph.hear(interfaces.SOLITON_STATE)
        self.reports = graph.reports('soliton_analyser')
        if named:
            tell_chain(graph, named)
        self.node = graph.start(SolitonAnalyser, parameters)
        self._joints = graph.speak(interfaces.JOINT_STATES)

    def publish(self, *frames: JointState | bytes) -> None:
        for frame in frames:
            self._joints.publish(frame)

    def analyse(self, frames: Sequence[JointState]) -> list[Any]:
        self.publish(*frames)
        self._graph.until(lambda: len(self.states) == len(frames), f'{len(frames)} states')
        return self.states

    def report(self, said: str) -> Any:
        """Return the first report whose message contains a text."""
        self._graph.until(lambda: any(said in each.message for each in self.reports), said)
        return next(each for each in self.reports if said in each.message)

    def reported(self, name: str, value: str) -> dict[str, str]:
        """Return the values of the latest report once one of them contains a text."""
        self._graph.until(
            lambda: self.reports and value in values(self.reports[-1]).get(name, ''), name
        )
        return values(self.reports[-1])


def assert_same(states: Sequence[Any], named: NamedChain, frames: Sequence[JointState]) -> None:
    """Compare states with those of the analysis without a node; NaN equals NaN."""
    assert [repr(each) for each in states] == [
        repr(each) for each in analysed_states(named, frames)
    ]


def test_every_frame_gets_its_solitons_under_its_own_header(graph):
    chain, speed = CHAINS['wobbler']
    named = named_chain(chain)
    frames = kicked_frames(named, speed)
    states = Analysed(graph, named).analyse(frames)
    assert_same(states, named, frames)
    assert states[0].solitons == []
    assert states[0].motion_name == 'wobbling flipper'
    assert any(state.solitons for state in states)


def test_frames_that_come_before_the_chain_are_analysed_once_it_is_known(graph):
    chain, speed = CHAINS['flipper']
    named = named_chain(chain)
    analysed, frames = Analysed(graph, None), kicked_frames(named, speed)
    analysed.publish(*frames)
    report = analysed.report(
        'waiting for the topic chain; if no node publishes it, set chain_from to parameters or '
        'nowhere'
    )
    assert report.level == report.WARN
    assert analysed.states == []
    tell_chain(graph, named)
    graph.until(lambda: len(analysed.states) == len(frames), f'{len(frames)} states')
    assert [state.header for state in analysed.states] == [frame.header for frame in frames]


def test_no_frame_is_lost_while_the_analyser_is_busy(graph, named):
    reports = graph.reports('soliton_analyser')
    graph.start(SolitonAnalyser, EVERY_FRAME)
    joints = graph.speak(replace(interfaces.JOINT_STATES, qos=interfaces.lossless_stream_qos()))
    rest, count = named.chain.uniform_state(1), 3000
    for number in range(count):
        joints.publish(frame_of(named, rest, number * PERIOD, 0 * rest))
    tell_chain(graph, named)
    graph.until(lambda: reports and values(reports[-1])['frames'] == str(count), f'{count} frames')


OBSERVER = """
import rclpy
from soliton_linkage_nodes.programs.experiment.observer import Observer
rclpy.init()
observer = Observer()
while len(observer.states) < {count}:
    rclpy.spin_once(observer)
"""


def test_an_experiment_that_is_stopped_meanwhile_loses_no_state_of_a_replay(graph, named):
    tell_chain(graph, named)
    analyser = graph.start(SolitonAnalyser, EVERY_FRAME)
    rest, count = named.chain.uniform_state(1), 1200
    frames = [frame_of(named, rest, number * PERIOD, 0 * rest) for number in range(count)]
    serialised = list(map(serialize_message, frames))
    observer = subprocess.Popen(
        [sys.executable, '-c', OBSERVER.format(count=count)],
        env={**os.environ, 'ROS_DOMAIN_ID': str(graph.domain)},
    )
    try:
        topic = interfaces.SOLITON_STATE.name
        graph.until(lambda: analyser.count_subscribers(topic), 'the experiment')
        graph.next_report('soliton_analyser')
        # DDS forgets a process that is stopped for 20 s, so that the loop must be short.
        observer.send_signal(signal.SIGSTOP)
        for message in serialised:
            analyser.take(message)
        observer.send_signal(signal.SIGCONT)
        graph.until(lambda: observer.poll() == 0, f'{count} states in the experiment')
    finally:
        observer.kill()
        observer.wait()


def test_the_last_1000_frames_wait_for_the_chain(graph, named):
    topic = interfaces.SOLITON_STATE
    states = graph.hear(replace(topic, qos=interfaces.lossless_stream_qos()))
    analyser = graph.start(SolitonAnalyser)
    rest = named.chain.uniform_state(1)
    for number in range(1030):
        frame = frame_of(named, rest, number * PERIOD, 0 * rest)
        analyser.take(serialize_message(frame))
    tell_chain(graph, named)
    graph.until(lambda: states and states[-1].header == frame.header, 'the last state')
    assert states[0].header.stamp == time_to_msg(30 * PERIOD)
    assert len(analyser.waiting) == 0


def test_a_frame_of_any_numbers_is_analysed(graph):
    chance = np.random.default_rng(3)
    named = named_chain(Chain(number_of_rotors=5))
    frames = []
    for number in range(300):
        size = 10.0 ** chance.uniform(-150, 150)
        angles, rates = chance.uniform(-size, size, (2, 5))
        angles[chance.random(5) < 0.2] = chance.choice([math.nan, math.inf])
        frames.append(frame_of(named, angles, number, rates if number % 2 else np.zeros(5)))
    analysed = Analysed(graph, named)
    analysed.analyse(frames)
    assert not analysed.reports or values(analysed.reports[-1])['rejected'] == '0'


def test_a_report_has_rate_and_number_of_solitons(graph, named):
    analysed = Analysed(graph, named)
    analysed.report('waiting for joint_states')
    analysed.publish(kicked_frames(named, 10.0)[20])
    figures = values(analysed.report('1 solitons, acquired'))
    assert len(analysed.states) == 1
    assert (figures['frames'], figures['solitons'], figures['subscribers']) == ('1', '1', '1')
    assert float(figures['rate [Hz]']) > 0


def test_a_parameter_maps_joints_to_rotors(graph, named):
    own = {'joint_names': [f'wheel_{7 - rotor}' for rotor in range(8)]}
    frames = kicked_frames(named, 10.0)
    turned = [
        JointState(
            header=frame.header,
            name=[f'wheel_{n}' for n in range(8)],
            position=frame.position[::-1],
            velocity=frame.velocity[::-1],
        )
        for frame in frames
    ]
    assert_same(Analysed(graph, named, own | EVERY_FRAME).analyse(turned), named, frames)


def test_joints_that_do_not_fit_the_chain_are_reported(graph, named):
    analysed = Analysed(graph, named, {'joint_names': ['a', 'b']})
    analysed.report('parameter joint_names has 2 names')


def test_without_a_chain_the_angles_alone_give_the_motion(graph, named):
    chain, speed = CHAINS['spinner']
    analysed = Analysed(graph, None, {'chain_from': 'nowhere'})
    states = analysed.analyse(kicked_frames(named_chain(chain), speed))
    assert states[-1].motion_name == 'spinner'
    assert states[-1].measured_motion == states[-1].motion
    assert states[-1].measured_motion_confidence > 0.99
    assert math.isnan(states[-1].cycle.phase)
    assert any(state.solitons for state in states)
    analysed.report('the parameters of the chain are unknown')


def test_late_frames_get_no_state_and_are_counted(graph, named):
    analysed, frames = Analysed(graph, named), kicked_frames(named, 10.0)[:10]
    analysed.publish(*frames, frames[4], frames[9])
    analysed.reported('late frames', '2')
    assert [state.header for state in analysed.states] == [frame.header for frame in frames]


@pytest.mark.parametrize(
    ('spoiled', 'said'), [(1, '1 of 16 rotors are not visible'), (0, 'soliton')]
)
def test_missing_rotors_are_reported(graph, spoiled, said):
    chain, speed = CHAINS['flipper']
    named = named_chain(chain)
    frames = kicked_frames(named, speed)[:60]
    for frame in frames[: 60 * spoiled]:
        frame.position[5] = math.nan
    analysed = Analysed(graph, named)
    assert {state.unseen for state in analysed.analyse(frames)} == {spoiled}
    report = analysed.report(said)
    assert report.level == (report.WARN if spoiled else report.OK)


def test_a_second_chain_is_ignored_until_the_first_publisher_ends(graph, said):
    true, false = named_chain(CHAINS['flipper'][0]), named_chain(CHAINS['spinner'][0])
    reports = graph.reports('soliton_analyser')
    graph.start(SolitonAnalyser, EVERY_FRAME)
    first = graph.speak(interfaces.CHAIN)
    first.publish(chain_to_msg(true, time_to_msg(0)))
    graph.until(lambda: 'describes a chain of 16 rotors (flipper' in said(), 'the chain')
    second = graph.speak(interfaces.CHAIN)
    second.publish(chain_to_msg(false, time_to_msg(0)))
    warning = '2 nodes publish /chain'
    graph.until(lambda: any(warning in r.message for r in reports), 'the warning')
    assert said().count(warning) == 1
    assert 'spinner' not in said()
    graph.user.destroy_publisher(first)
    graph.until(lambda: 'the chain has changed' in said(), 'the other chain')
    assert 'describes a chain of 16 rotors (spinner' in said()


def test_offsets_of_encoders_are_reported(graph):
    chain, speed = CHAINS['flipper']
    named = named_chain(chain)
    frames = kicked_frames(named, speed, 8.0)
    for frame in frames:
        frame.position[5] += 0.2
    analysed = Analysed(graph, named)
    analysed.publish(*frames)
    found = analysed.reported('encoder offsets [rad]', 'rotor_5')['encoder offsets [rad]']
    offset, deviation = map(float, found.split()[1::2])
    assert abs(offset - 0.2) < 3 * deviation < 0.003


def test_wrong_joint_states_are_rejected_and_valid_ones_analysed_as_before(graph, named):
    analysed, frames = Analysed(graph, named), kicked_frames(named, 10.0)[60:62]
    foreign = copy.deepcopy(frames[0])
    foreign.name = [f'wheel_{n}' for n in range(8)]
    none = "has none of the 8 rotors, such as 'rotor_0'; set the parameter joint_names"
    cut, invalid = serialize_message(frames[1])[:200], 'of 200 bytes is no valid sensor_msgs/Joint'
    for number, (wrong, right, complaint) in enumerate(
        ((foreign, frames[0], none), (cut, frames[1], invalid)), start=1
    ):
        analysed.publish(wrong, right)
        assert complaint in analysed.reported('rejected', str(number))['last rejection']
    graph.until(lambda: len(analysed.states) == 2, 'a state of each valid frame')
    assert_same(analysed.states, named, frames)


@pytest.mark.parametrize(
    ('name', 'changes', 'warning', 'remedy'),
    [
        ('spinner', None, 'the angles show a spinner', 'the parameters specify a flipper'),
        (
            'flipper',
            {'rest_angle': 0.85},
            'rad more than chain.rest_angle',
            'identify_chain estimates it',
        ),
        (
            'flipper',
            {'rest_angle': 0.6},
            'the angles do not fit one soliton',
            'check the parameters in chain',
        ),
    ],
)
def test_angles_that_do_not_fit_the_chain_are_reported(graph, name, changes, warning, remedy):
    chain, speed = CHAINS[name]
    stated = dataclasses.replace(CHAINS['flipper'][0], **(changes or {}))
    analysed = Analysed(graph, named_chain(stated))
    analysed.publish(*kicked_frames(named_chain(chain), speed))
    report = analysed.report(warning)
    assert report.level == report.WARN
    assert remedy in report.message
