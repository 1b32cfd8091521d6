# SPDX-License-Identifier: Apache-2.0
"""The action move_soliton, of which one goal at a time is under way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle

from soliton_linkage.steering.steering import MoveResult, Outcome, WallState
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS, GuardedNode

_FEEDBACK_PERIOD = 0.1
"""Shortest time between two messages of feedback [s], which a person reads."""


class MoveServer(ActionServer):
    """An action server whose goals end when they are concluded, not when a function returns."""

    def __init__(
        self,
        node: GuardedNode,
        take: Callable[[ServerGoalHandle], None],
        cancel: Callable[[ServerGoalHandle], CancelResponse],
    ) -> None:
        """Serve; `take` is called with each goal, `cancel` with each that is to be cancelled."""
        super().__init__(
            node,
            MoveSoliton,
            interfaces.MOVE_SOLITON,
            lambda _: None,
            handle_accepted_callback=self._take,
            cancel_callback=cancel,
            **ACTION_QOS,
        )
        self._begin_or_refuse = take
        self.goal: ServerGoalHandle | None = None
        """The goal that is under way."""
        self.begun = 0
        """How many goals were."""
        self.start = math.nan
        """Where the soliton was when the last began [rotor spacings]."""
        self.ended: MoveResult | None = None
        """How the last ended that was under way."""
        self._of = node
        self._told_at = -math.inf

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Leave a goal that executes to the callbacks of its node."""

    def _take(self, handle: ServerGoalHandle) -> None:
        try:
            self._begin_or_refuse(handle)
        except MemoryError:
            raise
        except Exception as error:
            failure = self._of.fail('begin a move', error)
            self.end(handle, MoveResult(Outcome.NOT_HELD, failure, math.nan))

    def begin(self, handle: ServerGoalHandle, place: float) -> None:
        """Have a goal under way, from a place on [rotor spacings]."""
        self.goal, self.start = handle, place
        self.begun += 1

    def tell(self, wall: WallState | None, phonon_energy: float) -> None:
        """Publish feedback on the goal that is under way, now and then."""
        now = time.monotonic()
        if self.goal is not None and wall is not None and now - self._told_at >= _FEEDBACK_PERIOD:
            self._told_at = now
            self.goal.publish_feedback(move_feedback_to_msg(wall, phonon_energy))

    def conclude(self, ended: MoveResult) -> None:
        """End the goal that is under way, if any."""
        handle, self.goal = self.goal, None
        if handle is not None:
            self.ended = ended
            self.end(handle, ended)

    def end(self, handle: ServerGoalHandle, ended: MoveResult) -> None:
        """Bring a goal to its terminal state and send its result."""
        if ended.outcome is Outcome.REACHED:
            handle.succeed()
        elif ended.outcome is Outcome.STOPPED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if self._of.executor is not None:
            super().notify_execute(handle, lambda _: move_result_to_msg(ended))


_OUTCOMES = {
    outcome: getattr(MoveSoliton.Result, outcome.name)
    for outcome in Outcome
    if outcome is not Outcome.STOPPED
} | {Outcome.STOPPED: MoveSoliton.Result.CANCELLED}


def move_result_to_msg(ended: MoveResult) -> MoveSoliton.Result:
    """How a move of the soliton ended, as the result of the action."""
    return MoveSoliton.Result(
        outcome=_OUTCOMES[ended.outcome], message=ended.message, rotor=ended.place
    )


def move_feedback_to_msg(wall: WallState, phonon_energy: float) -> MoveSoliton.Feedback:
    """Where the soliton is on its way, with the energy of the phonons [J]."""
    return MoveSoliton.Feedback(rotor=wall.place, speed=wall.speed, phonon_energy=phonon_energy)
