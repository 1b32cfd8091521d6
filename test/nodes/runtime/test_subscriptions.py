# SPDX-License-Identifier: Apache-2.0
"""A subscription receives joint states with any offered quality of service."""

import time
from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from graphs import Graph, values
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.guarded import GuardedNode
from soliton_linkage_nodes.runtime.subscriptions import (
    AdaptiveSubscription,
    StreamSubscription,
    qos_for_all,
)
from soliton_linkage_nodes.soliton_analyser.node import SolitonAnalyser
from soliton_linkage_nodes.soliton_steering.node import SolitonSteering

RELIABLE = interfaces.JOINT_STATES.qos


def speak(graph: Graph, qos: QoSProfile) -> Publisher:
    """Return a publisher of joint states that has a subscriber."""
    return graph.speak(replace(interfaces.JOINT_STATES, qos=qos))


def assert_heard(graph: Graph, publisher: Publisher, heard: list[str], name: str) -> None:
    graph.until(publisher.get_subscription_count, 'a subscriber')

    def again() -> bool:
        publisher.publish(JointState(name=[name]))
        return name in heard

    graph.until(again, f'the joint states of {name}')


def test_a_best_effort_publisher_and_a_later_one_are_received(graph):
    heard = Listener(graph).heard
    reliable = speak(graph, RELIABLE)
    assert_heard(graph, reliable, heard, 'reliable')
    driver = speak(graph, qos_profile_sensor_data)
    assert_heard(graph, driver, heard, 'driver')
    assert_heard(graph, reliable, heard, 'reliable as well')


def test_it_is_reliable_again_if_all_publishers_are(graph):
    heard = Listener(graph).heard
    driver = speak(graph, qos_profile_sensor_data)
    assert_heard(graph, driver, heard, 'driver')
    graph.user.destroy_publisher(driver)
    assert_heard(graph, speak(graph, RELIABLE), heard, 'reliable')

    def reliability() -> set[ReliabilityPolicy]:
        infos = graph.user.get_subscriptions_info_by_topic(interfaces.JOINT_STATES.name)
        return {info.qos_profile.reliability for info in infos}

    graph.until(lambda: reliability() == {ReliabilityPolicy.RELIABLE}, 'a reliable subscription')


@pytest.mark.parametrize('create', [SolitonAnalyser, EdgeActuator, SolitonSteering])
def test_the_nodes_receive_sensor_data(graph, create):
    graph.start(create)
    speak(graph, qos_profile_sensor_data)


def test_several_publishers_are_named_once(graph, said):
    Listener(graph)
    speak(graph, RELIABLE)
    speak(graph, qos_profile_sensor_data)
    complaint = (
        '2 nodes publish /joint_states: /user, /user; only messages of the first one received are '
        'used; stop the others'
    )
    graph.until(lambda: complaint in said(), 'the warning')
    third = speak(graph, RELIABLE)
    graph.until(third.get_subscription_count, 'a subscriber')
    assert said().count('nodes publish /joint_states') == 1
    assert 'offering incompatible' not in said()


def test_the_common_offer_of_all_publishers_is_requested():
    latched = interfaces.CHAIN.qos
    assert qos_for_all([latched], 7).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert qos_for_all([latched, RELIABLE], 7).durability == DurabilityPolicy.VOLATILE
    both = qos_for_all([latched, qos_profile_sensor_data], 7)
    assert (both.reliability, both.depth) == (ReliabilityPolicy.BEST_EFFORT, 7)


class Listener:
    """Node that receives joint states and needs time for each."""

    def __init__(
        self, graph: Graph, longest_lag: float = 60.0, takes: float = 0.0, latest: bool = False
    ) -> None:
        self.heard: list[str] = []
        self._takes = takes
        self.node = graph.start(lambda **kwargs: GuardedNode('listener', **kwargs))
        self.diagnostics = Diagnostics(self.node, 'listening', lambda: Report('well'))
        self.subscription = StreamSubscription(
            self.node,
            interfaces.JOINT_STATES,
            self._take,
            self.diagnostics,
            longest_lag=longest_lag,
            latest=latest,
        )

    def _take(self, message: JointState) -> None:
        time.sleep(self._takes)
        self.heard.append(message.name[0])


def test_messages_beyond_the_queue_are_counted_and_reported(graph, said):
    listener = Listener(graph)
    publisher = speak(graph, RELIABLE)
    publisher.publish(JointState(name=['0']))
    graph.until(lambda: listener.heard, 'the first')
    for number in range(1, 1501):
        publisher.publish(JointState(name=[str(number)]))
    graph.until(lambda: listener.heard[-1] == '1500', 'the last')
    lost = 1501 - len(listener.heard)
    assert lost > 0
    status = graph.next_report('listener')
    assert values(status)['lost joint_states'] == str(lost)
    assert status.level == DiagnosticStatus.WARN
    assert f'{lost} messages of /joint_states were lost and 0 skipped' in said()


