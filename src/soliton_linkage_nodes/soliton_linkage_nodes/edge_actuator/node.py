# SPDX-License-Identifier: Apache-2.0
"""The edge actuator: actuators that drive the chain along its zero mode or joint by joint."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType

from soliton_linkage.actuation.actuators import actuator_type
from soliton_linkage.actuation.chain_driver import ChainDriver
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage_msgs.msg import Delivery
from soliton_linkage_nodes.edge_actuator.commands import ActuatedChain, Commands
from soliton_linkage_nodes.edge_actuator.latest_frames import LatestFrames
from soliton_linkage_nodes.edge_actuator.outlets import ActuatorOutlets
from soliton_linkage_nodes.edge_actuator.parameters import (
    PARAMETERS,
    EdgeActuatorParameters,
    declare_torque_limits,
)
from soliton_linkage_nodes.messages.chain_source import ChainSource, declare_chain_source
from soliton_linkage_nodes.messages.command_conversions import delivery_from_msg, joint_actuators
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.messages.frame_reader import EncoderWatch
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.parameters import current, declare
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.subscriptions import CountedSubscription, StreamSubscription

_LOOK_PERIOD = 0.02
"""Between two looks at the frames of a chain that is left alone [s]: so often that a kick, which
is rehearsed then, stays in the caches, and short beside the usual state_timeout."""
_REST_AFTER = 1.0
"""Time without anything to do after which the chain is left alone [s]: to change costs 1 ms."""


class EdgeActuator(ManagedNode):
    """Turns commands into impulses and torques, and tells what they did.

    Subscribes to `nudge` [rad/s], `edge_command`, `joint_commands`, `~/commands` and
    `~/joint_trajectory` [N m], `joint_states`, `delivery` and, unless told the chain by
    parameters, to `chain`. Publishes `rotor_impulses` [N m s], `rotor_torques` [N m], `last_kick`
    (latched) and `/diagnostics`. Each of `joints` has a parameter `torque_limits.<joint>` [N m],
    and the parameters of the actuator are those of the kind that is chosen.
    """

    PARAMETERS = PARAMETERS

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('edge_actuator', **kwargs)

    def declare_parameters_of_node(self) -> None:
        """Declare what all have, limits of the joints, and what the kind of actuator has."""
        settings = declare(self, EdgeActuatorParameters)
        self._torque_limits = declare_torque_limits(self, settings)
        self.actuator = declare(self, actuator_type(settings.actuator))
        declare_chain_source(self)

    def configure(self) -> None:
        """Connect the topics and learn the chain."""
        settings = current(self, EdgeActuatorParameters)
        encoders = EncoderWatch(self.get_logger().warning)
        self.frames = LatestFrames(settings.state_timeout, encoders.look)
        self.outlets = ActuatorOutlets(self)
        self.commands = Commands(settings, self.actuator, self.frames, self.outlets)
        self.carried_out = 0
        self._delivery: Delivery | None = None
        self.diagnostics = Diagnostics(self, 'actuation', self.reporting(self._report))
        self.source = ChainSource(self, self.diagnostics, self._learn)
        self._listen()
        self.get_logger().info(
            f'{settings.actuator} actuators on {self.source.in_words}; a nudge is a '
            f'{settings.nudge_as} at the {settings.nudge_edge} edge'
        )

    def deactivate(self) -> None:
        """Release the chain: no torque acts, and what was waiting is forgotten."""
        chain = self.commands.chain
        if chain is not None:
            if chain.driver.busy:
                self.outlets.drive(chain.named, np.zeros(chain.named.rotors))
            self._learn(chain.named)
        self.outlets.flush()

    def follow_parameters(self) -> None:
        """Take up how nudges are carried out."""
        self.commands.settings = current(self, EdgeActuatorParameters)

    def _listen(self) -> None:
        commands = self.commands
        for topic, name, take in (
            (interfaces.NUDGE, 'nudge', commands.nudge),
            (interfaces.EDGE_COMMAND, 'edge_command', commands.edge_command),
            (interfaces.JOINT_COMMANDS, 'joint_commands', commands.joint_commands),
            (interfaces.EFFORT_COMMANDS, '~/commands', commands.efforts),
            (interfaces.JOINT_TRAJECTORY, '~/joint_trajectory', commands.trajectory),
        ):
            source = self.resolve_topic_name(name)
            command = self.diagnostics.refusing(source, self._counting(source, take))
            CountedSubscription(self, replace(topic, name=name), command, self.diagnostics)
        interfaces.DELIVERY.subscribe(self, self._on_delivery)
        take_fresh = self.while_active(self._on_joint_states)
        take_joints = self.diagnostics.refusing('joint_states', take_fresh)
        self._joint_states = StreamSubscription(
            self,
            interfaces.JOINT_STATES,
            take_joints,
            self.diagnostics,
            raw=True,
            succeeded=self.source.renew,
        )
        self._busy_until = -math.inf
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_LOOK_PERIOD, self._on_look, clock=steady)

    def _counting(self, source: str, take: Callable[[str, Any], None]) -> Callable[[Any], None]:
        def carry_out(message: Any) -> None:
            self.check_active()
            self._catch_up()
            take(source, message)
            if self.commands.chain is not None:
                self.commands.chain.driver.record.measured = self.outlets.measured
            self._attend()
            self.carried_out += 1

        return carry_out

    def _learn(self, named: NamedChain) -> None:
        settings, before = self.commands.settings, self.commands.chain
        if before is not None:
            before.driver.abandon()
        self.commands.chain = None
        try:
            joints = joint_actuators(
                named,
                settings.joints,
                lambda name: self._torque_limits.get(name, settings.torque_limit),
            )
        except ValueError as error:
            self.diagnostics.refuse('chain', error)
            return
        driver = ChainDriver(
            named.chain,
            self.actuator,
            settings.command_timeout,
            settings.state_timeout,
            lambda kick: self.outlets.tell(named, kick),
        )
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
        if self.commands.chain is not None and self._busy:
            self._drive(self.commands.chain)

    def _drive(self, chain: ActuatedChain) -> None:
        was_driving = chain.driver.driving
        try:
            frame, stamp = self.frames.read(chain.named)
            before = self.frames.stamp_before
            if before is not None:
                torques = chain.driver.frame(before, stamp, frame.angles)
                if torques is not None:
                    self.outlets.drive(chain.named, torques)
        except ValueError:
            if was_driving and not chain.driver.driving:
                self.outlets.drive(chain.named, np.zeros(chain.named.rotors))
            raise

    @property
    def _busy(self) -> bool:
        """Whether each frame matters."""
        chain = self.commands.chain
        return chain is not None and chain.driver.busy

    def _attend(self) -> None:
        """Take each frame as it comes where it matters, and for a while after that."""
        now = time.monotonic()
        if self._busy:
            self._busy_until = now
        self._joint_states.attend(now - self._busy_until < _REST_AFTER)

    def _catch_up(self) -> None:
        """Take the frames that have come while the chain was left alone."""
        if not self._joint_states.attended:
            for serialized in self._joint_states.take_waiting():
                if self.active:
                    self.frames.take(serialized)

    def _on_look(self) -> None:
        """Do now and then what a kick needs: what was not done lately takes twice as long."""
        self._attend()
        self._catch_up()
        chain = self.commands.chain
        if chain is not None and self.active and not self._busy:
            with contextlib.suppress(ValueError):
                frame, _ = self.frames.read(chain.named)
                resolved_edge_mode(chain.named.chain, frame.angles, Edge.NEAREST)

    def _report(self) -> Report:
        chain, subscribers = self.commands.chain, self.outlets.subscribers
        message = (
            'waiting for the topic chain'
            if self.source.named is None
            else 'waiting for joint_states'
            if self.frames.freshness.stale
            else 'nothing subscribes to rotor_impulses or rotor_torques'
            if not self.outlets.heard
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


def main() -> None:
    """Run the actuator until it is told to stop."""
    run(EdgeActuator)
