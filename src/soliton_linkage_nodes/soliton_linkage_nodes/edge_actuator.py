# SPDX-License-Identifier: Apache-2.0
"""The edge actuator: a soft actuator that drives the chain along its zero-energy mode."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.actuation import Edge, edge_mode
from soliton_linkage.quantities import quantity
from soliton_linkage_msgs.msg import EdgeCommand
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.chain_source import ChainSource
from soliton_linkage_nodes.conversions import (
    Array,
    NamedChain,
    frame_from_msg,
    impulses_to_msg,
    time_from_msg,
    torques_to_msg,
)
from soliton_linkage_nodes.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.parameters import declare, refuse_unknown
from soliton_linkage_nodes.process import run

_EDGES = {
    EdgeCommand.NEAREST: Edge.NEAREST,
    EdgeCommand.FIRST: Edge.FIRST,
    EdgeCommand.LAST: Edge.LAST,
}
_NANOSECONDS = 10**9


@dataclass(frozen=True)
class EdgeActuatorParameters:
    """Parameters of the actuator."""

    nudge_edge: str = quantity(
        'nearest',
        'edge that nudges are for; nearest is the one that the zero mode is nearer to',
        choices=tuple(edge.value for edge in Edge),
        adjustable=True,
    )
    state_timeout: float = quantity(
        0.2, 'age beyond which joint_states are too old to act on', 's', 1e-3, 60.0
    )
    speed_limit: float = quantity(100.0, 'largest speed of a kick', 'rad/s', 0.0)
    pressure_limit: float = quantity(200e3, 'largest pressure', 'Pa', 0.0)
    torque_per_pressure: float = quantity(
        5e-8, 'torque along the unit zero mode that a pressure gives', 'N m/Pa', 0.0
    )


@dataclass(frozen=True)
class Pressure:
    """A pressure that is being held."""

    edge: Edge
    torque: float
    """Along the unit zero mode [N m]."""
    end: float
    """Stamp of the joint states at which it ends [ns]."""


class EdgeActuator(Node):
    """Turns nudges and edge commands into impulses and torques along the zero-energy mode.

    Subscribes to `nudge`, `edge_command`, `joint_states` and, unless told the chain by
    parameters, to `chain`. Publishes `rotor_impulses`, `rotor_torques` and `/diagnostics`.
    Parameters: those of `EdgeActuatorParameters`, `chain_from`, and `chain.*` of `Chain` [SI].
    """

    def __init__(self, **kwargs: Any) -> None:
        """Connect the topics."""
        super().__init__('edge_actuator', **kwargs)
        self.settings = declare(self, EdgeActuatorParameters)
        self._latest: bytes | None = None
        self._latest_at = -math.inf
        self._pressure: Pressure | None = None
        self._carried_out = 0
        self._diagnostics = Diagnostics(self, 'actuation', self._report)
        self._source = ChainSource(self, self._diagnostics)
        refuse_unknown(self)
        self._impulses, self._torques = (
            self.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (interfaces.ROTOR_IMPULSES, interfaces.ROTOR_TORQUES)
        )
        for topic, callback in (
            (interfaces.NUDGE, self._on_nudge),
            (interfaces.EDGE_COMMAND, self._on_edge_command),
        ):
            self.create_subscription(topic.type, topic.name, callback, topic.qos)
        topic = interfaces.JOINT_STATES
        self.create_subscription(
            topic.type, topic.name, self._on_joint_states, topic.qos, raw=True
        )

    def _on_joint_states(self, serialized: bytes) -> None:
        self._latest, self._latest_at = serialized, time.monotonic()
        if self._pressure is not None:
            try:
                self._press(self._pressure)
            except ValueError as error:
                self._diagnostics.refuse('joint_states', error)

    def _on_nudge(self, message: Float64) -> None:
        edge = Edge(self.get_parameter('nudge_edge').value)
        try:
            self._kick(edge, message.data)
        except ValueError as error:
            self._diagnostics.refuse('nudge', error)

    def _on_edge_command(self, message: EdgeCommand) -> None:
        try:
            if message.edge not in _EDGES:
                raise ValueError(f'edge = {message.edge} must be one of 0, 1, 2')
            if message.kind == EdgeCommand.KICK:
                if message.duration != 0:
                    raise ValueError(
                        f'duration of a kick = {message.duration:g} s must be 0; '
                        'a kick acts at once, use PRESSURE for what lasts'
                    )
                self._kick(_EDGES[message.edge], message.value)
            elif message.kind == EdgeCommand.PRESSURE:
                self._start_pressure(_EDGES[message.edge], message.value, message.duration)
            else:
                raise ValueError(f'kind = {message.kind} must be one of 0, 1')
        except ValueError as error:
            self._diagnostics.refuse('edge_command', error)

    def _kick(self, edge: Edge, speed: float) -> None:
        """Give the zero mode a speed [rad/s], away from the edge where it is positive."""
        _check('speed', speed, self.settings.speed_limit, 'rad/s')
        if not self._impulses.get_subscription_count():
            raise ValueError('nothing subscribes to rotor_impulses; start the simulator first')
        named, angles, _ = self._state()
        impulses = named.chain.moment_of_inertia * speed * edge_mode(named.chain, angles, edge)
        now = self.get_clock().now().to_msg()
        self._impulses.publish(impulses_to_msg(named, impulses, now))
        self._carried_out += 1

    def _start_pressure(self, edge: Edge, pressure: float, duration: float) -> None:
        """Hold a pressure [Pa] for a duration [s] of the joint states' time, 0 for ever."""
        _check('pressure', pressure, self.settings.pressure_limit, 'Pa')
        if not (math.isfinite(duration) and duration >= 0):
            raise ValueError(f'duration = {duration:g} s must be a finite number of 0 or more')
        if not self._torques.get_subscription_count():
            raise ValueError('nothing subscribes to rotor_torques; start the simulator first')
        named, angles, stamp = self._state()
        side = edge.resolved(named.chain, angles)
        edge_mode(named.chain, angles, side)
        torque = pressure * self.settings.torque_per_pressure
        end = stamp + round(duration * _NANOSECONDS) if duration else math.inf
        self._pressure = Pressure(side, torque, end)
        self._carried_out += 1
        self._press(self._pressure)

    def _press(self, pressure: Pressure) -> None:
        """Send the torques of the pressure that is held, for the mode as it is now."""
        named, angles, stamp = self._state()
        if pressure.torque == 0 or stamp >= pressure.end:
            self._pressure = None
            torques = 0 * angles
        else:
            torques = pressure.torque * edge_mode(
                named.chain, angles, pressure.edge, anywhere=True
            )
        self._torques.publish(torques_to_msg(named, torques, self.get_clock().now().to_msg()))

    def _state(self) -> tuple[NamedChain, Array, int]:
        """Return the chain, its angles [rad] and their stamp [ns]; ValueError if they are old."""
        if self._source.named is None:
            raise ValueError(
                'the chain is not known yet; publish chain or set chain_from to parameters'
            )
        age = time.monotonic() - self._latest_at
        if self._latest is None or age > self.settings.state_timeout:
            seen = 'none has come' if self._latest is None else f'the last is {age:.3g} s old'
            raise ValueError(
                f'no fresh joint_states: {seen}, the limit is {self.settings.state_timeout:g} s; '
                'start or resume the simulator, or raise state_timeout'
            )
        message = deserialize_message(self._latest, JointState)
        frame = frame_from_msg(self._source.named, message)
        return self._source.named, frame.angles, time_from_msg(message.header.stamp)

    def _report(self) -> Report:
        age = time.monotonic() - self._latest_at
        fresh = age <= self.settings.state_timeout
        message = (
            'waiting for the topic chain'
            if self._source.named is None
            else 'waiting for joint_states'
            if not fresh
            else 'nothing subscribes to rotor_impulses'
            if not self._impulses.get_subscription_count()
            else 'holding a pressure'
            if self._pressure is not None
            else 'ready'
        )
        values = {
            'commands carried out': self._carried_out,
            'age of joint_states [s]': age,
            'subscribers': self._impulses.get_subscription_count(),
        }
        return Report(message, values, warning=message not in ('ready', 'holding a pressure'))


def _check(name: str, value: float, limit: float, unit: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f'{name} = {value} {unit} must be a finite number')
    if abs(value) > limit:
        raise ValueError(
            f'{name} = {value:g} {unit} must lie in the range {-limit:g} to {limit:g} {unit}; '
            f'ask for less or raise {name}_limit'
        )


def main() -> None:
    """Run the actuator until it is told to stop."""
    run(EdgeActuator)
