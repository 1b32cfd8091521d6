# SPDX-License-Identifier: Apache-2.0
"""No node fails of a value in a documented range, or of a message, whatever is in it."""

import inspect
from collections.abc import Sequence
from functools import partial
from typing import Any

import pytest
from graphs import Graph
from hostile_values import PATIENT, ROTORS, messages, parameters
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from rclpy.serialization import serialize_message
from recordings import run_of, write_bag

from soliton_linkage_nodes.bags.play.playback_clock import PlaybackClock
from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime.interfaces import SUITE_TOPICS
from soliton_linkage_nodes.serial_encoders.node import SerialEncoders
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering
from soliton_linkage_nodes.visualisation.node import Visualisation

SMALL = {'chain.number_of_rotors': ROTORS}
NODES = {
    Simulator: SMALL,
    EdgeActuator: {**SMALL, 'actuator': 'pneumatic'},
    SolitonAnalyser: SMALL,
    SolitonSteering: SMALL,
    Visualisation: SMALL,
    BagRecorder: {},
    BagPlayer: {},
    SerialEncoders: SMALL,
}
MOST_MESSAGES = 12
OF_EVERY_NODE = ('rcl_interfaces', 'type_description_interfaces')
INFO = {'publication_sequence_number': None, 'source_timestamp': 0, 'received_timestamp': 0}


def attack(node: Any, data: DataObject) -> None:
    """Give a node messages on any of its topics, and calls, as its executor would."""
    for _ in range(data.draw(st.integers(0, MOST_MESSAGES))):
        services = [
            each
            for each in node.services
            if each.srv_type.__module__.partition('.')[0] not in OF_EVERY_NODE
        ]
        within_reach = [*node.subscriptions, *services]
        if not within_reach:
            return
        within_reach.sort(key=lambda each: str(getattr(each, 'topic_name', '') or each.srv_name))
        each = data.draw(st.sampled_from(within_reach))
        if each in services:
            request = data.draw(messages(each.srv_type.Request))
            each.callback(request, each.srv_type.Response())
            continue
        message = data.draw(messages(each.msg_type))
        told = serialize_message(message) if each.raw else message
        informed = len(inspect.signature(each.callback).parameters) == 2
        each.callback(*([told, INFO] if informed else [told]))


def survive(graph: Graph, kind: Any, fixed: dict[str, Any], speakers: Sequence[Any]) -> None:
    """Start nodes of some parameters, and let come what may."""

    @PATIENT
    @given(data=st.data())
    def one(data: DataObject) -> None:
        given = data.draw(parameters(kind.PARAMETERS, fixed))
        try:
            node = graph.start(kind, given)
        except (ValueError, OSError):
            return
        try:
            for speaker in data.draw(st.lists(st.sampled_from(speakers), max_size=MOST_MESSAGES)):
                speaker.publish(data.draw(messages(speaker.msg_type)))
            graph.until(iter((False, True)).__next__, 'a turn')
            attack(node, data)
            if getattr(node, 'configured', True):
                node.diagnostics.publish()
            assert node.diagnostics.failed == 0
            failure = getattr(node, 'failure', None)
            assert failure is None or isinstance(failure, (ValueError, OSError))
        finally:
            graph.stop(node)

    one()


@pytest.mark.parametrize('kind', NODES, ids=lambda kind: kind.__name__)
def test_no_value_of_a_range_and_no_message_is_a_failure(
    kind, graph, named, tmp_path, monkeypatch, terminal
):
    # The random output path of a recorder is a name in this folder.
    monkeypatch.chdir(tmp_path)
    brief = partial(PlaybackClock, longest_burst=0.1)
    monkeypatch.setattr('soliton_linkage_nodes.bags.player.PlaybackClock', brief)
    needed = {
        BagPlayer: {'bag': str(write_bag(tmp_path / 'played', run_of(named, 5)))},
        SerialEncoders: {**SMALL, 'port': terminal.path},
    }
    speakers = [topic.publisher(graph.user) for topic in SUITE_TOPICS]
    survive(graph, kind, needed.get(kind, NODES[kind]), speakers)
