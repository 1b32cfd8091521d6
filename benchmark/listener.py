# SPDX-License-Identifier: Apache-2.0
"""Process that subscribes to topics of joint states and ignores the messages."""

from __future__ import annotations

import sys

import rclpy
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import initialise, stop_on_signals


def main() -> None:
    stopping = stop_on_signals()
    initialise([])
    node = rclpy.create_node('listener')
    for name in sys.argv[1:]:
        node.create_subscription(
            JointState, name, lambda _: None, interfaces.stream_qos(), raw=True
        )
    executor = EventsExecutor()
    executor.add_node(node)
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.1)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
