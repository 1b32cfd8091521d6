# SPDX-License-Identifier: Apache-2.0
"""Custom encoder driver: a node that publishes the angles that a function returns.

Run the analyser in a second terminal, and specify the chain by parameters of the analyser:

    soliton_analyser --ros-args -p chain_from:=parameters -p chain.number_of_rotors:=20
"""

import math
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.runtime.interfaces import JOINT_STATES

ROTORS = 20
RATE = 100.0
"""Frame rate [Hz]."""


def read_angles(time: float) -> list[float]:
    """Return the angle of each rotor [rad] from +z towards +x, NaN if an encoder has no reading.

    This example reads no encoders. It simulates a wall of width 2 rotor spacings that moves from
    rotor 0 to the last rotor at 5 rotors/s. Odd rotors report phi = pi - theta.
    """
    site = 5 * time % ROTORS
    lean = [0.97 * math.tanh((site - rotor) / 2) for rotor in range(ROTORS)]
    return [theta if rotor % 2 == 0 else math.pi - theta for rotor, theta in enumerate(lean)]


class EncoderDriver(Node):
    """Publisher of `joint_states` [rad] at a constant rate."""

    def __init__(self, read: Callable[[float], list[float]] = read_angles, **kwargs) -> None:
        """Start the timer; `read` takes the time since the start [s]."""
        super().__init__('encoders', **kwargs)
        self._read = read
        self._names = [f'rotor_{rotor}' for rotor in range(ROTORS)]
        self._publisher = JOINT_STATES.publisher(self)
        self._start = self.get_clock().now()
        self.create_timer(1 / RATE, self._publish)

    def _publish(self) -> None:
        now = self.get_clock().now()
        message = JointState(name=self._names)
        message.header.stamp = now.to_msg()
        message.header.frame_id = 'linkage'
        message.position = self._read((now - self._start).nanoseconds * 1e-9)
        self._publisher.publish(message)


def main() -> None:
    """Publish until Ctrl-C."""
    rclpy.init()
    try:
        rclpy.spin(EncoderDriver())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
