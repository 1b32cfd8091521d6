# SPDX-License-Identifier: Apache-2.0
"""An actuator on a bench, where the test plays the joints and the user."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from graphs import Graph, values
from joint_frames import frame_of
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.linkage.chain import Array
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes.edge_actuator.node import EdgeActuator
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    impulses_from_msg,
    torques_from_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg

PATIENT = {'state_timeout': 60.0}


class Bench:
    """An actuator between a test that plays the joints and one that plays the user."""

    def __init__(
        self, graph: Graph, named: NamedChain, parameters: dict[str, Any] | None = None
    ) -> None:
        self.graph, self.named = graph, named
        self.impulses = graph.hear(interfaces.ROTOR_IMPULSES)
        self.torques = graph.hear(interfaces.ROTOR_TORQUES)
        self.reports = graph.reports('edge_actuator')
        self.node = graph.start(EdgeActuator, {**PATIENT, **(parameters or {})})
        self._joints = graph.speak(interfaces.JOINT_STATES)
        self._nudges = graph.speak(interfaces.NUDGE)
        self._commands = graph.speak(interfaces.EDGE_COMMAND)
        for publisher in self.node.publishers:
            if publisher.topic_name in ('/rotor_impulses', '/rotor_torques'):
                graph.until(publisher.get_subscription_count, publisher.topic_name)
        self._stamp = 0.0

    def tell_chain(self) -> None:
        self.graph.speak(interfaces.CHAIN).publish(chain_to_msg(self.named, time_to_msg(0)))
        self.graph.until(lambda: self.node.source.named, 'the chain')

    def joints(self, angles: Array, stamp: float | None = None) -> None:
        """Publish joint states of a stamp [s], and wait until they are there."""
        self._stamp = self._stamp + 0.01 if stamp is None else stamp
        stamp_ns = round(self._stamp * 1e9)
        self.raw_joints(frame_of(self.named, angles, stamp_ns, 0 * angles))

    def raw_joints(self, message: JointState) -> None:
        before = self.node.frames.taken
        self.publish_joints(message)
        self.graph.until(lambda: self.node.frames.taken > before, 'the joint states')

    def publish_joints(self, message: JointState) -> None:
        self._joints.publish(message)

    def nudge(self, speed: float) -> None:
        self._nudges.publish(Float64(data=speed))

    def command(self, **fields: Any) -> None:
        self._commands.publish(EdgeCommand(**fields))

    def carry_out(self, **fields: Any) -> None:
        """Publish a command, and wait until it is accepted."""
        before = self.node.carried_out
        self.command(**fields)
        self.graph.until(lambda: self.node.carried_out > before, 'the command to be accepted')

    def set(self, name: str, value: Any) -> bool:
        """Set a parameter, and return whether that was allowed."""
        return bool(self.graph.change('edge_actuator', {name: value})[0].successful)

    def next_impulses(self) -> Array:
        """Return the angular impulse of each rotor of the one message that comes."""
        self.graph.until(lambda: self.impulses, 'impulses')
        (message,) = self.impulses
        self.impulses.clear()
        return impulses_from_msg(self._order(), message, math.inf)

    def drive(
        self, frames: Sequence[Array], start: float, period: float, messages: int = 0
    ) -> Array:
        """Publish frames from an instant on [s], and return the torques that come of it [N m].

        There must be so many messages of them and no more, or the last of them must be zero.
        """
        for number, angles in enumerate(frames):
            self.joints(angles, stamp=start + period * number)
        if not messages:
            heard = self.torques
            self.graph.until(lambda: heard and not any(heard[-1].effort), 'the end of torques')
        torques = np.array([self.next_torques() for _ in range(messages or len(self.torques))])
        self.graph.next_report('edge_actuator')
        assert self.torques == []
        return torques

    def next_torques(self) -> Array:
        self.graph.until(lambda: self.torques, 'torques')
        message = self.torques.pop(0)
        assert (len(message.position), len(message.velocity)) == (0, 0)
        return torques_from_msg(self._order(), message, math.inf)

    def refusal(self, number: int = 1) -> str:
        """Return the last rejection after a number of rejected commands."""
        self.graph.until(
            lambda: self.reports and values(self.reports[-1])['rejected'] == str(number),
            f'{number} rejections',
        )
        assert self.impulses == []
        return values(self.reports[-1])['last rejection']

    def _order(self) -> dict[str, int]:
        return {name: rotor for rotor, name in enumerate(self.named.joint_names)}