def test_a_node_that_lags_too_long_skips_to_the_newest(graph):
    listener = Listener(graph, longest_lag=0.1, takes=0.005)
    publisher = speak(graph, RELIABLE)
    publisher.publish(JointState(name=['0']))
    graph.until(lambda: listener.heard, 'the first')
    for number in range(1, 501):
        publisher.publish(JointState(name=[str(number)]))
    graph.until(lambda: listener.heard[-1] == '500', 'the last')
    assert len(listener.heard) + listener.subscription.skipped == 501
    assert listener.subscription.skipped > 0
    assert values(graph.next_report('listener'))['lost joint_states'] == '0'


def test_the_first_of_two_publishers_is_used_until_it_ends(graph):
    listener = Listener(graph)
    first, second = speak(graph, RELIABLE), speak(graph, RELIABLE)
    for number in range(20):
        first.publish(JointState(name=[f'first {number}']))
    graph.until(lambda: len(listener.heard) == 20, 'the first publisher')
    for _ in range(5):
        second.publish(JointState(name=['second']))
        first.publish(JointState(name=['first again']))
    graph.until(lambda: listener.heard.count('first again') == 5, 'the first publisher again')
    assert 'second' not in listener.heard
    status = graph.next_report('listener')
    assert (status.level, values(status)['joint_states of others']) == (DiagnosticStatus.WARN, '5')
    assert 'only messages of the first one received are used' in status.message
    graph.user.destroy_publisher(first)
    assert_heard(graph, second, listener.heard, 'second')


def test_undispatched_messages_wait_until_they_are_taken(graph):
    listener = Listener(graph)
    subscription = listener.subscription
    subscription.dispatch(False)
    publisher = speak(graph, RELIABLE)
    graph.until(publisher.get_subscription_count, 'a subscriber')
    for number in range(20):
        publisher.publish(JointState(name=[str(number)]))
    waiting: list[str] = []

    def take() -> int:
        waiting.extend(message.name[0] for message in subscription.take_waiting())
        return len(waiting)

    graph.until(lambda: take() == 20, 'what waits', lambda: waiting)
    assert waiting == [str(number) for number in range(20)]
    assert not listener.heard
    publisher.publish(JointState(name=['before']))
    subscription.dispatch(True)
    publisher.publish(JointState(name=['after']))
    graph.until(lambda: len(listener.heard) == 2, 'waiting and new messages')
    assert listener.heard == ['before', 'after']
    assert values(graph.next_report('listener'))['lost joint_states'] == '0'


def test_with_latest_older_messages_are_skipped(graph):
    listener = Listener(graph, takes=0.01, latest=True)
    publisher = speak(graph, RELIABLE)
    graph.until(publisher.get_subscription_count, 'a subscriber')
    for number in range(200):
        publisher.publish(JointState(name=[str(number)]))
    graph.until(lambda: listener.heard[-1:] == ['199'], 'the last')
    assert len(listener.heard) + listener.subscription.skipped == 200
    status = graph.next_report('listener')
    assert (status.level, values(status)['lost joint_states']) == (DiagnosticStatus.OK, '0')


def test_publishers_that_come_and_go_are_noticed_once_and_the_subscription_can_end(graph):
    node = graph.start(lambda **kwargs: GuardedNode('listener', **kwargs))
    topic = replace(interfaces.JOINT_STATES, name='x')
    adaptive = AdaptiveSubscription(node, topic, lambda _: None)
    assert not adaptive.changed
    received = graph.user.create_publisher(JointState, 'x', RELIABLE)
    graph.until(lambda: adaptive.changed, 'a compatible publisher')
    assert not adaptive.changed
    graph.user.create_publisher(JointState, 'x', qos_profile_sensor_data)
    graph.until(lambda: adaptive.changed, 'an incompatible publisher')
    assert adaptive.connected == 1
    graph.user.destroy_publisher(received)
    graph.until(lambda: adaptive.changed, 'its end')
    assert adaptive.connected == 0
    other = graph.user.create_publisher(JointState, 'x', RELIABLE)
    graph.until(other.get_subscription_count, 'the subscription')
    adaptive.close()
    graph.until(lambda: not other.get_subscription_count(), 'its end')
    assert not adaptive.changed
