# SPDX-License-Identifier: Apache-2.0
"""Publishers that come and go are told once, heard or not, and nothing outlives a subscription."""

from __future__ import annotations

from graphs import Graph
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

from soliton_linkage_nodes.runtime.intake.guarded import GuardedNode
from soliton_linkage_nodes.runtime.intake.publisher_changes import PublisherChanges

RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_who_comes_and_goes_is_told_once_and_nothing_outlives_the_subscription(
    graph: Graph,
) -> None:
    node = graph.start(lambda **kwargs: GuardedNode('listener', **kwargs))
    subscription = node.create_subscription(Float64, 'x', lambda _: None, RELIABLE)
    changes = PublisherChanges(node, subscription)
    assert not changes.take()
    heard = graph.user.create_publisher(Float64, 'x', RELIABLE)
    graph.until(changes.take, 'that one came')
    assert not changes.take()
    graph.user.create_publisher(Float64, 'x', BEST_EFFORT)
    graph.until(changes.take, 'that one came who cannot be heard')
    assert subscription.get_publisher_count() == 1
    graph.user.destroy_publisher(heard)
    graph.until(changes.take, 'that one went')
    assert subscription.get_publisher_count() == 0
    other = graph.user.create_publisher(Float64, 'x', RELIABLE)
    graph.until(other.get_subscription_count, 'the subscription')
    node.destroy_subscription(subscription)
    graph.until(lambda: not other.get_subscription_count(), 'its end')
    assert not changes.take()
