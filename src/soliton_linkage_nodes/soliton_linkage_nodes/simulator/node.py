# SPDX-License-Identifier: Apache-2.0
"""The simulator: a chain of rotors in place of a real one."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from soliton_linkage.dynamics.simulation import Simulation
from soliton_linkage.linkage.encoders import EncoderErrors
from soliton_linkage.linkage.gravity import Gravity
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.solitons.passage import find_obstacles
from soliton_linkage_nodes.messages.chain_source import declare_chain
from soliton_linkage_nodes.messages.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
    time_to_msg,
    torques_from_msg,
)
from soliton_linkage_nodes.messages.impulse_decoder import ImpulseDecoder
from soliton_linkage_nodes.messages.joint_state_buffer import publish_buffer
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.pacing import PacedLoop
from soliton_linkage_nodes.runtime.parameters import current, declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.scheduling import let_others_go
from soliton_linkage_nodes.simulator.control import SimulationControl
from soliton_linkage_nodes.simulator.delivery import DeliveryPublisher
from soliton_linkage_nodes.simulator.report import SimulationReport
from soliton_linkage_nodes.simulator.sensed_joints import SensedJoints
from soliton_linkage_nodes.simulator.services import SimulationServices
from soliton_linkage_nodes.simulator.standard_services import serve_standard
from soliton_linkage_nodes.simulator.world import World, WorldParameters, rotors_of

_NANOSECONDS = 10**9
_SWITCH_INTERVAL = 1e-4
_SLOWEST = 1e-6
_POLL_INTERVAL = 0.02


@dataclass(frozen=True)
class SimulatorParameters(WorldParameters):
    """Parameters of the simulator besides those of chain, gravity and sensors."""

    publish_rate: float = quantity(
        500.0, 'rate of joint_states in simulated time', 'Hz', 1.0, 10_000.0
    )
    real_time_factor: float = quantity(
        1.0,
        'simulated time over that of the clock, 0 for as fast as possible',
        '',
        0.0,
        1000.0,
        adjustable=True,
    )
    missing_joints: tuple[str, ...] = quantity(
        (), 'joints left out of joint_states, by name or number; empty for none'
    )
    command_timeout: float = quantity(
        0.5, 'time after which torques are dropped without a new message, 0 for never', 's', 0.0
    )
    impulse_limit: float = quantity(0.1, 'largest angular impulse accepted', 'N m s', 0.0)
    torque_limit: float = quantity(10.0, 'largest torque accepted', 'N m', 0.0)
    publish_clock: bool = quantity(False, 'whether to publish the simulated time on /clock')
    subscribers: int = quantity(
        0, 'number of subscribers of joint_states to wait for before time begins', '', 0, 1000
    )


class Simulator(Node):
    """Publishes the angles of a simulated chain at a fixed rate.

    Publishes `joint_states`, `chain` and `delivery` (latched), `/diagnostics` and, if asked to,
    `/clock`.
    Subscribes to `rotor_impulses`, `rotor_torques` and `tilt` [rad], which sets the parameter
    `gravity.tilt`. Serves `~/pause`, `~/step`, `~/reset`, and what `standard_services` lists.
    Parameters: those of `SimulatorParameters`, `chain.*` of `declare_chain`, `gravity.*` of
    `Gravity` and `sensors.*` of `EncoderErrors`. A change of one acts at the instant of a frame.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Read the parameters, announce the chain and start the clockwork."""
        super().__init__('simulator', **kwargs)
        settings = self.settings = declare(self, SimulatorParameters)
        chain = declare_chain(self)
        gravity = declare(self, Gravity, 'gravity.')
        errors = declare(self, EncoderErrors, 'sensors.')
        refuse_unknown(self)
        names = default_joint_names(chain.number_of_rotors)
        self._named = NamedChain(chain, names)
        self._rotors = {name: rotor for rotor, name in enumerate(names)}
        self._impulses = ImpulseDecoder(self._rotors, settings.impulse_limit)
        period = 1 / settings.publish_rate
        missing = rotors_of('missing_joints', settings.missing_joints, names)
        self._joints = SensedJoints(self._named, period, errors, missing)
        world = World(self._named, settings, period)
        self.control = SimulationControl(
            world.begin, world.initial_state(), gravity, settings.command_timeout, self._publish
        )
        self._epoch = 0
        self._loop = PacedLoop(self._pace(settings.real_time_factor), self.control.tick)
        self._figures = SimulationReport(
            self.control, self._loop, settings.publish_rate, self.get_logger().error
        )
        self._diagnostics = Diagnostics(self, 'simulation', self._report)
        self._obstacles = find_obstacles(chain)
        self._connect()
        depth = self._joint_states.qos_profile.depth
        services = SimulationServices(self, self._named, world, self.control, period, depth)
        serve_standard(self, services)
        self._warn_of_obstacles()
        self.add_post_set_parameters_callback(lambda _changes: self._follow_parameters())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._beginning = self.create_timer(_POLL_INTERVAL, self._begin, clock=steady)
        self._begin()

    @property
    def failure(self) -> Exception | None:
        """What has stopped the clockwork for good."""
        return self._loop.failure

    def destroy_node(self) -> None:
        """Stop publishing, then go."""
        self.control.stop()
        self._loop.stop()
        super().destroy_node()

    def _begin(self) -> None:
        """Let time begin once there are as many subscribers as asked for."""
        if self._joint_states.get_subscription_count() < self.settings.subscribers:
            return
        self._beginning.cancel()
        self._epoch = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._chain_publisher.publish(chain_to_msg(self._named, time_to_msg(self._epoch)))
        self._delivery = DeliveryPublisher(self, self._named.rotors, self._epoch)
        self._loop.start()

    def _connect(self) -> None:
        self._joint_states = self.create_publisher(
            JointState, interfaces.JOINT_STATES.name, interfaces.stream_qos(len(self._joints))
        )
        self._clock_publisher = None
        if self.settings.publish_clock:
            self._clock_publisher = self.create_publisher(
                interfaces.CLOCK.type, interfaces.CLOCK.name, interfaces.CLOCK.qos
            )
        self._chain_publisher = self.create_publisher(
            interfaces.CHAIN.type, interfaces.CHAIN.name, interfaces.CHAIN.qos
        )
        topic = interfaces.ROTOR_IMPULSES
        self.create_subscription(topic.type, topic.name, self._on_impulses, topic.qos, raw=True)
        for topic, callback in (
            (interfaces.ROTOR_TORQUES, self._on_torques),
            (interfaces.TILT, self._on_tilt),
        ):
            self.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _publish(self, frame: int, simulation: Simulation) -> None:
        stamp = self._epoch + round(frame * _NANOSECONDS / self.settings.publish_rate)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
        publish_buffer(self._joint_states, self._joints.fill(stamp, frame, simulation))
        let_others_go()
        self._delivery.note(stamp, simulation)

    def _on_impulses(self, serialized: bytes) -> None:
        try:
            impulses = self._impulses.decode(serialized)
        except ValueError as error:
            self._diagnostics.refuse('rotor_impulses', error)
            return
        complaint = self.control.kick(impulses) if impulses.any() else None
        if complaint:
            self._diagnostics.refuse('rotor_impulses', complaint)

    def _on_torques(self, message: JointState) -> None:
        try:
            torques = torques_from_msg(self._rotors, message, self.settings.torque_limit)
        except ValueError as error:
            self._diagnostics.refuse('rotor_torques', error)
            return
        self.control.hold(torques)

    def _on_tilt(self, message: Float64) -> None:
        (result,) = self.set_parameters([Parameter('gravity.tilt', value=message.data)])
        if not result.successful:
            self._diagnostics.refuse('tilt', result.reason)
        elif not self.get_parameter('gravity.acceleration').value:
            self.get_logger().warning(
                'tilt does nothing without gravity; set gravity.acceleration', once=True
            )

    def _follow_parameters(self) -> None:
        self.control.turn_gravity(current(self, Gravity, 'gravity.'))
        self._joints.change(current(self, EncoderErrors, 'sensors.'))
        self._loop.rate = self._pace(self.get_parameter('real_time_factor').value)

    def _pace(self, real_time_factor: float) -> float:
        """Rate of frames on the clock [Hz]; without a limit where the factor is 0."""
        if real_time_factor == 0:
            return math.inf
        return max(real_time_factor, _SLOWEST) * self.settings.publish_rate

    def _warn_of_obstacles(self) -> None:
        if self._obstacles:
            first = self._obstacles[0]
            self.get_logger().warning(
                f'{len(self._obstacles)} bonds may stop a wall, first bond {first.bond} between '
                f'rotors {first.bond} and {first.bond + 1}: its spring of {first.rest_length:.6g} '
                f'm {first.reason}; lower the deviations of the chain'
            )

    def _report(self) -> Report:
        if not self._beginning.is_canceled():
            heard, wanted = self._joint_states.get_subscription_count(), self.settings.subscribers
            return Report(
                f'waiting for {wanted} subscribers of joint_states, there are {heard}',
                warning=True,
            )
        gravity = current(self, Gravity, 'gravity.')
        return self._figures(
            {
                'motion': self._named.chain.motion.value,
                'bonds that may stop a wall': len(self._obstacles),
                'gravity [m/s^2]': gravity.acceleration,
                'tilt [rad]': gravity.tilt,
            }
        )


def _finished(simulator: Simulator) -> bool:
    if simulator.failure is not None:
        raise simulator.failure
    return False


def main() -> None:
    """Run the simulator until it is told to stop."""
    # The pacing thread must not wait 5 ms for the interpreter.
    sys.setswitchinterval(_SWITCH_INTERVAL)
    run(Simulator, _finished, first=True)
