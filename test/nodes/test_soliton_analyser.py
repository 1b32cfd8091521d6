# SPDX-License-Identifier: Apache-2.0
"""The analyser answers every frame that it can read with what the physics finds in it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from graphs import Graph, values
from programs import Program
from sensor_msgs.msg import JointState

from soliton_linkage.rigidity import mode_towards_last
from soliton_linkage.simulation import simulate
from soliton_linkage.soliton import find_solitons
from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.conversions import (
    Frame,
    NamedChain,
    chain_to_msg,
    frame_to_msg,
    solitons_to_msg,
    time_to_msg,
)
from soliton_linkage_nodes.soliton_analyser import SolitonAnalyser

FRAMES = 40


@pytest.fixture
def messages(named: NamedChain) -> list[JointState]:
    """Joint states of a soliton that crosses the chain."""
    chain = named.chain
    rest = chain.uniform_state(-1)
    recording = simulate(chain, rest, 10.0 * mode_towards_last(chain, rest), 0.8, 0.8 / FRAMES)
    return [
        frame_to_msg(named, Frame(angles, rates), 0 * angles, time_to_msg(round(time * 1e9)))
        for time, angles, rates in zip(
            recording.times, recording.angles, recording.rates, strict=True
        )
    ]


def expected(named: NamedChain, message: JointState) -> SolitonState:
    angles, rates = np.array(message.position), np.array(message.velocity)
    solitons = find_solitons(named.chain, angles, rates if len(rates) else None)
    return solitons_to_msg(named.chain, solitons, message.header)


def alike(one: SolitonState, other: SolitonState) -> bool:
    """Whether two states are the same message, NaN and all."""
    return repr(one) == repr(other)


def analysed(graph: Graph, named: NamedChain, messages: list[JointState]) -> list[SolitonState]:
    """Return what an analyser that learns the chain from its topic says of the messages."""
    graph.start(SolitonAnalyser)
    states = graph.hear(interfaces.SOLITON_STATE)
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, Time()))
    joints = graph.speak(interfaces.JOINT_STATES)
    for message in messages:
        joints.publish(message)
    graph.until(lambda: len(states) == len(messages), f'{len(messages)} states')
    return states


def test_every_frame_is_answered_with_its_own_stamp_and_solitons(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    states = analysed(graph, named, messages)
    assert all(
        alike(state, expected(named, message))
        for state, message in zip(states, messages, strict=True)
    )
    assert {len(state.solitons) for state in states} == {0, 1}
    assert {state.motion_name for state in states} == {'flipper'}


def test_no_soliton_is_an_empty_list(graph: Graph, named: NamedChain) -> None:
    rest = frame_to_msg(named, Frame(named.chain.uniform_state(1), None), np.zeros(8), Time())
    (state,) = analysed(graph, named, [rest])
    assert list(state.solitons) == []
    assert state.motion == SolitonState.FLIPPER


def test_joints_come_in_any_order_and_others_among_them(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    message = messages[FRAMES // 2]
    shuffled = [5, 2, 7, 0, 1, 6, 4, 3]
    mixed = JointState(
        header=message.header,
        name=['gripper', *(message.name[n] for n in shuffled)],
        position=[9.0, *(message.position[n] for n in shuffled)],
        velocity=[9.0, *(message.velocity[n] for n in shuffled)],
    )
    (state,) = analysed(graph, named, [mixed])
    assert len(state.solitons) == 1
    assert alike(state, expected(named, message))


def test_without_velocities_the_place_is_told_and_the_velocity_is_nan(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    message = messages[FRAMES // 2]
    message.velocity = []
    (state,) = analysed(graph, named, [message])
    assert alike(state, expected(named, message))
    assert math.isnan(state.solitons[0].velocity)
    assert math.isfinite(state.solitons[0].rotor)


def test_frames_that_come_before_the_chain_are_answered_when_it_is_known(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    analyser = graph.start(SolitonAnalyser)
    states = graph.hear(interfaces.SOLITON_STATE)
    joints = graph.speak(interfaces.JOINT_STATES)
    graph.until(lambda: analyser.count_subscribers('soliton_state') == 1, 'the listener')
    for message in messages:
        joints.publish(message)
    graph.until(lambda: values(graph.next_report('soliton_analyser'))['frames'] == '0', 'a report')
    assert states == []
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, Time()))
    graph.until(lambda: len(states) == len(messages), 'all states')
    assert [state.header.stamp for state in states] == [m.header.stamp for m in messages]


def test_where_there_is_no_simulator_the_chain_comes_from_parameters(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    parameters = {'chain_from': 'parameters', 'chain.number_of_rotors': 8}
    graph.start(SolitonAnalyser, parameters)
    states = graph.hear(interfaces.SOLITON_STATE)
    joints = graph.speak(interfaces.JOINT_STATES)
    joints.publish(messages[FRAMES // 2])
    graph.until(lambda: states, 'a state')
    assert alike(states[0], expected(named, messages[FRAMES // 2]))


def broken(message: JointState, kind: str) -> JointState:
    wrong = JointState(
        header=message.header,
        name=list(message.name),
        position=list(message.position),
        velocity=list(message.velocity),
    )
    if kind == 'nan':
        wrong.position[3] = math.nan
    elif kind == 'infinite rate':
        wrong.velocity[3] = math.inf
    elif kind == 'too few angles':
        wrong.position.pop()
    elif kind == 'missing rotor':
        wrong.name[3] = 'elbow'
    elif kind == 'rotor twice':
        wrong.name[3] = wrong.name[2]
    return wrong


@pytest.mark.parametrize(
    ('kind', 'complaint'),
    [
        ('nan', 'joint_states.position of rotor_3 = nan must be a finite number'),
        ('infinite rate', 'joint_states.velocity of rotor_3 = inf must be a finite number'),
        ('too few angles', 'joint_states.position has 7 values for 8 names'),
        ('missing rotor', "lacks 1 of 8 rotors, first 'rotor_3'"),
        ('rotor twice', "joint_states.name has 'rotor_2' twice"),
    ],
)
def test_a_frame_that_cannot_be_read_is_refused_and_the_next_answered(
    graph: Graph, named: NamedChain, messages: list[JointState], kind: str, complaint: str
) -> None:
    graph.start(SolitonAnalyser)
    states = graph.hear(interfaces.SOLITON_STATE)
    reports = graph.reports('soliton_analyser')
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, Time()))
    joints = graph.speak(interfaces.JOINT_STATES)
    joints.publish(broken(messages[0], kind))
    joints.publish(messages[1])
    graph.until(lambda: states, 'the state of the good frame')
    graph.until(lambda: any('1 refused' in report.message for report in reports), 'the refusal')
    refusal = next(report for report in reports if '1 refused' in report.message)
    assert complaint in refusal.message
    assert refusal.level == refusal.WARN
    assert [state.header.stamp for state in states] == [messages[1].header.stamp]


def test_a_chain_that_is_none_is_refused_and_the_last_one_kept(
    graph: Graph, named: NamedChain, messages: list[JointState]
) -> None:
    graph.start(SolitonAnalyser)
    states = graph.hear(interfaces.SOLITON_STATE)
    reports = graph.reports('soliton_analyser')
    chains = graph.speak(interfaces.CHAIN)
    chains.publish(chain_to_msg(named, Time()))
    learnt = 'waiting for joint_states'
    graph.until(lambda: any(report.message == learnt for report in reports), 'the chain')
    wrong = chain_to_msg(named, Time())
    wrong.mass = -1.0
    chains.publish(wrong)
    graph.until(lambda: any('refused' in report.message for report in reports), 'the refusal')
    assert any('mass = -1.0' in report.message for report in reports)
    graph.speak(interfaces.JOINT_STATES).publish(messages[0])
    graph.until(lambda: states, 'a state')
    assert alike(states[0], expected(named, messages[0]))


def test_while_the_chain_is_unknown_the_report_says_what_to_do(graph: Graph) -> None:
    graph.start(SolitonAnalyser)
    report = graph.next_report('soliton_analyser')
    assert report.level == report.WARN
    assert 'set chain_from to parameters' in report.message


def test_an_unknown_source_of_the_chain_ends_it_with_one_line(
    start: Callable[..., Program],
) -> None:
    program = start('soliton_analyser', '--ros-args', '-p', 'chain_from:=telepathy')
    assert program.wait() == 1
    (line,) = program.said
    assert "chain_from of soliton_analyser = 'telepathy' must be one of" in line
    assert "'topic', 'parameters'" in line
