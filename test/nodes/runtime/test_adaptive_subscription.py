# SPDX-License-Identifier: Apache-2.0
"""Joint states are heard in whatever quality of service they are offered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from graphs import Graph
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import adaptive_subscription, interfaces
from soliton_linkage_nodes.runtime.adaptive_subscription import AdaptiveSubscription, heard_by_all
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

RELIABLE = interfaces.JOINT_STATES.qos


@pytest.fixture(autouse=True)
def looking_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive_subscription, '_LOOK_PERIOD', 0.05)


def listen(graph: Graph) -> list[JointState]:
    """Return a list to which all joint states are added that a node of its own hears."""
    heard: list[JointState] = []
    node = graph.start(lambda **kwargs: Node('listener', **kwargs))
    diagnostics = Diagnostics(node, 'listening', lambda: Report('well'))
    AdaptiveSubscription(node, interfaces.JOINT_STATES, heard.append, diagnostics)
    return heard


def speak(graph: Graph, qos: QoSProfile) -> Publisher:
    """Return a publisher of joint states that somebody listens to."""
    return graph.speak(replace(interfaces.JOINT_STATES, qos=qos))


def assert_heard(graph: Graph, publisher: Publisher, heard: list[JointState], name: str) -> None:
    graph.until(publisher.get_subscription_count, 'a subscriber')
    message = JointState(name=[name])

    def again() -> bool:
        publisher.publish(message)
        return message in heard

    graph.until(again, f'the joint states of {name}')


def test_a_best_effort_publisher_is_heard_and_one_that_comes_later(graph: Graph) -> None:
    heard = listen(graph)
    reliable = speak(graph, RELIABLE)
    assert_heard(graph, reliable, heard, 'reliable')
    driver = speak(graph, qos_profile_sensor_data)
    assert_heard(graph, driver, heard, 'driver')
    assert_heard(graph, reliable, heard, 'reliable as well')


def test_it_is_reliable_again_where_all_publishers_are(graph: Graph) -> None:
    heard = listen(graph)
    driver = speak(graph, qos_profile_sensor_data)
    assert_heard(graph, driver, heard, 'driver')
    graph.user.destroy_publisher(driver)
    assert_heard(graph, speak(graph, RELIABLE), heard, 'reliable')

    def reliability() -> set[ReliabilityPolicy]:
        infos = graph.user.get_subscriptions_info_by_topic(interfaces.JOINT_STATES.name)
        return {info.qos_profile.reliability for info in infos}

    graph.until(lambda: reliability() == {ReliabilityPolicy.RELIABLE}, 'a reliable subscription')


@pytest.mark.parametrize('create', [SolitonAnalyser, EdgeActuator, SolitonSteering])
def test_the_nodes_hear_sensor_data(graph: Graph, create: Callable[..., Node]) -> None:
    graph.start(create)
    speak(graph, qos_profile_sensor_data)


def test_several_publishers_are_named_once(graph: Graph, said: Callable[[], str]) -> None:
    listen(graph)
    speak(graph, RELIABLE)
    speak(graph, qos_profile_sensor_data)
    complaint = (
        '2 publishers of /joint_states, of which the one that was heard first is kept to: /user, '
        '/user; stop all but one'
    )
    graph.until(lambda: complaint in said(), 'the warning')
    third = speak(graph, RELIABLE)
    graph.until(third.get_subscription_count, 'a subscriber')
    assert said().count('publishers of /joint_states') == 1
    assert 'offering incompatible' not in said()


def test_what_all_publishers_offer_is_asked_for() -> None:
    latched = interfaces.CHAIN.qos
    assert heard_by_all([latched], 7).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert heard_by_all([latched, RELIABLE], 7).durability == DurabilityPolicy.VOLATILE
    both = heard_by_all([latched, qos_profile_sensor_data], 7)
    assert (both.reliability, both.depth) == (ReliabilityPolicy.BEST_EFFORT, 7)
