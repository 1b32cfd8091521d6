# SPDX-License-Identifier: Apache-2.0
"""Move the soliton to a rotor and show the motion.

Use this program instead of `ros2 action send_goal`. It sends a goal of the action move_soliton to
soliton_steering, and ends when the soliton has arrived. If the soliton cannot arrive, the program
ends with exit code 1. Ctrl-C brings the soliton to rest.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.messages.view_conversions import reports_from_msg
from soliton_linkage_nodes.programs import command_line
from soliton_linkage_nodes.programs.watch_soliton import LEGEND, ChainLine
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS
from soliton_linkage_nodes.runtime.process import WaitingNode

_ROTOR = Quantity('destination, counted from rotor 0', 'rotor spacings')
_SPEED = Quantity('largest speed of the move, 0 for automatic', 'rotor spacings/s', minimum=0.0)
"""Largest speed of the move; at 0, soliton_steering chooses the speed."""
_WAIT = Quantity(
    'longest wait for soliton_steering: until it is ready, until it answers, and for feedback',
    's',
    0.0,
    3600.0,
)
"""Longest wait for soliton_steering, at most one hour."""
_LONGEST_WAIT = 5.0
"""Default of `_WAIT` [s]."""
_CANCEL_TIME = 0.3
"""After Ctrl-C, the program waits at most this long for the end of the cancelled move [s]."""


class MoveClient(WaitingNode):
    """Client that sends one goal, shows the progress, and cancels the goal after Ctrl-C."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        super().__init__('move_soliton', stopping, **kwargs)
        self._client = ActionClient(self, MoveSoliton, interfaces.MOVE_SOLITON, **ACTION_QOS)
        self._line = ChainLine(self)
        self._received_at = math.inf
        self._longest_wait = _LONGEST_WAIT
        self._is_ready = False
        interfaces.DIAGNOSTICS.subscribe(self, self._on_diagnostics)

    def move(self, rotor: float, speed: float, wait: float = _LONGEST_WAIT) -> MoveSoliton.Result:
        """Move the soliton to `rotor` [rotor spacings], and return the result of the action.

        `speed` is the largest speed [rotor spacings/s], or 0 for an automatic speed. The method
        waits at most `wait` [s] until soliton_steering is ready, for its answer to the goal, and
        for each feedback. Raises ValueError if soliton_steering is missing or stops. Raises
        KeyboardInterrupt if the move has not ended 0.3 s after Ctrl-C.
        """
        self._longest_wait = wait
        deadline = time.monotonic() + wait
        absent = f'no node offers the action {interfaces.MOVE_SOLITON} after {wait:g} s; '
        self._until(self._client.server_is_ready, f'{absent}start soliton_steering first')
        # Send the goal even if the node is not ready, because it then rejects the goal with a
        # reason.
        self.wait(lambda: self._is_ready, deadline - time.monotonic())
        if self.stopping.is_set():
            raise KeyboardInterrupt
        goal = MoveSoliton.Goal(rotor=rotor, speed=speed)
        sent = self._client.send_goal_async(goal, feedback_callback=self._on_feedback)
        self._until(sent.done, 'soliton_steering did not answer the goal; see its log')
        self._received_at = time.monotonic()
        handle = sent.result()
        ended = handle.get_result_async()
        if not self.wait(lambda: ended.done() or self._loss(), math.inf):
            handle.cancel_goal_async()
            self.wait_uninterrupted(ended.done, _CANCEL_TIME)
        if ended.done():
            result: MoveSoliton.Result = ended.result().result
            self._line.end(result.message)
            return result
        loss = self._loss()
        if self.stopping.is_set():
            self._line.end(f'cancelled; {loss or "soliton_steering brings the soliton to rest"}')
            raise KeyboardInterrupt
        self._line.end('the move was aborted')
        raise ValueError(loss)

    def destroy_node(self) -> None:
        """Destroy the action client and the node."""
        self._client.destroy()
        super().destroy_node()

    def _loss(self) -> str:
        if not self._client.server_is_ready():
            return 'soliton_steering has stopped'
        silence = time.monotonic() - self._received_at
        if silence <= self._longest_wait:
            return ''
        return (
            f'no feedback from soliton_steering for {silence:.0f} s; it has stopped or is blocked'
        )

    def _on_feedback(self, message: Any) -> None:
        self._received_at = time.monotonic()
        on_the_way: MoveSoliton.Feedback = message.feedback
        self._line.show([on_the_way.rotor], progress_of(on_the_way))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        steering = f'{self.get_namespace().rstrip("/")}/soliton_steering'
        for report in reports_from_msg(message):
            if report.node == steering:
                self._is_ready = report.ok

    def _until(self, condition: Callable[[], bool], complaint: str) -> None:
        if not self.wait(condition, self._longest_wait):
            if self.stopping.is_set():
                raise KeyboardInterrupt
            raise ValueError(complaint)


def progress_of(on_the_way: MoveSoliton.Feedback) -> str:
    """Return a text with the position and speed of the soliton, and the phonon energy if known."""
    text = f'rotor {on_the_way.rotor:5.1f}  {on_the_way.speed:+6.2f} rotors/s'
    phonons = on_the_way.phonon_energy
    return f'{text}  {phonons:.1e} J in phonons' if math.isfinite(phonons) else text


def main() -> None:
    """Move the soliton as the command line specifies; exit with 1 if the move fails."""
    parser = PlainParser(
        prog='move_soliton',
        description=__doc__,
        epilog=f'Marks in the picture of the chain: {LEGEND}.',
    )
    command_line.add_quantity(parser, 'rotor', _ROTOR)
    command_line.add_quantity(parser, '--speed', _SPEED, 0.0)
    command_line.add_quantity(parser, '--wait', _WAIT, _LONGEST_WAIT)
    options = command_line.parse_own_arguments(parser)
    with command_line.ros_client('move_soliton', MoveClient) as client:
        result = client.move(options.rotor, options.speed, options.wait)
    sys.exit(result.outcome != MoveSoliton.Result.REACHED)
