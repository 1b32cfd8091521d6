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

from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.matching import wait_for_subscriber
from soliton_linkage_nodes.runtime.process import initialise, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_LONGEST_WAIT = 5.0
"""For an actuator that runs to be found, with room for a busy machine [s]."""
_POLL_INTERVAL = Duration(seconds=0.1)
"""How soon it ends when it is told to."""


def publish_nudge(
    node: Node,
    speed: float,
    stopping: threading.Event,
    subscribers: int = 1,
    timeout: float = _LONGEST_WAIT,
) -> None:
    """Publish a nudge [rad/s] once somebody listens, or as many as asked for.

    Raises ValueError where they do not.
    """
    topic = interfaces.NUDGE
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    if wait_for_subscriber(publisher, timeout, stopping, subscribers):
        publisher.publish(Float64(data=speed))
        deadline = time.monotonic() + _LONGEST_WAIT
        while not (stopping.is_set() or publisher.wait_for_all_acked(_POLL_INTERVAL)):
            if time.monotonic() > deadline:
                raise ValueError(f'the subscriber of {publisher.topic_name} does not respond')
    elif not stopping.is_set():
        raise ValueError(
            f'{publisher.topic_name} has {publisher.get_subscription_count()} of {subscribers} '
            f'subscribers after {timeout:g} s; '
            'start edge_actuator first'
        )


def main() -> None:
    """Publish the nudge that the command line asks for."""
    parser = argparse.ArgumentParser(prog='nudge', description=__doc__)
    parser.add_argument('speed', type=float, help='of the kick along the zero mode [rad/s]')
    parser.add_argument(
        '--subscribers', type=int, default=1, help='how many to wait for, a recorder being one'
    )
    parser.add_argument(
        '--timeout', type=float, default=_LONGEST_WAIT, help='how long to wait for them [s]'
    )
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    stopping = stop_on_signals()
    try:
        initialise()
        node = rclpy.create_node('nudge')
        publish_nudge(node, options.speed, stopping, options.subscribers, options.timeout)
    except ValueError as error:
        sys.exit(f'nudge: {error}')
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(INTERRUPTED)
