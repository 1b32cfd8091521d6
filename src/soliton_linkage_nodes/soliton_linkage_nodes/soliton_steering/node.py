# SPDX-License-Identifier: Apache-2.0
"""The steering: carries the soliton to a place on demand and holds it there."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.orbit.uniform_orbit import UniformOrbit
from soliton_linkage.steering.phonon_watch import PhononWatch
from soliton_linkage.steering.steering import Ended, Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages.chain_source import ChainSource
from soliton_linkage_nodes.messages.conversions import (
    Array,
    NamedChain,
    frame_from_msg,
    move_feedback_to_msg,
    move_result_to_msg,
    time_from_msg,
    torques_to_msg,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.parameters import declare, refuse_unknown
from soliton_linkage_nodes.runtime.process import run

_NANOSECONDS = 10**9
_WATCH_PERIOD = 0.02
_FEEDBACK_PERIOD = 0.1
_LAST_WORDS = Duration(seconds=0.5)


@dataclass(frozen=True)
class SolitonSteeringParameters:
    """Parameters of the steering."""

    actuated_joints: tuple[str, ...] = quantity(
        (), 'joints that carry an actuator; empty for all of them'
    )
    torque_limit: float = quantity(0.1, 'largest torque of an actuator', 'N m', 1e-9)
    strain_limit: float = quantity(
        0.1,
        'angle by which springs may give way, where not all joints carry actuators',
        'rad',
        1e-6,
        1.0,
    )
    tolerance: float = quantity(
        0.1, 'distance from its goal at which a soliton has arrived', 'rotor spacings', 1e-3, 1.0
    )
    state_timeout: float = quantity(
        0.5, 'time without joint_states after which a soliton is lost', 's', 1e-2, 60.0
    )


class MoveServer(ActionServer):
    """An action server whose goals end when they are concluded, not when a function returns."""

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Leave a goal that executes to the callbacks of its node."""

    def conclude(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        """Send the result of a goal that has come to a terminal state."""
        super().notify_execute(goal_handle, lambda _: result)


class SolitonSteering(Node):
    """Carries the soliton along the chain, by torques along the instantaneous zero mode.

    Serves the action `move_soliton` and `~/release`. Subscribes to `joint_states` and, unless
    told the chain by parameters, to `chain`. Publishes `rotor_torques` while it moves or holds a
    soliton, and `/diagnostics`. Time is that of the joint states.
    Parameters: those of `SolitonSteeringParameters`, `chain_from`, and `chain.*` of `Chain` [SI].
    """

    def __init__(self, **kwargs: Any) -> None:
        """Connect the topics and open the action."""
        super().__init__('soliton_steering', **kwargs)
        self.settings = declare(self, SolitonSteeringParameters)
        self._named: NamedChain | None = None
        self._steering: Steering | None = None
        self._phonons: PhononWatch | None = None
        self._goal: ServerGoalHandle | None = None
        self._epoch = 0
        self._heard_at = -math.inf
        self._said_at = -math.inf
        self._moves = 0
        self._diagnostics = Diagnostics(self, 'steering', self._report)
        topic = interfaces.ROTOR_TORQUES
        self._torques = self.create_publisher(topic.type, topic.name, topic.qos)
        self._source = ChainSource(self, self._diagnostics, self._on_chain)
        refuse_unknown(self)
        topic = interfaces.JOINT_STATES
        # What has waited in a queue is too old to act on.
        latest = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self.create_subscription(topic.type, topic.name, self._on_joint_states, latest, raw=True)
        self.create_service(Trigger, '~/release', self._on_release)
        self._server = MoveServer(
            self,
            MoveSoliton,
            interfaces.MOVE_SOLITON,
            lambda _: None,
            handle_accepted_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        self._watch = self.create_timer(
            _WATCH_PERIOD, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def destroy_node(self) -> None:
        """Let the soliton go and end the goal, then go."""
        self._let_go('the steering is shut down')
        self._torques.wait_for_all_acked(_LAST_WORDS)
        self._server.destroy()
        super().destroy_node()

    def _on_chain(self, named: NamedChain) -> None:
        """Learn the chain; a chain other than the last ends what was done with that."""
        if named == self._named:
            return
        self._let_go('the chain has been replaced by another')
        self._named, self._steering = None, None
        try:
            rotors = _rotors(named, self.settings.actuated_joints)
            orbit = UniformOrbit(named.chain)
            limits = self.settings.torque_limit, self.settings.strain_limit
            self._steering = Steering(
                orbit, TorqueAllocation(orbit, rotors, *limits), self.settings.tolerance
            )
            self._phonons = PhononWatch(orbit)
            self._named = named
        except (ValueError, ArithmeticError) as error:
            self._diagnostics.refuse('chain', error)

    def _on_joint_states(self, serialized: bytes) -> None:
        if self._steering is None or self._named is None or self._phonons is None:
            return
        message = deserialize_message(serialized, JointState)
        try:
            frame = frame_from_msg(self._named, message)
        except ValueError as error:
            self._diagnostics.refuse('joint_states', error)
            return
        self._heard_at = time.monotonic()
        stamp = time_from_msg(message.header.stamp)
        self._epoch = self._epoch or stamp
        instant = (stamp - self._epoch) / _NANOSECONDS
        held = self._steering.holding
        ended = self._steering.observe(instant, frame.angles)
        if self._steering.estimate is not None:
            self._phonons.update(instant, frame.rates, self._steering.estimate.arc)
        torques = self._steering.torques()
        if held or self._steering.holding:
            self._send(torques)
        if ended is not None:
            if ended.outcome is Outcome.SOLITON_LOST:
                self.get_logger().warning(ended.message)
            self._conclude(ended)
        self._tell()

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        """Begin a move, in place of the one that is under way."""
        handle.execute()
        refused = self._refusal(handle.request)
        if refused is not None:
            self._diagnostics.refuse('move_soliton', refused.message)
            self._end(handle, refused)
            return
        if self._goal is not None:
            place = self._place
            message = (
                f'another goal, rotor {handle.request.rotor:g}, has taken its place when the '
                f'soliton was at rotor {place:.3f}'
            )
            self._conclude(Ended(Outcome.PREEMPTED, message, place))
        self._goal = handle
        self._moves += 1

    def _refusal(self, request: MoveSoliton.Goal) -> Ended | None:
        """Begin the move of a request, or tell why not."""
        if self._steering is None:
            return Ended(
                Outcome.NO_SOLITON,
                'the chain is not known; publish chain or set chain_from to parameters',
                math.nan,
            )
        silent = time.monotonic() - self._heard_at
        if silent > self.settings.state_timeout:
            return Ended(Outcome.NO_SOLITON, f'no fresh joint_states: {_age(silent)}', math.nan)
        if not self._torques.get_subscription_count():
            return Ended(
                Outcome.OUT_OF_REACH,
                'nothing subscribes to rotor_torques; start the simulator first',
                self._place,
            )
        return self._steering.move(request.rotor, request.speed)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._steering is not None and self._goal is handle:
            self._steering.stop()
        return CancelResponse.ACCEPT

    def _on_release(self, _request: Any, response: Any) -> Any:
        held = self._steering is not None and self._steering.holding
        self._let_go('it was released', Outcome.STOPPED)
        response.success = held
        response.message = 'let go' if held else 'no soliton is held'
        return response

    def _on_watch(self) -> None:
        silent = time.monotonic() - self._heard_at
        if silent > self.settings.state_timeout:
            self._let_go(f'joint_states have stopped: {_age(silent)}')

    def _let_go(self, why: str, outcome: Outcome = Outcome.SOLITON_LOST) -> None:
        """Let go of a soliton that is moved or held, and end its move."""
        if self._steering is None or self._named is None or not self._steering.holding:
            return
        place = self._place
        self._steering.release()
        self._send(np.zeros(self._named.rotors))
        where = '' if math.isnan(place) else f', at rotor {place:.3f}'
        message = f'{why}; the soliton is let go{where}'
        self.get_logger().info(message)
        self._conclude(Ended(outcome, message, place))

    def _conclude(self, ended: Ended) -> None:
        """End the goal that is under way, if any."""
        handle, self._goal = self._goal, None
        if handle is not None:
            self._end(handle, ended)

    def _end(self, handle: ServerGoalHandle, ended: Ended) -> None:
        if ended.outcome is Outcome.REACHED:
            handle.succeed()
        elif ended.outcome is Outcome.STOPPED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if self.executor is not None:
            self._server.conclude(handle, move_result_to_msg(ended))

    def _send(self, torques: Array) -> None:
        if self._named is not None:
            now = self.get_clock().now().to_msg()
            self._torques.publish(torques_to_msg(self._named, torques, now))

    def _tell(self) -> None:
        """Publish feedback on the goal that is under way, now and then."""
        now = time.monotonic()
        if self._goal is None or now - self._said_at < _FEEDBACK_PERIOD:
            return
        wall = None if self._steering is None else self._steering.wall
        if wall is not None and self._phonons is not None:
            self._said_at = now
            self._goal.publish_feedback(move_feedback_to_msg(wall, self._phonons.energy))

    @property
    def _place(self) -> float:
        wall = None if self._steering is None else self._steering.wall
        return math.nan if wall is None else wall.place

    def _report(self) -> Report:
        silent = time.monotonic() - self._heard_at > self.settings.state_timeout
        wall = None if self._steering is None or silent else self._steering.wall
        message = (
            'waiting for the topic chain'
            if self._steering is None
            else 'waiting for joint_states'
            if silent
            else 'no soliton'
            if wall is None
            else f'moving the soliton, at rotor {wall.place:.2f}'
            if self._goal is not None
            else f'holding the soliton at rotor {wall.place:.2f}'
            if self._steering.holding
            else 'ready'
        )
        values = {
            'rotor': self._place,
            'phonon energy [J]': math.nan if self._phonons is None else self._phonons.energy,
            'moves begun': self._moves,
            'gentle speed [rotor spacings/s]': (
                math.nan if self._steering is None else self._steering.gentle_speed
            ),
        }
        return Report(message, values, warning=wall is None)


def _rotors(named: NamedChain, joints: tuple[str, ...]) -> tuple[int, ...]:
    """Numbers of the rotors that joints belong to."""
    for joint in joints:
        if joint not in named.joint_names:
            raise ValueError(
                f'actuated_joints names {joint!r}, which is none of {named.joint_names[0]!r} to '
                f'{named.joint_names[-1]!r}; name joints of the chain, or none for all of them'
            )
    return tuple(named.joint_names.index(joint) for joint in joints)


def _age(seconds: float) -> str:
    return 'none has come' if math.isinf(seconds) else f'the last is {seconds:.3g} s old'


def main() -> None:
    """Run the steering until it is told to stop."""
    run(SolitonSteering)
