# SPDX-License-Identifier: Apache-2.0
"""The terminal line shows rotor directions, and position and velocity of the soliton."""

import signal
from itertools import count

import numpy as np
import pytest
from joint_frames import frame_of, halves

from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.programs.watch_soliton import LEGEND, WatchSoliton, drawn
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


@pytest.fixture
def shown(graph, named, capsys):
    """Publish a left-leaning chain and a state until the program displays them."""
    text = ''

    def seen(expected: str) -> bool:
        nonlocal text
        text += capsys.readouterr().err
        return expected in text

    graph.start(WatchSoliton)
    graph.until(lambda: seen('no chain, joint_states, soliton_state'), 'a line', lambda: text)
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(0)))
    angles = named.chain.uniform_state(-1)
    joints = frame_of(named, angles, 1)
    frames = graph.speak(interfaces.JOINT_STATES)
    states = graph.speak(interfaces.SOLITON_STATE)

    def show(state: SolitonState, expected: str) -> None:
        def published() -> bool:
            frames.publish(joints)
            states.publish(state)
            return seen(expected)

        graph.until(published, expected, lambda: text)
        assert text.count(LEGEND) == 1

    return show


def test_it_shows_the_lean_and_place_and_velocity_of_the_first_soliton(named, shown):
    soliton = Soliton(rotor=3.4, velocity=-1.25 * named.chain.spacing, charge=1)
    state = SolitonState(solitons=[soliton, Soliton(rotor=6.0)])
    shown(state, r'[\\\O\\O\]  rotor   3.40    -1.25 rotors/s')


def test_it_shows_the_lean_where_there_is_no_soliton(shown):
    shown(SolitonState(motion_name='flipper', solitons=[]), r'[\\\\\\\\]  no soliton, flipper')


def test_as_a_person_runs_it_in_a_namespace(graph, named, start):
    program = start('watch_soliton', '--ros-args', '-r', '__ns:=/left')
    topic = interfaces.CHAIN
    publisher = graph.user.create_publisher(topic.type, f'/left/{topic.name}', topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(0)))
    said = 'no joint_states, soliton_state yet; start simulator, soliton_analyser'
    graph.until(lambda: said in program.said, said)
    assert program.stop(signal.SIGINT) == 130


@pytest.mark.parametrize('chain_from', ['parameters', 'topic'])
def test_parameters_describe_the_chain_and_its_joints_in_two_messages(
    graph, named, capsys, chain_from
):
    text = ''
    graph.speak(interfaces.CHAIN, 0).publish(chain_to_msg(named, time_to_msg(0)))
    joint_names = [f'joint_{n}' for n in range(named.rotors)]
    own = {'chain_from': chain_from, 'chain.number_of_rotors': named.rotors}
    graph.start(WatchSoliton, {**own, 'joint_names': joint_names})
    named = NamedChain(named.chain, tuple(joint_names))
    frames = graph.speak(interfaces.JOINT_STATES)
    states = graph.speak(interfaces.SOLITON_STATE)
    angles = named.chain.uniform_state(-1)
    stamps = count(1)

    def publish() -> None:
        for half in halves(frame_of(named, angles, next(stamps), angles)):
            frames.publish(half)
        states.publish(SolitonState(solitons=[Soliton(rotor=3.0)]))

    def seen() -> bool:
        nonlocal text
        text += capsys.readouterr().err
        return r'[\\\O\\\\]  rotor   3.00' in text

    graph.user.create_timer(0.1, publish)
    graph.until(seen, 'the chain of the parameters', lambda: text)
    with pytest.raises(ValueError, match='joint_names has 1 names for 8 rotors'):
        graph.start(WatchSoliton, {**own, 'chain_from': 'parameters', 'joint_names': ['a']})


def test_each_rotor_has_its_mark():
    assert drawn(np.array([1.0, 0.4, 0.2, -0.3, -1.0, np.nan]), [], 80) == r'//||\?'


def test_a_uniform_chain_leans_one_way():
    assert drawn(np.ones(5), [], 5) == '/////'
    assert drawn(-np.ones(5), [], 5) == '\\\\\\\\\\'


def test_solitons_are_where_they_are_and_stay_on_the_line():
    assert drawn(np.ones(5), [2.6], 5) == '///O/'
    assert drawn(np.ones(5), [-3.0, 9.0], 5) == 'O///O'


def test_on_a_short_line_a_mark_is_the_mean_of_several():
    leans = np.concatenate([np.ones(500), -np.ones(500)])
    leans[:5] = np.nan
    picture = drawn(leans, [499.0], 10)
    assert picture == '////O\\\\\\\\\\'
    assert drawn(np.full(20, np.nan), [], 10) == 10 * '?'
