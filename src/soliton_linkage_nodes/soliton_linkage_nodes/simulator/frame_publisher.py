# SPDX-License-Identifier: Apache-2.0
"""The topics on which a simulator publishes its frames."""

from __future__ import annotations

from dataclasses import replace

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.messages.cdr import ImpulseBuffer, publish_buffer
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.pacing import let_others_go
from soliton_linkage_nodes.runtime.stamps import SECOND, time_to_msg
from soliton_linkage_nodes.simulator.delivery import DeliveryPublisher
from soliton_linkage_nodes.simulator.parameters import SimulatorParameters
from soliton_linkage_nodes.simulator.sensed_joints import SensedJoints


class FramePublisher:
    """Publishes frames and what acts at their instants, stamped from an epoch on.

    Of `joint_states`, `chain`, `delivery`, `delivered_impulses` and `/clock`.
    """

    def __init__(
        self, node: Node, named: NamedChain, joints: SensedJoints, settings: SimulatorParameters
    ) -> None:
        """Publish as a node."""
        self.epoch: int | None = None
        """Stamp of the first frame [ns], None before time has begun."""
        self.stamp = 0
        """Of the last frame [ns]."""
        self._node = node
        self._named = named
        self._joints = joints
        self._rate = settings.publish_rate
        deep = interfaces.stream_qos(len(joints))
        self._joint_states = replace(interfaces.JOINT_STATES, qos=deep).publisher(node)
        self._clock = interfaces.CLOCK.publisher(node) if settings.publish_clock else None
        self._chain = interfaces.CHAIN.publisher(node)
        self._impulses = interfaces.DELIVERED_IMPULSES.publisher(node)
        self._impulse_buffer = ImpulseBuffer(named)

    @property
    def subscribers(self) -> int:
        """How many listen to the joint states."""
        return int(self._joint_states.get_subscription_count())

    @property
    def depth(self) -> int:
        """How many frames a subscriber can hold."""
        return int(self._joint_states.qos_profile.depth)

    def begin(self) -> None:
        """Announce the chain; the first frame is now. What has begun goes on."""
        if self.epoch is not None:
            return
        self.epoch = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._chain.publish(chain_to_msg(self._named, time_to_msg(self.epoch)))
        self._delivery = DeliveryPublisher(self._node, self._named.rotors, self.epoch)

    def flush(self) -> None:
        """Wait, not for long, until the last frames are heard."""
        interfaces.let_be_heard(self._joint_states)

    def tell(self, frame: int, impulses: Array) -> None:
        """Tell of impulses [N m s] that act at a frame, ahead of it.

        What one process publishes comes in its order, but for what has to be sent again.
        """
        buffer = self._impulse_buffer.fill(self._stamp_of(frame), impulses)
        publish_buffer(self._impulses, buffer)

    def publish(self, frame: int, simulation: Simulation) -> None:
        """Publish the frame of a number, that a simulation is at."""
        stamp = self.stamp = self._stamp_of(frame)
        if self._clock is not None:
            self._clock.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
        publish_buffer(self._joint_states, self._joints.fill(stamp, frame, simulation))
        let_others_go()
        self._delivery.note(stamp, simulation)

    def _stamp_of(self, frame: int) -> int:
        return (self.epoch or 0) + round(frame * SECOND / self._rate)
