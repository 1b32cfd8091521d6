# SPDX-License-Identifier: Apache-2.0
"""Everybody publishes and subscribes with the type and quality of service of the table."""

import threading

from hypothesis import given
from hypothesis import strategies as st
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.programs.experiment.observer import Observer
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.interfaces import wait_for_subscriber
from soliton_linkage_nodes.simulator.node import Simulator
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser

ENDPOINTS = {
    'chain': (1, 4),
    'identified_chain': (0, 1),
    'joint_states': (1, 3),
    'joint_state_deviations': (0, 2),
    'nudge': (1, 2),
    'edge_command': (1, 2),
    'joint_commands': (0, 2),
    'edge_actuator/commands': (0, 2),
    'edge_actuator/joint_trajectory': (0, 2),
    'last_kick': (1, 1),
    'delivery': (1, 2),
    'delivered_impulses': (1, 2),
    'rotor_impulses': (1, 2),
    'rotor_torques': (1, 2),
    'tilt': (0, 2),
    'soliton_state': (1, 2),
    'soliton_events': (1, 1),
    '/diagnostics': (4, 2),
}


def test_publishers_and_subscribers_agree_with_the_table(graph, tmp_path):
    nodes = [
        graph.start(create, namespace='/lab')
        for create in (Simulator, EdgeActuator, SolitonAnalyser, Observer)
    ]
    output = {'output': str(tmp_path / 'bag')}
    nodes.append(graph.start(BagRecorder, output, namespace='/lab'))
    assert ENDPOINTS.keys() == {topic.name for topic in interfaces.SUITE_TOPICS}
    for topic in interfaces.SUITE_TOPICS:
        publishers, subscribers = ENDPOINTS[topic.name]
        name = topic.name if topic.name.startswith('/') else f'/lab/{topic.name}'
        for seen, expected in (
            (graph.user.get_publishers_info_by_topic, publishers),
            (graph.user.get_subscriptions_info_by_topic, subscribers),
        ):
            graph.until(lambda s=seen, n=name, e=expected: len(s(n)) == e, f'endpoints of {name}')
            for endpoint in seen(name):
                assert endpoint.topic_type == type_name(topic.type)
                assert endpoint.qos_profile.reliability == topic.qos.reliability
                assert endpoint.qos_profile.durability == topic.qos.durability
    # Discovery does not transmit depths, so the nodes are queried. A node that receives a whole
    # replay has a larger depth than the table; no node has a smaller one.
    depths = {
        (endpoint.topic_name, endpoint.qos_profile.depth)
        for node in nodes
        for endpoint in [*node.publishers, *node.subscriptions]
    }
    for topic in interfaces.SUITE_TOPICS:
        name = topic.name if topic.name.startswith('/') else f'/lab/{topic.name}'
        # The subscriptions of the recorder belong to a separate node.
        own = [depth for other, depth in depths if other == name]
        assert min(own, default=topic.qos.depth) == topic.qos.depth


def test_topics_are_reliable_and_latched_ones_serve_late_joiners():
    lasting = (
        interfaces.CHAIN,
        interfaces.IDENTIFIED_CHAIN,
        interfaces.LAST_KICK,
        interfaces.DELIVERY,
    )
    for topic in interfaces.SUITE_TOPICS:
        assert topic.qos.reliability == ReliabilityPolicy.RELIABLE
        assert topic.latched == (topic in lasting)
        assert (topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL) == topic.latched


@given(st.integers(0, 10**12))
def test_queues_hold_10_to_1000_messages_and_64_mebibytes_where_these_allow(size):
    depth = interfaces.stream_qos(size).depth
    assert 10 <= depth <= 1000
    assert depth == 10 or depth * size <= 64 * 2**20
    assert depth == 1000 or (depth + 1) * size > 64 * 2**20


TOPIC = interfaces.NUDGE
FOR_EVER = 1e6


def test_the_wait_ends_in_time_or_on_a_stop_request_without_a_subscriber(graph):
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    assert not wait_for_subscriber(publisher, 0.0)
    stopping = threading.Event()
    stopping.set()
    assert not wait_for_subscriber(publisher, FOR_EVER, stopping)


def test_it_waits_for_as_many_as_asked_for(graph):
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    graph.hear(TOPIC)
    assert wait_for_subscriber(publisher, FOR_EVER)
    assert not wait_for_subscriber(publisher, 0.0, fewest=2)
    graph.hear(TOPIC)
    assert wait_for_subscriber(publisher, FOR_EVER, fewest=2)
