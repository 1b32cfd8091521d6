# SPDX-License-Identifier: Apache-2.0
"""Recorded states are not played while an analyser publishes, unless requested."""

from pathlib import Path
from typing import Any

import pytest
from graphs import Graph, values
from rclpy.node import Node
from recordings import MILLISECOND, run_of, write_bag

from soliton_linkage_msgs.msg import SolitonState
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.services import service_type
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces


def bag_with_states(folder: Path, named: NamedChain, gap: int = MILLISECOND) -> Path:
    entries: list[Any] = []
    for topic, stamp, message in run_of(named, 30, gap)[1:-1]:
        entries.append((topic, stamp, message))
        state = SolitonState(header=message.header)
        entries.append((interfaces.SOLITON_STATE, stamp + gap // 2, state))
    return write_bag(folder / 'run', entries)


def start_analyser(graph: Graph, hears: bool = True) -> Node:
    """A node that is an analyser for all that can be seen of it."""
    node: Node = graph.start(lambda **kwargs: Node('another_analyser', **kwargs))
    interfaces.SOLITON_STATE.publisher(node)
    if hears:
        interfaces.JOINT_STATES.subscribe(node, lambda _: None)
    return node


@pytest.mark.parametrize(
    ('given', 'states', 'said'),
    [
        ({}, 0, '/another_analyser publishes /soliton_state: the recorded topic is omitted; '),
        (
            {'topics': ['joint_states', 'soliton_state']},
            30,
            '/another_analyser also publishes /soliton_state; both are mixed. ',
        ),
    ],
)
def test_an_analyser_comes_before_the_recording_unless_that_is_chosen(
    graph, named, tmp_path, capfd, given, states, said
):
    bag = bag_with_states(tmp_path, named)
    start_analyser(graph)
    heard, frames = graph.hear(interfaces.SOLITON_STATE), graph.hear(interfaces.JOINT_STATES)
    player = graph.start(BagPlayer, {'bag': str(bag), **given})
    graph.until(lambda: player.finished and len(frames) == 30, 'the end')
    graph.until(lambda: len(heard) == states, f'{states} states')
    figures = values(graph.next_report('bag_player'))
    assert figures['messages played'] == str(30 + states)
    assert figures['recorded states left out'] == str(30 - states)
    log = capfd.readouterr().err
    assert log.count(said) == 1
    left_out = f'played 30 of 60 messages of {bag}, 30 recorded states left out'
    assert (left_out in log) == (not states)


def test_a_node_that_does_not_receive_the_frames_is_no_analyser(graph, named, tmp_path):
    bag = bag_with_states(tmp_path, named)
    start_analyser(graph, hears=False)
    heard = graph.hear(interfaces.SOLITON_STATE)
    graph.hear(interfaces.JOINT_STATES)
    graph.start(BagPlayer, {'bag': str(bag)})
    graph.until(lambda: len(heard) == 30, 'the states')


def test_recorded_states_are_played_after_the_analyser_ends(graph, named, tmp_path):
    bag = bag_with_states(tmp_path, named, gap=200 * MILLISECOND)
    analyser = start_analyser(graph)
    heard, frames = graph.hear(interfaces.SOLITON_STATE), graph.hear(interfaces.JOINT_STATES)
    graph.start(BagPlayer, {'bag': str(bag), 'loop': True})
    graph.until(lambda: len(frames) > 3, 'some frames')
    assert heard == []
    graph.stop(analyser)
    graph.until(lambda: heard, 'a state')


def test_omitted_messages_are_no_steps_in_a_pause(graph, named, tmp_path):
    bag = bag_with_states(tmp_path, named)
    start_analyser(graph)
    frames = graph.hear(interfaces.JOINT_STATES)
    graph.start(BagPlayer, {'bag': str(bag), 'start_paused': True})

    def step() -> bool:
        return bool(graph.call(service_type('PlayNext'), 'bag_player/play_next').success)

    graph.until(step, 'one message')
    for number in (2, 3):
        assert step()
        graph.until(lambda n=number: len(frames) == n, f'frame {number}')
