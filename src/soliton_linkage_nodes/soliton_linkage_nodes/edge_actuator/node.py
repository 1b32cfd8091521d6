# SPDX-License-Identifier: Apache-2.0
"""The edge actuator: soft actuators that drive the chain along its zero mode or joint by joint."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, make_dataclass, replace
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from soliton_linkage.actuation.edge_drive import EdgeLimits, EdgeOrder, Kind
from soliton_linkage.actuation.pneumatics import PneumaticActuator
from soliton_linkage.dynamics.torque_books import work_of_impulse
from soliton_linkage.linear.rigidity import Edge, resolved_edge_mode
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage_msgs.msg import Delivery, EdgeCommand
from soliton_linkage_nodes.edge_actuator.chain_driver import ChainDriver
from soliton_linkage_nodes.edge_actuator.kick_record import Kick
from soliton_linkage_nodes.messages.chain_source import ChainSource
from soliton_linkage_nodes.messages.command_conversions import (
    delivery_from_msg,
    efforts_from_array,
    efforts_from_msg,
    joint_actuators,
    last_kick_to_msg,
    order_from_msg,
    trajectory_from_msg,
)
from soliton_linkage_nodes.messages.conversions import (
    Array,
    Frame,
    NamedChain,
    frame_from_msg,
    time_from_msg,
    torques_to_msg,
)
from soliton_linkage_nodes.messages.joint_state_buffer import ImpulseBuffer, publish_buffer
from soliton_linkage_nodes.messages.joint_states import JointStateDecoder
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.parameters import current, declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.scheduling import let_others_go

_NANOSECONDS = 10**9
# Half of what the queue of rotor_impulses holds, so that none that is accepted is lost.
_MOST_KICKS_WAITING = 50
_REHEARSED_EVERY = 10


@dataclass(frozen=True)
class EdgeActuatorParameters:
    """Parameters of the actuator besides those of its pneumatics."""

    nudge_edge: str = quantity(
        'nearest',
        'edge that nudges are for; nearest is the one that the zero mode is nearer to',
        choices=tuple(edge.value for edge in Edge),
        adjustable=True,
    )
    nudge_as: str = quantity(
        'kick',
        'what a nudge is: a kick at once, or a pressure of nudge_duration with the same impulse',
        choices=(Kind.KICK.value, Kind.PRESSURE.value),
        adjustable=True,
    )
    nudge_duration: float = quantity(
        0.1, 'how long the pressure of a nudge lasts', 's', 1e-3, 60.0, adjustable=True
    )
    state_timeout: float = quantity(
        0.2, 'age beyond which joint_states are too old to act on', 's', 1e-3, 60.0
    )
    command_timeout: float = quantity(
        0.5,
        'how long torques of joints are held without a new command, and age beyond which '
        'commands are refused, 0 for never',
        's',
        0.0,
    )
    speed_limit: float = quantity(100.0, 'largest speed of a kick', 'rad/s', 0.0)
    torque_limit: float = quantity(
        0.1,
        'largest torque of a pulse along the unit zero mode, and of a joint without a limit of '
        'its own',
        'N m',
        0.0,
    )
    joints: tuple[str, ...] = quantity((), 'joints that carry an actuator; empty for all of them')


class EdgeActuator(Node):
    """Turns commands into impulses and torques, and tells what they did.

    Subscribes to `nudge`, `edge_command`, `joint_commands`, `~/commands`, `~/joint_trajectory`,
    `joint_states`, `delivery` and, unless told the chain by parameters, to `chain`. Publishes
    `rotor_impulses`, `rotor_torques`, `last_kick` (latched) and `/diagnostics`. Parameters:
    those of `EdgeActuatorParameters` and `PneumaticActuator`, `torque_limits.<joint>` [N m] of
    each of `joints`, `chain_from`, and `chain.*` of `Chain` [SI].
    """

    def __init__(self, **kwargs: Any) -> None:
        """Connect the topics."""
        super().__init__('edge_actuator', **kwargs)
        self.settings = declare(self, EdgeActuatorParameters)
        self._limits = EdgeLimits(self.settings.speed_limit, self.settings.torque_limit)
        self._joint_limits = self._declare_joint_limits()
        self._pneumatics = declare(self, PneumaticActuator)
        self._decoder = JointStateDecoder()
        self._previous: bytes | None = None
        self._latest: bytes | None = None
        self._latest_at = -math.inf
        self._frames = 0
        self._driver: ChainDriver | None = None
        self._delivery: Delivery | None = None
        self._carried_out = 0
        self._diagnostics = Diagnostics(self, 'actuation', self._report)
        self._impulses, self._torques, self._last_kick = (
            self.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (
                interfaces.ROTOR_IMPULSES,
                interfaces.ROTOR_TORQUES,
                interfaces.LAST_KICK,
            )
        )
        self._source = ChainSource(self, self._diagnostics, self._learn)
        refuse_unknown(self)
        self._listen()
        self.add_post_set_parameters_callback(lambda _changes: self._follow_parameters())

    def _follow_parameters(self) -> None:
        self.settings = current(self, EdgeActuatorParameters)

    def _declare_joint_limits(self) -> dict[str, float]:
        joints = self.settings.joints
        limit = self.settings.torque_limit
        fields = [
            (name, float, quantity(limit, f'largest torque of {name}', 'N m', 0.0))
            for name in joints
        ]
        try:
            limits = make_dataclass('TorqueLimits', fields, frozen=True)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f'parameter joints of {self.get_name()} = {list(joints)} must be names of '
                f'joints, each once: {error}'
            ) from error
        return asdict(declare(self, limits, 'torque_limits.'))

    def _listen(self) -> None:
        for topic, name, obey in (
            (interfaces.NUDGE, 'nudge', self._obey_nudge),
            (interfaces.EDGE_COMMAND, 'edge_command', self._obey_edge_command),
            (interfaces.JOINT_COMMANDS, 'joint_commands', self._obey_joint_commands),
            (interfaces.EFFORT_COMMANDS, '~/commands', self._obey_efforts),
            (interfaces.JOINT_TRAJECTORY, '~/joint_trajectory', self._obey_trajectory),
        ):
            self.create_subscription(topic.type, name, self._obeying(name, obey), topic.qos)
        topic = interfaces.DELIVERY
        self.create_subscription(topic.type, topic.name, self._on_delivery, topic.qos)
        topic = interfaces.JOINT_STATES
        self.create_subscription(
            topic.type, topic.name, self._on_joint_states, topic.qos, raw=True
        )

    def _obeying(self, name: str, obey: Callable[[str, Any], None]) -> Callable[[Any], None]:
        def on_command(message: Any) -> None:
            try:
                obey(name, message)
            except ValueError as error:
                self._diagnostics.refuse(name, error)
                return
            if self._driver is not None:
                self._driver.record.booked = self._booked
            self._carried_out += 1

        return on_command

    def _learn(self, named: NamedChain) -> None:
        settings = self.settings
        if self._driver is not None:
            self._driver.abandon()
        try:
            actuators = joint_actuators(
                named,
                settings.joints,
                lambda name: self._joint_limits.get(name, settings.torque_limit),
            )
        except ValueError as error:
            self._driver = None
            self._diagnostics.refuse('chain', error)
            return
        self._impulse_buffer = ImpulseBuffer(named)
        self._driver = ChainDriver(
            named,
            actuators,
            self._pneumatics,
            settings.command_timeout,
            settings.state_timeout,
            self._tell,
        )
        if self._delivery is not None:
            self._on_delivery(self._delivery)

    def _tell(self, kick: Kick) -> None:
        if self._driver is not None:
            self._last_kick.publish(last_kick_to_msg(self._driver.named, kick))

    def _on_delivery(self, message: Delivery) -> None:
        self._delivery = message
        driver = self._driver
        if driver is not None and len(message.impulse_of_torques) == driver.named.rotors:
            driver.record.deliver(delivery_from_msg(message))

    def _on_joint_states(self, serialized: bytes) -> None:
        self._previous, self._latest = self._latest, serialized
        self._latest_at = time.monotonic()
        driver = self._driver
        if driver is None or not driver.busy:
            self._rehearse(driver)
            return
        was_driving = driver.driving
        torques: Array | None
        try:
            frame, stamp = self._state(driver.named)
            before = self._stamp_before()
            torques = None if before is None else driver.frame(before, stamp, frame.angles)
        except ValueError as error:
            self._diagnostics.refuse('joint_states', error)
            ended = was_driving and not driver.driving
            torques = np.zeros(driver.named.rotors) if ended else None
        if torques is not None:
            now = self.get_clock().now().to_msg()
            self._torques.publish(torques_to_msg(driver.named, torques, now))

    def _rehearse(self, driver: ChainDriver | None) -> None:
        """Do now and then what a kick needs: what was not done lately takes twice as long."""
        self._frames += 1
        if driver is not None and self._frames % _REHEARSED_EVERY == 0:
            with contextlib.suppress(ValueError):
                frame, _ = self._state(driver.named)
                resolved_edge_mode(driver.named.chain, frame.angles, Edge.NEAREST)

    def _obey_nudge(self, name: str, message: Float64) -> None:
        edge = Edge(self.settings.nudge_edge)
        kick = EdgeOrder(edge, Kind.KICK, message.data)
        if self.settings.nudge_as == Kind.KICK.value:
            self._obey_order(name, kick)
            return
        kick.check(self._limits, self._pneumatics)
        chain = self._ready(self._torques).named.chain
        duration = self.settings.nudge_duration
        impulse = chain.moment_of_inertia * message.data
        pressure = self._pneumatics.pulse_pressure(impulse, duration)
        self._obey_order(name, EdgeOrder(edge, Kind.PRESSURE, pressure, duration))

    def _obey_edge_command(self, name: str, message: EdgeCommand) -> None:
        order = order_from_msg(message)
        self._check_age(message.header.stamp)
        self._obey_order(name, order)

    def _obey_order(self, name: str, order: EdgeOrder) -> None:
        order.check(self._limits, self._pneumatics)
        driver = self._ready(self._impulses if order.instantaneous else self._torques)
        frame, stamp = self._state(driver.named)
        chain, angles = driver.named.chain, frame.angles
        venting = order.kind is Kind.PRESSURE and order.value == 0
        side, mode = resolved_edge_mode(chain, angles, order.edge, anywhere=venting)
        meant = replace(order, edge=side)
        if not order.instantaneous:
            driver.order(name, meant, side)
            return
        if order.kind is Kind.KICK:
            impulses = chain.moments_of_inertia * order.value * mode
        elif (before := self._stamp_before()) is not None and stamp > before:
            impulses = (stamp - before) / _NANOSECONDS * order.value * mode
        else:
            raise ValueError(
                'a pulse without duration lasts for a period of joint_states, which is not '
                'known yet; give a duration'
            )
        self._kick(driver, name, meant, impulses, frame, stamp)

    def _kick(
        self,
        driver: ChainDriver,
        name: str,
        order: EdgeOrder,
        impulses: Array,
        frame: Frame,
        stamp: int,
    ) -> None:
        if driver.record.waiting >= _MOST_KICKS_WAITING:
            raise ValueError(
                f'{driver.record.waiting} kicks wait for the simulator, the limit is '
                f'{_MOST_KICKS_WAITING}; kick less often'
            )
        now = self.get_clock().now().nanoseconds
        publish_buffer(self._impulses, self._impulse_buffer.fill(now, impulses))
        let_others_go()
        rates = np.zeros_like(impulses) if frame.rates is None else frame.rates
        work = work_of_impulse(driver.named.chain, rates, impulses)
        driver.record.booked = self._booked
        driver.record.kicked(stamp, name, order, impulses, work)

    def _obey_joint_commands(self, name: str, message: JointState) -> None:
        driver = self._ready(self._torques)
        rotors, torques = efforts_from_msg(driver.actuators, message)
        self._check_age(message.header.stamp)
        self._check_fresh()
        driver.hold(name, rotors, torques)

    def _obey_efforts(self, name: str, message: Float64MultiArray) -> None:
        driver = self._ready(self._torques)
        rotors, torques = efforts_from_array(driver.actuators, message)
        self._check_fresh()
        driver.hold(name, rotors, torques)

    def _obey_trajectory(self, name: str, message: JointTrajectory) -> None:
        driver = self._ready(self._torques)
        rotors, times, torques = trajectory_from_msg(driver.actuators, message)
        delay = -self._age(message.header.stamp)
        if times[-1] + delay < 0:
            raise ValueError(
                f'~/joint_trajectory was over {-times[-1] - delay:.3g} s ago; send it in time, or '
                'with a stamp of 0, which means now'
            )
        self._check_fresh()
        driver.follow(name, rotors, times, torques, delay)

    def _ready(self, publisher: Any) -> ChainDriver:
        """Return the driver; ValueError where the chain or a listener is missing."""
        if not publisher.get_subscription_count():
            name = publisher.topic_name.rsplit('/', 1)[-1]
            raise ValueError(f'nothing subscribes to {name}; start the simulator first')
        if self._driver is None:
            raise ValueError(
                'the chain is not known yet; publish chain or set chain_from to parameters'
            )
        return self._driver

    @property
    def _booked(self) -> bool:
        return bool(self.count_publishers(interfaces.DELIVERY.name))

    def _age(self, stamp: Time) -> float:
        """How long ago a command was made [s]; 0 for one without a stamp."""
        made = time_from_msg(stamp)
        return (self.get_clock().now().nanoseconds - made) / _NANOSECONDS if made else 0.0

    def _check_age(self, stamp: Time) -> None:
        age, limit = self._age(stamp), self.settings.command_timeout
        if limit and age > limit:
            raise ValueError(
                f'the command is {age:.3g} s old, the limit is {limit:g} s; send it in time, or '
                'raise command_timeout'
            )

    def _check_fresh(self) -> bytes:
        """Return the latest joint states; ValueError where they are too old."""
        age = time.monotonic() - self._latest_at
        if self._latest is None or age > self.settings.state_timeout:
            seen = 'none has come' if self._latest is None else f'the last is {age:.3g} s old'
            raise ValueError(
                f'no fresh joint_states: {seen}, the limit is {self.settings.state_timeout:g} s; '
                'start or resume the simulator, or raise state_timeout'
            )
        return self._latest

    def _state(self, named: NamedChain) -> tuple[Frame, int]:
        """Return a fresh frame and its stamp [ns], or ValueError."""
        joints = self._decoder.decode(self._check_fresh())
        return frame_from_msg(named, joints), joints.stamp

    def _stamp_before(self) -> int | None:
        """Stamp of the frame before the latest [ns]; None where there was none."""
        return None if self._previous is None else self._decoder.stamp(self._previous)

    def _report(self) -> Report:
        age = time.monotonic() - self._latest_at
        driving = self._driver is not None and self._driver.driving
        message = (
            'waiting for the topic chain'
            if self._source.named is None
            else 'waiting for joint_states'
            if age > self.settings.state_timeout
            else 'nothing subscribes to rotor_impulses'
            if not self._impulses.get_subscription_count()
            else 'driving'
            if driving
            else 'ready'
        )
        values = {
            'commands carried out': self._carried_out,
            'age of joint_states [s]': age,
            'subscribers': self._impulses.get_subscription_count(),
        }
        return Report(message, values, warning=message not in ('ready', 'driving'))


def main() -> None:
    """Run the actuator until it is told to stop."""
    run(EdgeActuator, first=True)
