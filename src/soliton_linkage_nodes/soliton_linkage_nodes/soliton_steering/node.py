# SPDX-License-Identifier: Apache-2.0
"""The steering: carries the soliton to a place on demand and holds it there."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.clock import Clock, ClockType
from std_srvs.srv import Trigger

from soliton_linkage.linkage.chain import Array
from soliton_linkage.steering.steering import MoveResult, Outcome
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages.cdr import JointStateDecoder, TorqueBuffer, publish_buffer
from soliton_linkage_nodes.messages.chain_source import ChainSource
from soliton_linkage_nodes.messages.conversions import (
    Frame,
    NamedChain,
    frame_from_msg,
)
from soliton_linkage_nodes.messages.frame_reader import EncoderMonitor
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.diagnostics import Diagnostics, Report
from soliton_linkage_nodes.runtime.managed import ManagedNode
from soliton_linkage_nodes.runtime.parameters import current
from soliton_linkage_nodes.runtime.process import run
from soliton_linkage_nodes.runtime.stamps import Freshness
from soliton_linkage_nodes.runtime.subscriptions import StreamSubscription
from soliton_linkage_nodes.soliton_steering.move_server import MoveServer
from soliton_linkage_nodes.soliton_steering.steered_chain import (
    PARAMETERS,
    SolitonSteeringParameters,
    SteeredChain,
)

_WATCH_PERIOD = 0.02
"""Between two looks at the age of the joint states [s]: short beside the usual state_timeout."""
_REMEMBERED = 200
"""Frames that a move begins from [1]: as many as the observer remembers at 1000 Hz."""
_GLANCED_AT = 8
"""Frames from which it tells where a free wall is [1]: a place takes one, phonons four."""


class SolitonSteering(ManagedNode):
    """Carries the soliton along the chain, by torques along the instantaneous zero mode.

    Serves the action `move_soliton` and `~/release`. Subscribes to `joint_states` and, unless
    told the chain by parameters, to `chain`. Publishes `rotor_torques` [N m] while it moves or
    holds a soliton, and `/diagnostics`. Time is that of the joint states.
    """

    PARAMETERS = PARAMETERS

    def __init__(self, **kwargs: Any) -> None:
        """Be configured and activated, unless a manager is to do that."""
        super().__init__('soliton_steering', **kwargs)

    def configure(self) -> None:
        """Connect the topics, learn the chain and open the action."""
        self.settings = current(self, SolitonSteeringParameters)
        self.chain: SteeredChain | None = None
        self.freshness = Freshness(self.settings.state_timeout)
        self._decoder = JointStateDecoder()
        diagnostics = self.diagnostics = Diagnostics(
            self, 'steering', self.reporting(self._report)
        )
        self.torques = interfaces.ROTOR_TORQUES.publisher(self)
        self._recent: deque[bytes] = deque(maxlen=_REMEMBERED)
        take_chain = diagnostics.guarded('chain', self._on_chain)
        source = ChainSource(self, diagnostics, take_chain)
        self._encoders = EncoderMonitor(self.get_logger().warning)
        self.server = MoveServer(self, self._on_goal, self._on_cancel)
        take_frame = self.while_active(self._on_joint_states)
        self._see, self._remember, self._take = (
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
            # What has waited in a queue is too old to act on.
            latest=True,
        )
        self._joint_states.dispatch(False)
        self.create_service(Trigger, '~/release', self._on_release)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watch = self.create_timer(_WATCH_PERIOD, self._on_watch, clock=steady)
        actuated = len(self.settings.actuated_joints) or 'all'
        self.get_logger().info(
            f'steering the soliton of {source.description} by {actuated} joints'
        )

    @property
    def place(self) -> float:
        """Of the soliton [rotor spacings], NaN where there is none."""
        return math.nan if self.chain is None else self.chain.place

    def deactivate(self) -> None:
        """Let the soliton go and end the goal."""
        self._let_go('the steering is stopped')
        interfaces.wait_for_acknowledgements(self.torques)

    def cleanup(self) -> None:
        """Close the action."""
        self.server.destroy()

    def _on_chain(self, named: NamedChain) -> None:
        """Learn the chain; a chain other than the last ends what was done with that."""
        if self.chain is None or named != self.chain.named:
            self._let_go('the chain has been replaced by another')
            self._recent.clear()
            self.chain = None
            self.chain = SteeredChain(named, self.settings)
            self._buffer = TorqueBuffer(named)

    @property
    def holding(self) -> bool:
        """Whether it moves or holds a soliton, so that each frame matters at once."""
        return self.chain is not None and self.chain.steering.holding

    def _on_joint_states(self, serialized: bytes) -> None:
        if self.chain is None or not self.holding:
            self._remember([serialized])
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
        self.server.tell(self.chain.wall, self.chain.phonon_energy)
        self._joint_states.dispatch(self.holding)

    def _read(self, chain: SteeredChain, serialized: bytes) -> tuple[int, Frame]:
        """Stamp [ns] and frame of joint states; ValueError where they do not show the chain."""
        joints = self._decoder.decode(serialized)
        return joints.stamp, frame_from_msg(chain.named, joints)

    def _keep(self, frames: list[bytes]) -> None:
        """Keep the frames of a free chain for when they are needed, and look at the newest."""
        if not (frames and self.active):
            return
        self._recent.extend(frames)
        if self.chain is not None:
            stamp, frame = self._read(self.chain, frames[-1])
            self._encoders.check(stamp, frame.angles)
            self.freshness.renew()

    def _look(self, frames: int) -> None:
        """See where a free wall is and how fast, from so many frames of late."""
        if self.chain is None or self.holding:
            return
        self._remember(self._joint_states.take_waiting())
        self.chain.begin_anew()
        for serialized in list(self._recent)[-frames:]:
            self._see(self.chain, serialized)

    def _observe_free(self, chain: SteeredChain, serialized: bytes) -> None:
        chain.observe(*self._read(chain, serialized))

    def _on_goal(self, handle: ServerGoalHandle) -> None:
        """Begin a move, in place of the one that is under way."""
        handle.execute()
        self._look(_REMEMBERED)
        refused = self._refusal(handle.request)
        if refused is not None:
            self.diagnostics.reject('move_soliton', refused.message)
            self.server.end(handle, refused)
            return
        place = self.place
        message = (
            f'another goal, rotor {handle.request.rotor:g}, has taken its place when the '
            f'soliton was at rotor {place:.3f}'
        )
        self.server.conclude(MoveResult(Outcome.PREEMPTED, message, place))
        self.server.begin(handle, place)
        self._recent.clear()
        self._joint_states.dispatch(True)

    def _refusal(self, request: MoveSoliton.Goal) -> MoveResult | None:
        """Begin the move of a request, or tell why not."""
        if not self.active:
            return MoveResult(
                Outcome.OUT_OF_REACH, 'the steering is not active; activate it first', math.nan
            )
        if self.chain is None:
            return MoveResult(
                Outcome.NO_SOLITON,
                'the chain is not known; publish chain or set chain_from to parameters',
                math.nan,
            )
        if self.freshness.stale:
            return MoveResult(
                Outcome.NO_SOLITON, f'no fresh joint_states: {self.freshness}', math.nan
            )
        if not self.torques.get_subscription_count():
            return MoveResult(
                Outcome.OUT_OF_REACH,
                'nothing subscribes to rotor_torques; start the simulator first',
                self.place,
            )
        return self.chain.steering.move(request.rotor, request.speed)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self.chain is not None and self.server.goal is handle:
            self.chain.steering.stop()
        return CancelResponse.ACCEPT

    def _on_release(self, _request: Any, response: Any) -> Any:
        response.success = self._let_go('it was released', Outcome.STOPPED)
        response.message = 'let go' if response.success else 'no soliton is held'
        return response

    def _on_watch(self) -> None:
        """Keep the frames of a free wall, or see that those of a held one go on."""
        waiting = self._joint_states.take_waiting()
        if not self.holding:
            self._remember(waiting)
        elif waiting:
            self._take(waiting[-1])
        elif self.freshness.stale:
            self._let_go(f'joint_states have stopped: {self.freshness}')

    def _let_go(self, why: str, outcome: Outcome = Outcome.SOLITON_LOST) -> bool:
        """Let go of a soliton that is moved or held, and end its move; False where none is."""
        if self.chain is None or not self.chain.steering.holding:
            return False
        place = self.place
        self.chain.steering.release()
        self._joint_states.dispatch(False)
        self._send(np.zeros(self.chain.named.rotors))
        where = '' if math.isnan(place) else f', at rotor {place:.3f}'
        message = f'{why}; the soliton is let go{where}'
        self.get_logger().info(message)
        self.server.conclude(MoveResult(outcome, message, place))
        return True

    def _send(self, torques: Array) -> None:
        if self.chain is not None:
            now = self.get_clock().now().nanoseconds
            publish_buffer(self.torques, self._buffer.fill(now, torques))

    def _report(self) -> Report:
        self._look(_GLANCED_AT)
        return report(self.chain, self.freshness.stale, self.server)


def main() -> None:
    """Run the steering until it is told to stop."""
    run(SolitonSteering)


def report(chain: SteeredChain | None, silent: bool, server: MoveServer) -> Report:
    """Report of a chain that may be `silent`, and of the moves of its soliton."""
    goal, ended = server.goal, server.ended
    wall = None if chain is None or silent else chain.wall
    message = (
        'waiting for the topic chain'
        if chain is None
        else 'waiting for joint_states'
        if silent
        else 'no soliton'
        if wall is None
        else f'moving the soliton, at rotor {wall.place:.2f}'
        if goal is not None
        else f'holding the soliton at rotor {wall.place:.2f}'
        if chain.steering.holding
        else 'ready'
    )
    values = {
        'rotor': math.nan if chain is None else chain.place,
        'phonon energy [J]': math.nan if chain is None else chain.phonon_energy,
        'moves begun': server.begun,
        'move from rotor': math.nan if goal is None else server.start,
        'move to rotor': math.nan if goal is None else goal.request.rotor,
        'deviations left out': '' if chain is None else chain.limitation,
        'last move': '' if ended is None else f'{ended.outcome.value}: {ended.message}',
        'gentle speed [rotor spacings/s]': (
            math.nan if chain is None else chain.steering.adiabatic_speed
        ),
    }
    return Report(message, values, warning=wall is None)
