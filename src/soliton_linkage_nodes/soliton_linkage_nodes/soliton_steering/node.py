# SPDX-License-Identifier: Apache-2.0
"""Steering node, which moves the soliton to a requested position and holds it there."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from std_srvs.srv import Trigger

from soliton_linkage.linkage.chain import Array
from soliton_linkage.linkage.deviations import NO_DEVIATIONS
from soliton_linkage.linkage.quantities import quantity
from soliton_linkage.orbit.deviating_orbit import orbit_of
from soliton_linkage.steering.phonon_energy_estimator import PhononEnergyEstimator
from soliton_linkage.steering.settings import SteeringSettings
from soliton_linkage.steering.steering import MoveResult, Outcome, Steering
from soliton_linkage.steering.torque_allocation import TorqueAllocation
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages.cdr import JointStateDecoder, TorqueBuffer, publish_buffer
from soliton_linkage_nodes.messages.chain_source import CHAIN_SOURCE_PARAMETERS, ChainSource
from soliton_linkage_nodes.messages.conversions import Frame, NamedChain, frame_from_msg
from soliton_linkage_nodes.messages.frames import EncoderMonitor, SerializedFrames
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode, ManagedParameters
from soliton_linkage_nodes.runtime.stamps import SECOND, Freshness
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription
from soliton_linkage_nodes.soliton_steering.move_server import MoveServer


@dataclass(frozen=True)
class SolitonSteeringParameters:
    """Parameters of the steering node."""

    actuated_joints: tuple[str, ...] = quantity(
        (), 'joints with an actuator; empty for all joints'
    )
    torque_limit: float = quantity(0.1, 'largest torque of an actuator', 'N m', 1e-9, 1e6)
    strain_limit: float = quantity(
        0.1, 'largest deflection of a rotor, if some joints have no actuator', 'rad', 1e-6, 1.0
    )
    tolerance: float = quantity(
        0.1, 'largest distance from the goal after a successful move', 'rotor spacings', 1e-3, 1.0
    )
    state_timeout: float = quantity(
        0.5, 'time without joint_states after which a soliton is released as lost', 's', 1e-2, 60.0
    )


class SteeredChain:
    """Steering of the soliton in a chain, and estimation of the phonon energy."""

    def __init__(self, named: NamedChain, settings: SolitonSteeringParameters) -> None:
        """Create the steering of a chain; ValueError if the chain cannot be steered."""
        self.named = named
        rotors = _rotors(named, settings.actuated_joints)
        self.limitation = ''
        """Reason why the steering assumes equal rotors and equal springs, or '' if it uses the
        deviations of single rotors and springs from the common values."""
        try:
            orbit = orbit_of(named.chain)
        except (ValueError, ArithmeticError) as error:
            orbit = orbit_of(replace(named.chain, deviations=NO_DEVIATIONS))
            self.limitation = str(error)
        allocation = TorqueAllocation(orbit, rotors, settings.torque_limit, settings.strain_limit)
        self.steering = Steering(orbit, allocation, SteeringSettings(tolerance=settings.tolerance))
        self.phonons = PhononEnergyEstimator(orbit)
        self._epoch: int | None = None

    @property
    def site(self) -> float:
        """Position of the soliton [rotor spacings], NaN if no soliton is detected."""
        return math.nan if self.steering.wall is None else self.steering.wall.site

    def reset(self) -> None:
        """Discard all frames received so far. Call it only while no soliton is moved or held."""
        self.steering.reset()
        self.phonons = PhononEnergyEstimator(self.steering.orbit)

    def observe(self, stamp: int, frame: Frame) -> tuple[Array | None, MoveResult | None]:
        """Process a frame; return the torques to apply and the result of the move.

        `stamp` is the time of the frame [ns]. The torques [N m], shape (N,), are None if no
        soliton is moved or held. The result is None unless the move has ended at this frame.
        """
        if self._epoch is None:
            self._epoch = stamp
        instant = (stamp - self._epoch) / SECOND
        held = self.steering.holding
        ended = self.steering.observe(instant, frame.angles)
        if self.steering.estimate is not None:
            self.phonons.update(instant, frame.rates, self.steering.estimate.arc)
        torques = self.steering.torques()
        return torques if held or self.steering.holding else None, ended


def _rotors(named: NamedChain, joints: tuple[str, ...]) -> tuple[int, ...]:
    for joint in joints:
        if joint not in named.numbers:
            raise ValueError(
                f'actuated_joints names {joint!r}, which is none of {named.joint_names[0]!r} to '
                f'{named.joint_names[-1]!r}; choose from these, or leave it empty for all'
            )
    return tuple(named.numbers[joint] for joint in joints)


_POLL_INTERVAL = 0.02
"""Poll interval for the age of the joint states [s], short compared with `state_timeout`."""
_OBSERVER_FRAMES = 200
"""Before a move, the position and velocity of the soliton are estimated from at most this number
of recent frames [1]. At 1000 Hz, earlier frames would hardly change the estimate."""
_REPORT_FRAMES = 8
"""A report on a free soliton uses this number of recent frames [1]. The position needs one frame.
The phonon energy needs four; it is a mean, which the other frames make more accurate."""


class SolitonSteering(ManagedNode):
    """Node that moves the soliton along the chain by torques along the instantaneous zero mode.

    It serves the action `move_soliton` and the service `~/release`. It subscribes to
    `joint_states` and, unless parameters specify the chain, to `chain`. While it moves or holds a
    soliton, it publishes `rotor_torques` [N m]. It always publishes `/diagnostics`. The control
    loop uses the stamps of the joint states as time.
    """

    PARAMETERS: ClassVar[dict[type, str]] = {
        SolitonSteeringParameters: '',
        ManagedParameters: '',
        **CHAIN_SOURCE_PARAMETERS,
    }

    def configure(self) -> None:
        """Create the topics, the action server and the service."""
        self.settings = self.current(SolitonSteeringParameters)
        self.chain: SteeredChain | None = None
        self.freshness = Freshness(self.settings.state_timeout)
        self._decoder, self._assembler = JointStateDecoder(), SerializedFrames()
        report = self.reporting(self._report)
        diagnostics = self.diagnostics = Diagnostics(self, 'steering', report)
        self.torques = interfaces.ROTOR_TORQUES.publisher(self)
        self._recent: deque[bytes] = deque(maxlen=_OBSERVER_FRAMES)
        take_chain = diagnostics.guarded('chain', self._on_chain)
        source = ChainSource(self, diagnostics, take_chain)
        self._encoders = EncoderMonitor(self.get_logger().warning)
        self.server = MoveServer(self, self._on_goal, self._on_cancel)
        take_frame = self.while_active(self._on_joint_states)
        self._observe, self._keep_frames, self._take = (
            diagnostics.guarded('joint_states', each)
            for each in (self._observe_free, self._keep, take_frame)
        )
        self._joint_states = StreamSubscription(
            self,
            interfaces.JOINT_STATES,
            self._take,
            diagnostics,
            raw=True,
            on_takeover=source.resubscribe,
            # Messages that waited in a queue are too old for feedback control.
            latest=True,
            parts=self._assembler.parts,
            assemble=self._assembler.add,
        )
        self._joint_states.dispatch(False)
        self.create_service(Trigger, '~/release', self._on_release)
        self.create_timer(_POLL_INTERVAL, self._on_watch)
        joints = f'{len(self.settings.actuated_joints) or "all"} joints'
        self.get_logger().info(f'steering the soliton of {source.description} by {joints}')

    @property
    def site(self) -> float:
        """Position of the soliton [rotor spacings], NaN if no soliton is detected."""
        return math.nan if self.chain is None else self.chain.site

    def deactivate(self) -> None:
        """Release the soliton and end the active goal."""
        self._release('the steering is stopped')
        interfaces.wait_for_acknowledgements(self.torques)

    def cleanup(self) -> None:
        """Destroy the action server."""
        self.server.destroy()

    def _on_chain(self, named: NamedChain) -> None:
        if self.chain is None or named != self.chain.named:
            self._release('the chain has changed')
            self._recent.clear()
            self.chain = None
            self.chain = SteeredChain(named, self.settings)
            self._assembler.set_joints(named.joint_names)
            self._buffer = TorqueBuffer(named)

    @property
    def holding(self) -> bool:
        """Whether a soliton is moved or held. The node then needs each frame immediately."""
        return self.chain is not None and self.chain.steering.holding

    def _on_joint_states(self, serialized: bytes) -> None:
        if self.chain is None or not self.holding:
            self._keep_frames([serialized])
            return
        stamp, frame = self._read(self.chain, serialized)
        self._encoders.check(stamp, frame.angles)
        self.freshness.renew()
        torques, ended = self.chain.observe(stamp, frame)
        if torques is not None:
            self._send(torques)
        if ended is not None:
            if ended.outcome is Outcome.SOLITON_LOST:
                self.get_logger().warning(ended.message)
            self.server.conclude(ended)
            self.diagnostics.publish()
        self.server.publish_feedback(self.chain.steering.wall, self.chain.phonons.energy)
        self._joint_states.dispatch(self.holding)

    def _read(self, chain: SteeredChain, serialized: bytes) -> tuple[int, Frame]:
        """Return stamp [ns] and frame of a message; ValueError if they do not fit the chain."""
        joints = self._decoder.decode(serialized)
        return joints.stamp, frame_from_msg(chain.named, joints)

    def _keep(self, frames: list[bytes]) -> None:
        """Store frames for the next move, and check the newest one."""
        if not (frames and self.active):
            return
        self._recent.extend(frames)
        if self.chain is not None:
            stamp, frame = self._read(self.chain, frames[-1])
            self._encoders.check(stamp, frame.angles)
            self.freshness.renew()

    def _observe_recent(self, frames: int) -> None:
        """Estimate position and velocity of a free soliton from the last `frames` frames."""
        if self.chain is None or self.holding:
            return
        self._keep_frames(self._joint_states.take_waiting())
        self.chain.reset()
        for serialized in list(self._recent)[-frames:]:
            self._observe(self.chain, serialized)

    def _observe_free(self, chain: SteeredChain, serialized: bytes) -> None:
        chain.observe(*self._read(chain, serialized))

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        handle.execute()
        self._observe_recent(_OBSERVER_FRAMES)
        rejection = self._start_move(handle.request)
        if rejection is not None:
            self.diagnostics.reject('move_soliton', rejection.message)
            self.server.end(handle, rejection)
            return
        site = self.site
        message = (
            f'another goal, rotor {handle.request.rotor:g}, replaced this one when the soliton '
            f'was at rotor {site:.2f}'
        )
        self.server.conclude(MoveResult(Outcome.PREEMPTED, message, site))
        self.server.begin(handle, site)
        self._recent.clear()
        self._joint_states.dispatch(True)
        self.diagnostics.publish()

    def _start_move(self, request: MoveSoliton.Goal) -> MoveResult | None:
        """Start a requested move; return None, or a result with the reason of a rejection."""
        unreachable, unseen = Outcome.OUT_OF_REACH, Outcome.NO_SOLITON
        if not self.active:
            reason = 'the steering is not active; activate it first'
            return MoveResult(unreachable, reason, math.nan)
        if self.chain is None:
            reason = 'the chain is unknown; publish chain or set chain_from to parameters'
            return MoveResult(unseen, reason, math.nan)
        if self.freshness.stale:
            return MoveResult(unseen, f'no fresh joint_states: {self.freshness}', math.nan)
        if not self.torques.get_subscription_count():
            reason = 'nothing subscribes to rotor_torques; start the simulator first'
            return MoveResult(unreachable, reason, self.site)
        return self.chain.steering.move(request.rotor, request.speed)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self.chain is not None and self.server.goal is handle:
            self.chain.steering.stop()
        return CancelResponse.ACCEPT

    def _on_release(self, _request: Any, response: Any) -> Any:
        response.success = self._release('release was requested', Outcome.STOPPED)
        response.message = 'released' if response.success else 'no soliton is held'
        return response

    def _on_watch(self) -> None:
        """Process waiting frames; release a held soliton if joint states have stopped arriving."""
        waiting = self._joint_states.take_waiting()
        if not self.holding:
            self._keep_frames(waiting)
        elif waiting:
            self._take(waiting[-1])
        elif self.freshness.stale:
            self._release(f'joint_states have stopped: {self.freshness}')

    def _release(self, reason: str, outcome: Outcome = Outcome.SOLITON_LOST) -> bool:
        """Release the soliton and end its move; return False if no soliton is moved or held."""
        if self.chain is None or not self.chain.steering.holding:
            return False
        site = self.site
        self.chain.steering.release()
        self._joint_states.dispatch(False)
        self._send(np.zeros(self.chain.named.rotors))
        where = '' if math.isnan(site) else f', at rotor {site:.2f}'
        message = f'{reason}; the soliton is released{where}'
        self.get_logger().info(message)
        self.server.conclude(MoveResult(outcome, message, site))
        self.diagnostics.publish()
        return True

    def _send(self, torques: Array) -> None:
        if self.chain is not None:
            now = self.get_clock().now().nanoseconds
            publish_buffer(self.torques, self._buffer.fill(now, torques))

    def _report(self) -> Report:
        self._observe_recent(_REPORT_FRAMES)
        return report(self.chain, self.freshness.stale, self.server)


def report(chain: SteeredChain | None, silent: bool, server: MoveServer) -> Report:
    """Return the report about a chain and the moves of its soliton.

    `silent` means that joint states have stopped arriving.
    """
    goal, ended = server.goal, server.ended
    wall = None if chain is None or silent else chain.steering.wall
    message = (
        'waiting for the topic chain'
        if chain is None
        else 'waiting for joint_states'
        if silent
        else 'waiting for exactly one soliton'
        if wall is None
        else f'moving the soliton, at rotor {wall.site:.2f}'
        if goal is not None
        else f'holding the soliton at rotor {wall.site:.2f}'
        if chain.steering.holding
        else 'ready'
    )
    values = {
        'rotor': math.nan if chain is None else chain.site,
        'phonon energy [J]': math.nan if chain is None else chain.phonons.energy,
        'moves begun': server.begun,
        'move from rotor': math.nan if goal is None else server.start,
        'move to rotor': math.nan if goal is None else goal.request.rotor,
        'deviations left out': '' if chain is None else chain.limitation,
        'holding': chain is not None and chain.steering.holding,
        'last move': '' if ended is None else f'{ended.outcome.value}: {ended.message}',
        'gentle speed [rotor spacings/s]': chain.steering.adiabatic_speed if chain else math.nan,
    }
    return Report(message, values, warning=chain is None or silent)
