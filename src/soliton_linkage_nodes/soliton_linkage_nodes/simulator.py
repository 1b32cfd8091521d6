# SPDX-License-Identifier: Apache-2.0
"""The simulator: a chain of rotors in place of a real one."""

from __future__ import annotations

import gc
import sys
import time
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from soliton_linkage.chain import Chain
from soliton_linkage.elastic_simulation import ElasticSimulation
from soliton_linkage.quantities import quantity
from soliton_linkage_msgs.msg import RotorImpulses
from soliton_linkage_msgs.srv import Reset, Step
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
    impulses_from_msg,
    time_to_msg,
    torques_from_msg,
)
from soliton_linkage_nodes.delivery import DeliveryPublisher
from soliton_linkage_nodes.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.joint_state_buffer import JointStateBuffer
from soliton_linkage_nodes.pacing import PacedLoop
from soliton_linkage_nodes.parameters import declare, refuse_unknown
from soliton_linkage_nodes.process import run
from soliton_linkage_nodes.simulation_control import SimulationControl

_LEANS = {'left_leaning': -1, 'right_leaning': 1}
_NANOSECONDS = 10**9
_SWITCH_INTERVAL = 1e-4
_FRAMES_OVERDUE = 3


@dataclass(frozen=True)
class SimulatorParameters:
    """Parameters of the simulator besides those of its chain."""

    publish_rate: float = quantity(500.0, 'rate of joint_states', 'Hz', 1.0, 2000.0)
    tolerance: float = quantity(
        1e-11, 'error allowed in each angle at each step of the solver', 'rad', 1e-13, 1e-2
    )
    initial_state: str = quantity(
        'left_leaning', 'uniform state to start from', choices=tuple(_LEANS)
    )
    command_timeout: float = quantity(
        0.5, 'time after which torques are dropped without a new message, 0 for never', 's', 0.0
    )
    impulse_limit: float = quantity(0.1, 'largest angular impulse accepted', 'N m s', 0.0)
    torque_limit: float = quantity(10.0, 'largest torque accepted', 'N m', 0.0)
    publish_clock: bool = quantity(False, 'whether to publish the simulated time on /clock')


