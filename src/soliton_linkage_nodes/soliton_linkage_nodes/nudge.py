# SPDX-License-Identifier: Apache-2.0
"""One nudge from the command line, for machines without `ros2 topic pub`."""

from __future__ import annotations

import argparse
import sys
import threading
import time

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64

from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.matching import wait_for_subscriber
from soliton_linkage_nodes.process import initialise, stop_on_signals

_LONGEST_WAIT = 5.0
_POLL_INTERVAL = Duration(seconds=0.1)
_INTERRUPTED = 130


def publish_nudge(node: Node, speed: float, stopping: threading.Event) -> None:
    """Publish a nudge [rad/s] once somebody listens; raises ValueError where nobody does."""
    topic = interfaces.NUDGE
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    if wait_for_subscriber(publisher, _LONGEST_WAIT, stopping):
        publisher.publish(Float64(data=speed))
        deadline = time.monotonic() + _LONGEST_WAIT
        while not (stopping.is_set() or publisher.wait_for_all_acked(_POLL_INTERVAL)):
            if time.monotonic() > deadline:
                raise ValueError(f'the subscriber of {publisher.topic_name} does not respond')
    elif not stopping.is_set():
        raise ValueError(
            f'nothing subscribes to {publisher.topic_name} after {_LONGEST_WAIT:g} s; '
            'start edge_actuator first'
        )


def main() -> None:
    """Publish the nudge that the command line asks for."""
    parser = argparse.ArgumentParser(prog='nudge', description=__doc__)
    parser.add_argument('speed', type=float, help='of the kick along the zero mode [rad/s]')
    speed = parser.parse_args(remove_ros_args(sys.argv)[1:]).speed
    stopping = stop_on_signals()
    try:
        initialise()
        publish_nudge(rclpy.create_node('nudge'), speed, stopping)
    except ValueError as error:
        sys.exit(f'nudge: {error}')
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(_INTERRUPTED)
