# SPDX-License-Identifier: Apache-2.0
"""One nudge from the command line, for machines without `ros2 topic pub`."""

from __future__ import annotations

import argparse
import sys

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64

from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.matching import wait_for_subscriber

_LONGEST_WAIT = 5.0
_TIME_TO_DELIVER = 0.5


def publish_nudge(node: Node, speed: float) -> None:
    """Publish a nudge [rad/s] once somebody listens; raises ValueError where nobody does."""
    topic = interfaces.NUDGE
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    if not wait_for_subscriber(publisher, _LONGEST_WAIT):
        raise ValueError(
            f'nothing subscribes to {publisher.topic_name} after {_LONGEST_WAIT:g} s; '
            'start edge_actuator first'
        )
    publisher.publish(Float64(data=speed))
    # Subscribers acknowledge at the next heartbeat, up to 3 s after they have the message.
    publisher.wait_for_all_acked(Duration(seconds=_TIME_TO_DELIVER))


def main() -> None:
    """Publish the nudge that the command line asks for."""
    parser = argparse.ArgumentParser(prog='nudge', description=__doc__)
    parser.add_argument('speed', type=float, help='of the kick along the zero mode [rad/s]')
    speed = parser.parse_args(remove_ros_args(sys.argv)[1:]).speed
    rclpy.init()
    node = rclpy.create_node('nudge')
    try:
        publish_nudge(node, speed)
    except ValueError as error:
        sys.exit(f'nudge: {error}')
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