class Simulator(Node):
    """Publishes the angles of a simulated chain at a fixed rate.

    Publishes `joint_states`, `chain` and `delivery` (latched), `/diagnostics` and, if asked to,
    `/clock`.
    Subscribes to `rotor_impulses` and `rotor_torques`. Serves `~/pause`, `~/step`, `~/reset`.
    Parameters: those of `SimulatorParameters`, and `chain.*` of `Chain`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Read the parameters, announce the chain and start the clockwork."""
        super().__init__('simulator', **kwargs)
        self.settings = declare(self, SimulatorParameters)
        chain = declare(self, Chain, 'chain.')
        refuse_unknown(self)
        self._named = NamedChain(chain, default_joint_names(chain.number_of_rotors))
        self._rotors = {name: rotor for rotor, name in enumerate(self._named.joint_names)}
        self.control = SimulationControl(
            chain,
            _LEANS[self.settings.initial_state],
            self.settings.publish_rate,
            self.settings.tolerance,
            self.settings.command_timeout,
            self._publish,
        )
        self._epoch = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        self._diagnostics = Diagnostics(self, 'simulation', self._report)
        self._reported = (time.monotonic(), 0, 0)
        self._said: str | None = None
        self._buffer = JointStateBuffer(self._named)
        self._connect()
        self._loop = PacedLoop(self.settings.publish_rate, self.control.tick)
        self._loop.start()

    @property
    def failure(self) -> Exception | None:
        """What has stopped the clockwork for good."""
        return self._loop.failure

    def destroy_node(self) -> None:
        """Stop publishing, then go."""
        self.control.stop()
        self._loop.stop()
        super().destroy_node()

    def _connect(self) -> None:
        self._joint_states = self.create_publisher(
            JointState, interfaces.JOINT_STATES.name, interfaces.stream_qos(len(self._buffer))
        )
        self._clock_publisher = None
        if self.settings.publish_clock:
            self._clock_publisher = self.create_publisher(
                interfaces.CLOCK.type, interfaces.CLOCK.name, interfaces.CLOCK.qos
            )
        self._chain_publisher = self.create_publisher(
            interfaces.CHAIN.type, interfaces.CHAIN.name, interfaces.CHAIN.qos
        )
        self._chain_publisher.publish(chain_to_msg(self._named, time_to_msg(self._epoch)))
        self._delivery = DeliveryPublisher(self, self._named.rotors, self._epoch)
        for topic, callback in (
            (interfaces.ROTOR_IMPULSES, self._on_impulses),
            (interfaces.ROTOR_TORQUES, self._on_torques),
        ):
            self.create_subscription(topic.type, topic.name, callback, topic.qos)
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_service(Step, '~/step', self._on_step)
        self.create_service(Reset, '~/reset', self._on_reset)

    def _publish(self, frame: int, simulation: ElasticSimulation) -> None:
        stamp = self._epoch + round(frame * _NANOSECONDS / self.settings.publish_rate)
        if self._clock_publisher is not None:
            self._clock_publisher.publish(interfaces.CLOCK.type(clock=time_to_msg(stamp)))
        torques = simulation.chain.spring_torques(simulation.angles)
        self._joint_states.publish(
            self._buffer.write(stamp, simulation.angles, simulation.rates, torques)
        )
        self._delivery.note(stamp, simulation)

    def _on_impulses(self, message: RotorImpulses) -> None:
        try:
            impulses = impulses_from_msg(self._rotors, message, self.settings.impulse_limit)
        except ValueError as error:
            self._diagnostics.refuse('rotor_impulses', error)
            return
        if impulses.any():
            self.control.kick(impulses)

    def _on_torques(self, message: JointState) -> None:
        try:
            torques = torques_from_msg(self._rotors, message, self.settings.torque_limit)
        except ValueError as error:
            self._diagnostics.refuse('rotor_torques', error)
            return
        self.control.hold(torques)

    def _on_pause(self, request: Any, response: Any) -> Any:
        complaint = self.control.pause(bool(request.data))
        return _answer(response, complaint, 'paused' if request.data else 'running')

    def _on_step(self, request: Any, response: Any) -> Any:
        most = self._joint_states.qos_profile.depth
        if 1 <= request.periods <= most:
            complaint = self.control.step(request.periods)
        else:
            complaint = (
                f'periods = {request.periods} must lie in the range 1 to {most}, '
                'the frames that a subscriber can hold'
            )
        reached = self.control.status.frames / self.settings.publish_rate
        return _answer(response, complaint, f'reached t = {reached:g} s')

    def _on_reset(self, request: Any, response: Any) -> Any:
        states = {
            Reset.Request.INITIAL: self.settings.initial_state,
            Reset.Request.LEFT_LEANING: 'left_leaning',
            Reset.Request.RIGHT_LEANING: 'right_leaning',
        }
        if request.state not in states:
            return _answer(response, f'state = {request.state} must be one of 0, 1, 2', '')
        state = states[request.state]
        self.control.reset(_LEANS[state])
        return _answer(response, None, f'at rest, {state.replace("_", "-")}')

    def _report(self) -> Report:
        status = self.control.status
        punctuality = self._loop.punctuality
        now = time.monotonic()
        before, frames_before, missed_before = self._reported
        self._reported = (now, status.frames, punctuality.missed)
        rate = (status.frames - frames_before) / (now - before)
        late = 0 if status.paused else punctuality.missed - missed_before
        overdue = (now - before) * self.settings.publish_rate > _FRAMES_OVERDUE
        slow = not status.paused and not rate and overdue
        message = f'{late} deadlines missed in the last second' if late else 'on time'
        if slow:
            message = 'the next frame takes long to compute'
        if status.paused:
            message = f'paused, {status.failure}' if status.failure else 'paused'
        if status.failure and status.failure != self._said:
            self.get_logger().error(message)
        self._said = status.failure
        return Report(
            message,
            {
                'publish rate [Hz]': rate,
                'real-time factor': rate / self.settings.publish_rate,
                'frames': status.frames,
                'missed deadlines': punctuality.missed,
                'largest lateness [s]': punctuality.largest_lateness,
                'lag [s]': punctuality.lag,
                'energy [J]': status.energy,
                'energy drift': status.energy_drift,
                'motion': self._named.chain.motion.value,
            },
            warning=bool(status.failure or late or slow),
        )


def _answer(response: Any, complaint: str | None, message: str) -> Any:
    response.success = complaint is None
    response.message = complaint or message
    return response


def _finished(simulator: Simulator) -> bool:
    if simulator.failure is not None:
        raise simulator.failure
    return False


def main() -> None:
    """Run the simulator until it is told to stop."""
    # The pacing thread must not wait 5 ms for the interpreter, nor for the garbage of imports.
    sys.setswitchinterval(_SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    run(Simulator, _finished)
