# SPDX-License-Identifier: Apache-2.0
"""No node fails of a value in a documented range, or of a message, whatever is in it."""

from __future__ import annotations

import inspect
from typing import Any

import pytest
from graphs import Graph
from hostile_values import ROTORS, messages, parameters
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from rclpy.serialization import serialize_message

from soliton_linkage_msgs.srv import Reset
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
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
}
MOST_MESSAGES = 12
INFO = {'publication_sequence_number': None, 'source_timestamp': 0}
PATIENT = settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def attack(node: Any, data: DataObject) -> None:
    """Give a node messages on any of its topics, and calls, as its executor would."""
    subscriptions = sorted(node.subscriptions, key=lambda each: str(each.topic_name))
    for subscription in data.draw(
        st.lists(st.sampled_from(subscriptions), max_size=MOST_MESSAGES)
    ):
        message = data.draw(messages(subscription.msg_type))
        raw = subscription.raw
        told = serialize_message(message) if raw else message
        informed = len(inspect.signature(subscription.callback).parameters) == 2
        subscription.callback(*([told, INFO] if informed else [told]))
    for service in node.services:
        if service.srv_type is Reset:
            service.callback(data.draw(messages(Reset.Request)), Reset.Response())


@pytest.mark.parametrize('kind', NODES, ids=lambda kind: kind.__name__)
def test_no_value_of_a_range_and_no_message_is_a_failure(kind: Any, graph: Graph) -> None:
    @PATIENT
    @given(data=st.data())
    def survive(data: DataObject) -> None:
        given = data.draw(parameters(kind.PARAMETERS, NODES[kind]))
        try:
            node = graph.start(kind, given)
        except ValueError:
            return
        try:
            if list(node.subscriptions):
                attack(node, data)
            node.diagnostics.publish()
            assert node.diagnostics.failed == 0
        finally:
            graph.stop(node)

    survive()
