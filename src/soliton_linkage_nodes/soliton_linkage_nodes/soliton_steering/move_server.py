# SPDX-License-Identifier: Apache-2.0
"""Server of the action move_soliton, with at most one active goal."""

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
"""Shortest time between two feedback messages [s], short enough for a display."""


class MoveServer(ActionServer):
    """Action server of move_soliton.

    A goal ends when the node calls `conclude` or `end`. By contrast, the base class of rclpy ends
    a goal when its execute callback returns.
    """

    def __init__(
        self,
        node: GuardedNode,
        take: Callable[[ServerGoalHandle], None],
        cancel: Callable[[ServerGoalHandle], CancelResponse],
    ) -> None:
        """Create the server.

        The server calls `take` with each accepted goal, and `cancel` with each goal that a client
        cancels.
        """
        name, calls = interfaces.MOVE_SOLITON, {'handle_accepted_callback': self._take}
        super().__init__(
            node, MoveSoliton, name, lambda _: None, cancel_callback=cancel, **calls, **ACTION_QOS
        )
        self._on_goal = take
        self.goal: ServerGoalHandle | None = None
        self.begun = 0
        self.start = math.nan
        """Position of the soliton when the last goal became active [rotor spacings]."""
        self.ended: MoveResult | None = None
        """Result of the last active goal that has ended, or None."""
        self._node_of_server = node
        self._feedback_time = -math.inf

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Any) -> None:
        """Do nothing, because other callbacks of the node execute the goal."""

    def _take(self, handle: ServerGoalHandle) -> None:
        try:
            self._on_goal(handle)
        except MemoryError:
            raise
        except Exception as error:
            failure = self._node_of_server.fail('start a move', error)
            self.end(handle, MoveResult(Outcome.NOT_HELD, failure, math.nan))

    def begin(self, handle: ServerGoalHandle, position: float) -> None:
        """Make a goal active. The soliton is now at `position` [rotor spacings]."""
        self.goal, self.start = handle, position
        self.begun += 1

    def publish_feedback(self, wall: WallState | None, phonon_energy: float) -> None:
        """Publish the state of the soliton and the phonon energy [J], at most every 0.1 s."""
        now = time.monotonic()
        due = now - self._feedback_time >= _FEEDBACK_PERIOD
        if due and self.goal is not None and wall is not None:
            self._feedback_time = now
            feedback = MoveSoliton.Feedback(rotor=wall.site, speed=wall.speed)
            feedback.phonon_energy = phonon_energy
            self.goal.publish_feedback(feedback)

    def conclude(self, ended: MoveResult) -> None:
        """End the active goal, if there is one, with the result `ended`."""
        handle, self.goal = self.goal, None
        if handle is not None:
            self.ended = ended
            self.end(handle, ended)

    def end(self, handle: ServerGoalHandle, ended: MoveResult) -> None:
        """End a goal with the result `ended`, and send the result to the client."""
        if ended.outcome is Outcome.REACHED:
            handle.succeed()
        elif ended.outcome is Outcome.STOPPED and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        if self._node_of_server.executor is not None:
            kind, stopped = MoveSoliton.Result, ended.outcome is Outcome.STOPPED
            code = getattr(kind, 'CANCELLED' if stopped else ended.outcome.name)
            result = kind(outcome=code, message=ended.message, rotor=ended.site)
            super().notify_execute(handle, lambda _: result)
