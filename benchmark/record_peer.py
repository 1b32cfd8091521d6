# SPDX-License-Identifier: Apache-2.0
"""Simple recorder: a node whose callback writes each message to a file.

The subscription is raw, or the callback uses `serialize_message`, as in the tutorials of ROS 2. A
deep queue, no compression and one commit per second make it fast.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import rclpy
from mcap.writer import CompressionType, Writer
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.serialization import serialize_message

from soliton_linkage_nodes.bags.stored_topic import type_definition
from soliton_linkage_nodes.runtime.interfaces import JOINT_STATES

TYPE_NAME = 'sensor_msgs/msg/JointState'
SUBSCRIPTIONS = ('raw', 'typed')


class McapStore:
    """File of the mcap package."""

    def __init__(self, path: Path) -> None:
        self._file = path.open('wb')
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start('ros2')
        definition, _ = type_definition(TYPE_NAME)
        schema = self._writer.register_schema(TYPE_NAME, 'ros2msg', definition.encode())
        self._channel = self._writer.register_channel('/joint_states', 'cdr', schema)

    def add(self, stamp: int, serialized: bytes) -> None:
        """Store a message received at a time [ns]."""
        self._writer.add_message(self._channel, stamp, serialized, stamp)

    def commit(self) -> None:
        """Write all complete chunks to the file."""
        self._file.flush()

    def close(self) -> None:
        """End the file."""
        self._writer.finish()
        self._file.close()


class Recorder(Node):
    """Node that records joint states."""

    def __init__(self, store: McapStore, raw: bool) -> None:
        super().__init__('plain_recorder')
        self._store = store
        keep = self._keep_raw if raw else self._keep
        self.create_subscription(
            JOINT_STATES.type, JOINT_STATES.name, keep, JOINT_STATES.qos, raw=raw
        )
        self.create_timer(1.0, store.commit)

    def _keep_raw(self, serialized: bytes) -> None:
        self._store.add(self.get_clock().now().nanoseconds, serialized)

    def _keep(self, message: Any) -> None:
        self._keep_raw(serialize_message(message))


def main() -> None:
    subscription, path = sys.argv[1:]
    rclpy.init()
    store = McapStore(Path(path))
    try:
        rclpy.spin(Recorder(store, subscription == 'raw'))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        store.close()


if __name__ == '__main__':
    main()
