# SPDX-License-Identifier: Apache-2.0
"""Edge actuator node, which drives the chain along its zero mode or joint by joint."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, make_dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from rclpy.node import Node

from soliton_linkage.actuation.actuators import ACTUATORS, actuator_type
from soliton_linkage.actuation.chain_driver import ChainDriver
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import Delivery
from soliton_linkage_nodes.edge_actuator.commands import (
    ActuatedChain,
    Commands,
    EdgeActuatorParameters,
)
from soliton_linkage_nodes.edge_actuator.topics import ActuatorPublishers, LatestFrames
from soliton_linkage_nodes.messages.chain_source import (
    CHAIN_SOURCE_PARAMETERS,
    ChainSource,
    declare_chain_source,
)
from soliton_linkage_nodes.messages.command_conversions import delivery_from_msg, joint_actuators
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.frames import EncoderMonitor, SerializedFrames
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.parameters import declare
from soliton_linkage_nodes.runtime.subscriptions import (
    AdaptiveSubscription,
    CountedSubscription,
    StreamSubscription,
)

_POLL_INTERVAL = 0.02
"""Poll interval for the frames of an idle chain [s]. It is shorter than the usual `state_timeout`.
Each poll also computes the zero mode, as a kick does. Frequent polls therefore keep this code in
the caches of the processor, and a kick starts sooner."""
_IDLE_AFTER = 1.0
"""A chain without commands for this time is idle [s]."""


class EdgeActuator(ManagedNode):
    """Node that converts commands to impulses and torques, and reports their effect.

    It subscribes to the commands `nudge` [rad/s], `edge_command`, `joint_commands` [N m],
    `~/commands` [N m] and `~/joint_trajectory` [N m]. It also subscribes to `joint_states` and
    `delivery`, and to `chain` unless parameters specify the chain. It publishes `rotor_impulses`
    [N m s], `rotor_torques` [N m], `last_kick` (latched) and `/diagnostics`.

    Each joint that the parameter `joints` names has a parameter `torque_limits.<joint>` [N m]. The
    parameter `actuator` selects the type of actuator.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        EdgeActuatorParameters: '',
        ManagedParameters: '',
        **dict.fromkeys(ACTUATORS.values(), ''),
        **CHAIN_SOURCE_PARAMETERS,
    }

    def declare_parameters_of_node(self) -> None:
        """Declare the parameters of the node, of the torque limits and of the actuator type."""
        settings = declare(self, EdgeActuatorParameters)
        self._torque_limits = declare_torque_limits(self, settings)
        self.actuator = declare(self, actuator_type(settings.actuator))
        declare_chain_source(self)

    def configure(self) -> None:
        """Create the publishers and the subscriptions."""
        settings = self.current(EdgeActuatorParameters)
        self._assembler = SerializedFrames()
        encoders = EncoderMonitor(self.get_logger().warning)
        self.frames = LatestFrames(settings.state_timeout, encoders.check)
        self.output = ActuatorPublishers(self)
        self.commands = Commands(settings, self.actuator, self.frames, self.output)
        self.carried_out = 0
        self._delivery: Delivery | None = None
        self.diagnostics = Diagnostics(self, 'actuation', self.reporting(self._report))
        self.source = ChainSource(self, self.diagnostics, self._set_chain)
        self._create_subscriptions()
        self.get_logger().info(
            f'{settings.actuator} actuators on {self.source.description}; a nudge is a '
            f'{settings.nudge_as} at the {settings.nudge_edge} edge'
        )

    def deactivate(self) -> None:
        """End all torques, and abandon the commands that are not finished."""
        chain = self.commands.chain
        if chain is not None:
            if chain.driver.busy:
                self.output.drive(chain.named, np.zeros(chain.named.rotors))
            self._set_chain(chain.named)
        self.output.flush()

    def follow_parameters(self) -> None:
        """Apply the parameters of nudges, which can be changed while the node runs."""
        self.commands.settings = self.current(EdgeActuatorParameters)

    def _create_subscriptions(self) -> None:
        commands = self.commands
        for topic, name, take in (
            (interfaces.NUDGE, 'nudge', commands.nudge),
            (interfaces.EDGE_COMMAND, 'edge_command', commands.edge_command),
            (interfaces.JOINT_COMMANDS, 'joint_commands', commands.joint_commands),
            (interfaces.EFFORT_COMMANDS, '~/commands', commands.efforts),
            (interfaces.JOINT_TRAJECTORY, '~/joint_trajectory', commands.trajectory),
        ):
            source = self.resolve_topic_name(name)
            command = self.diagnostics.guarded(source, self._counting(source, take))
            CountedSubscription(self, replace(topic, name=name), command, self.diagnostics)
        self._deliveries = AdaptiveSubscription(self, interfaces.DELIVERY, self._on_delivery)
        take_fresh = self.while_active(self._on_joint_states)
        take_joints = self.diagnostics.guarded('joint_states', take_fresh)
        self._joint_states = StreamSubscription(
            self,
            interfaces.JOINT_STATES,
            take_joints,
            self.diagnostics,
            raw=True,
            on_takeover=self.source.resubscribe,
            parts=self._assembler.parts,
            assemble=self._assembler.add,
        )
        self._busy_until = -math.inf
        self.create_timer(_POLL_INTERVAL, self._poll)

    def _counting(self, source: str, take: Callable[[str, Any], None]) -> Callable[[Any], None]:
        def carry_out(message: Any) -> None:
            self.check_active()
            self._catch_up()
            take(source, message)
            if self.commands.chain is not None:
                self.commands.chain.driver.record.measured = self.output.measured
            self._dispatch_while_busy()
            self.carried_out += 1

        return carry_out

    def _set_chain(self, named: NamedChain) -> None:
        settings, before = self.commands.settings, self.commands.chain
        if before is not None:
            before.driver.abandon()
        self.commands.chain = None
        self._assembler.set_joints(named.joint_names)
        try:
            own, default = self._torque_limits, settings.torque_limit
            joints = joint_actuators(named, settings.joints, lambda name: own.get(name, default))
        except ValueError as error:
            self.diagnostics.reject('chain', error)
            return
        limits = settings.command_timeout, settings.state_timeout
        finish = partial(self.output.report, named)
        driver = ChainDriver(named.chain, self.actuator, *limits, finish)
        self.commands.chain = ActuatedChain(named, joints, driver)
        if self._delivery is not None:
            self._on_delivery(self._delivery)

    def _on_delivery(self, message: Delivery) -> None:
        self._delivery = message
        chain = self.commands.chain
        if chain is not None and len(message.impulse_of_torques) == chain.named.rotors:
            chain.driver.record.deliver(delivery_from_msg(message))

    def _on_joint_states(self, serialized: bytes) -> None:
        self.frames.take(serialized)
        chain = self.commands.chain
        if chain is None or not chain.driver.busy:
            return
        # If frames were skipped, deliveries that precede this frame may still wait.
        for delivery, _ in self._deliveries.waiting():
            self._on_delivery(delivery)
        was_driving = chain.driver.driving
        try:
            frame, stamp = self.frames.read(chain.named)
            before = self.frames.stamp_before
            if before is not None:
                torques = chain.driver.frame(before, stamp, frame.angles)
                if torques is not None:
                    self.output.drive(chain.named, torques)
        except ValueError:
            if was_driving and not chain.driver.driving:
                self.output.drive(chain.named, np.zeros(chain.named.rotors))
            raise

    def _dispatch_while_busy(self) -> None:
        """Let the executor receive each frame immediately, unless the chain is idle."""
        now, chain = time.monotonic(), self.commands.chain
        if chain is not None and chain.driver.busy:
            self._busy_until = now
        self._joint_states.dispatch(now - self._busy_until < _IDLE_AFTER)

    def _catch_up(self) -> None:
        """Receive the frames that have arrived since the last poll, if the chain is idle."""
        if not self._joint_states.dispatched:
            for serialized in self._joint_states.take_waiting():
                if self.active:
                    self.frames.take(serialized)

    def _poll(self) -> None:
        """Receive frames, and compute the zero mode to keep the code of a kick in the caches."""
        self._dispatch_while_busy()
        self._catch_up()
        chain = self.commands.chain
        if chain is not None and self.active and not chain.driver.busy:
            with contextlib.suppress(ValueError):
                frame, _ = self.frames.read(chain.named)
                resolved_edge_mode(chain.named.chain, frame.angles, Edge.NEAREST)

    def _report(self) -> Report:
        chain, subscribers = self.commands.chain, self.output.subscribers
        message = (
            'waiting for the topic chain'
            if self.source.named is None
            else 'waiting for joint_states'
            if self.frames.freshness.stale
            else 'nothing subscribes to rotor_impulses or rotor_torques'
            if not self.output.connected
            else 'driving'
            if chain is not None and chain.driver.driving
            else 'ready'
        )
        values = {
            'commands carried out': self.carried_out,
            'age of joint_states [s]': self.frames.freshness.age,
            'subscribers': subscribers,
        }
        return Report(message, values, warning=message not in ('ready', 'driving'))


def declare_torque_limits(node: Node, settings: EdgeActuatorParameters) -> Mapping[str, float]:
    """Declare a parameter `torque_limits.<joint>` for each of `joints`; return the limits [N m].

    Raises ValueError if a name is invalid or occurs twice.
    """
    own = settings.torque_limit
    fields = [
        (name, float, quantity(own, f'largest torque of {name}', 'N m', 0.0, 1e6))
        for name in settings.joints
    ]
    try:
        limits = make_dataclass('TorqueLimits', fields, frozen=True)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f'parameter joints of {node.get_name()} = {list(settings.joints)} must be names of '
            f'joints, each once: {error}'
        ) from error
    return asdict(declare(node, limits, 'torque_limits.'))
