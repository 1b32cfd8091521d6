# SPDX-License-Identifier: Apache-2.0
"""Frames whose joints come in several messages are analysed like whole frames."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from graphs import Graph, values
from joint_frames import PERIOD, halves, kicked_frames, part
from recordings import START, analysed_states, write_bag
from sensor_msgs.msg import JointState

from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.messages.state_conversions import state_to_msg
from soliton_linkage_nodes.programs.bag_analysis import analyse_frames
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import SECOND, time_from_msg, time_to_msg
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

FRAMES = 120


@pytest.fixture
def frames(named):
    """A wall that leaves the edge."""
    return kicked_frames(named, 10.0, (FRAMES - 1) * PERIOD / SECOND)


def expected(named: NamedChain, frames: Sequence[JointState]) -> list[SolitonState]:
    """States of whole frames, without a frame id."""
    states = analysed_states(named, frames, frame_id='')
    assert any(state.solitons for state in states)
    return states


def bag_of(folder: Path, named: NamedChain, messages: Sequence[JointState]) -> Path:
    chain = (interfaces.CHAIN, START, chain_to_msg(named, time_to_msg(START)))
    joints = [(interfaces.JOINT_STATES, START + n, each) for n, each in enumerate(messages)]
    return write_bag(folder / 'run', [chain, *joints])


def start_analyser(graph: Graph, named: NamedChain, **parameters: object) -> list[SolitonState]:
    states = graph.hear(interfaces.SOLITON_STATE)
    interfaces.CHAIN.publisher(graph.user).publish(chain_to_msg(named, time_to_msg(START)))
    graph.start(SolitonAnalyser, {'longest_lag': 0.0, **parameters})
    return states


def test_a_bag_with_frames_in_halves_gives_the_states_of_whole_frames(named, frames, tmp_path):
    messages = [half for frame in frames for half in halves(frame)]
    with open_bag(bag_of(tmp_path, named, messages)) as reader:
        found = list(analyse_frames(reader))
    states = [state_to_msg(each, joints) for joints, each in found if each is not None]
    assert list(map(repr, states)) == list(map(repr, expected(named, frames)))


@pytest.mark.parametrize('publishers', [1, 2])
def test_halves_of_one_or_two_publishers_give_the_states_of_whole_frames(
    graph, named, frames, said, publishers
):
    states = start_analyser(graph, named)
    boards = [graph.speak(interfaces.JOINT_STATES) for _ in range(publishers)]
    for frame in frames:
        for number, half in enumerate(halves(frame)):
            boards[number % publishers].publish(half)
    graph.until(lambda: len(states) == FRAMES, f'{FRAMES} states', lambda: len(states))
    assert list(map(repr, states)) == list(map(repr, expected(named, frames)))
    figures = values(graph.next_report('soliton_analyser'))
    assert (figures['lost joint_states'], figures['joint_states of others']) == ('0', '0')
    assert 'nodes publish' not in said()


def test_publishers_of_different_joints_and_stamps_are_both_used(graph, named, frames):
    states = start_analyser(graph, named)
    boards = [graph.speak(interfaces.JOINT_STATES) for _ in range(2)]
    for frame in frames:
        for board, half in zip(boards, halves(frame, PERIOD // 3), strict=True):
            board.publish(half)
    graph.until(lambda: len(states) == 2 * FRAMES, 'a state for each half', lambda: len(states))
    walls = [state.solitons for state in states[-FRAMES:]]
    assert sum(map(len, walls)) > FRAMES // 2


@pytest.mark.parametrize('window', [1, 10])
def test_a_lockstep_replay_gives_the_states_of_the_analysis_without_a_node(
    graph, named, frames, tmp_path, window
):
    bag = bag_of(tmp_path, named, [half for frame in frames for half in halves(frame)])
    states = graph.hear(interfaces.SOLITON_STATE)
    graph.start(SolitonAnalyser)
    given = {'lockstep': True, 'lockstep_window': window, 'lockstep_timeout': 600.0}
    player = graph.start(BagPlayer, {'bag': str(bag), **given})
    graph.until(lambda: player.finished and len(states) == FRAMES, 'the end')
    assert 'without an answer' not in graph.next_report('bag_player').message
    assert list(map(repr, states)) == list(map(repr, expected(named, frames)))


def test_a_frame_that_stays_incomplete_is_analysed_without_a_later_one(graph, named, frames):
    states = start_analyser(graph, named)
    graph.speak(interfaces.JOINT_STATES).publish(halves(frames[60])[0])
    graph.until(lambda: states, 'the state')


def test_joints_without_any_angle_are_reported_once(graph, named, frames, said):
    states = start_analyser(graph, named)
    joints = graph.speak(interfaces.JOINT_STATES)
    for frame in frames:
        joints.publish(part(frame, range(6)))
    line = "joint_states had no angle of 2 of 8 joints so far, first 'rotor_6'"
    graph.until(lambda: line in said(), 'the line')
    assert len(states) == FRAMES
    reports = graph.reports('soliton_analyser')
    graph.until(lambda: len(reports) > 3, 'some time')
    assert said().count('had no angle of') == 1


@pytest.mark.parametrize('stamps', ['header', 'arrival'])
def test_frames_without_stamps_are_analysed_at_their_arrival_if_requested(
    graph, named, frames, said, stamps
):
    states = start_analyser(graph, named, stamps=stamps)
    joints = graph.speak(interfaces.JOINT_STATES)
    for frame in frames:
        frame.header.stamp = time_to_msg(0)
        joints.publish(frame)
    if stamps == 'header':
        line = 'set parameter stamps of soliton_analyser to arrival'
        graph.until(lambda: line in said() and states, 'the warning')
        assert len(states) == 1
    else:
        graph.until(lambda: len(states) == FRAMES, 'the states')
        received = [time_from_msg(state.header.stamp) for state in states]
        assert received[0] > START
        assert (np.diff(received) > 0).all()
        assert 'no stamps' not in said()
