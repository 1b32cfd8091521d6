# SPDX-License-Identifier: Apache-2.0
"""Simple simulator in the style of the tutorials of ROS 2 and scipy.

A timer callback integrates the chain by `solve_ivp` with a right-hand side in numpy, fills a
JointState and publishes it.
"""

from __future__ import annotations

import signal
import sys

import numpy as np
import rclpy
from plain_chain import derivative
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from scipy.integrate import solve_ivp
from sensor_msgs.msg import JointState

from soliton_linkage.dynamics.initial_states import with_soliton
from soliton_linkage.linkage.chain import Chain


class TimerNode(Node):
    """Node that publishes joint_states from a timer."""

    def __init__(self, rotors: int, rate: float, position: float, velocity: float) -> None:
        """Start with a soliton at a position [rotor spacings] with a velocity [m/s]."""
        super().__init__('timer_node')
        self.chain = Chain(number_of_rotors=rotors)
        self.derive = lambda _time, state: derivative(self.chain, state)
        start = with_soliton(self.chain, position, velocity)
        self.state = np.concatenate([start.angles, start.rates])
        self.names = [f'rotor_{rotor}' for rotor in range(rotors)]
        self.period = 1 / rate
        self.publisher = self.create_publisher(JointState, 'joint_states', 10)
        self.timer = self.create_timer(self.period, self.on_timer)

    def on_timer(self) -> None:
        """Advance the chain by a period and publish its state."""
        solution = solve_ivp(self.derive, (0.0, self.period), self.state, rtol=1e-6, atol=1e-9)
        self.state = solution.y[:, -1]
        rotors = self.chain.number_of_rotors
        message = JointState()
        message.header.stamp = self.get_clock().now().to_msg()
        message.name = self.names
        message.position = self.state[:rotors].tolist()
        message.velocity = self.state[rotors:].tolist()
        self.publisher.publish(message)


def main() -> None:
    # If a signal of rclpy arrives during a callback, the shutdown causes various exceptions.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rotors, rate, position, velocity = sys.argv[1:]
    node = TimerNode(int(rotors), float(rate), float(position), float(velocity))
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
