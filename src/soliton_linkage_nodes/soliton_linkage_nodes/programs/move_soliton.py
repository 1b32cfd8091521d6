# SPDX-License-Identifier: Apache-2.0
"""One move of the soliton, shown on its way; for shells without `ros2 action` as well.

It asks soliton_steering by the action move_soliton, and ends when the soliton is there, or with
exit code 1 when it cannot come there. Ctrl-C stops the soliton where it is.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient

from soliton_linkage.command_line import PlainParser
from soliton_linkage.linkage.quantities import Quantity
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.programs.chain_line import LEGEND, ChainLine
from soliton_linkage_nodes.programs.command_line import (
    exit_on_failure,
    number,
    parse_own_arguments,
)
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.guarded import ACTION_QOS
from soliton_linkage_nodes.runtime.process import WaitingNode, initialise, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_ROTOR = Quantity('where to, from rotor 0', 'rotor spacings')
_SPEED = Quantity('largest speed on the way', 'rotor spacings/s', minimum=0.0)
"""Its direction is that of the way; 0 leaves it to the steering."""
_LONGEST_WAIT = 5.0
"""For a steering that runs to be found and to take a goal, with room for a busy machine [s]."""
_LONGEST_SILENCE = 3.0
"""Of a steering that has a goal and is alive [s]: it speaks ten times a second."""
_LAST_WORDS = 0.3
"""For a move that is cancelled to end, before that is left to the steering [s]: nobody who
pressed Ctrl-C waits longer."""


class MoveClient(WaitingNode):
    """Sends one goal, shows the way, and cancels it when it is interrupted."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        """Connect to the action; `stopping` is set to interrupt."""
        super().__init__('move_soliton', stopping, **kwargs)
        self._client = ActionClient(self, MoveSoliton, interfaces.MOVE_SOLITON, **ACTION_QOS)
        self._line = ChainLine(self)
        self._heard_at = math.inf

    def move(self, rotor: float, speed: float) -> MoveSoliton.Result:
        """Return how it ended.

        Raises ValueError where nobody serves the action or no longer does, and KeyboardInterrupt
        where it is interrupted and does not end soon.
        """
        self._until(
            self._client.server_is_ready,
            f'nothing serves {interfaces.MOVE_SOLITON} after {_LONGEST_WAIT:g} s; '
            'start soliton_steering first',
        )
        goal = MoveSoliton.Goal(rotor=rotor, speed=speed)
        sent = self._client.send_goal_async(goal, feedback_callback=self._on_feedback)
        self._until(sent.done, 'soliton_steering does not take the goal; see its log')
        self._heard_at = time.monotonic()
        handle = sent.result()
        ended = handle.get_result_async()
        if not self.wait(lambda: ended.done() or self._loss(), math.inf):
            handle.cancel_goal_async()
            self.wait_uninterrupted(ended.done, _LAST_WORDS)
        if ended.done():
            result: MoveSoliton.Result = ended.result().result
            self._line.end(result.message)
            return result
        loss = self._loss()
        if self.stopping.is_set():
            self._line.end(f'cancelled; {loss or "soliton_steering brings the soliton to rest"}')
            raise KeyboardInterrupt
        self._line.end('the move is given up')
        raise ValueError(loss)

    def destroy_node(self) -> None:
        """Leave the graph, and the action."""
        self._client.destroy()
        super().destroy_node()

    def _loss(self) -> str:
        """What is wrong with a steering that is gone."""
        if not self._client.server_is_ready():
            return 'soliton_steering is gone'
        silence = time.monotonic() - self._heard_at
        if silence < _LONGEST_SILENCE:
            return ''
        return f'soliton_steering has said nothing for {silence:.0f} s, it is gone or stuck'

    def _on_feedback(self, message: Any) -> None:
        self._heard_at = time.monotonic()
        on_the_way: MoveSoliton.Feedback = message.feedback
        self._line.show([on_the_way.rotor], progress_of(on_the_way))

    def _until(self, condition: Callable[[], bool], complaint: str) -> None:
        if not self.wait(condition, _LONGEST_WAIT):
            if self.stopping.is_set():
                raise KeyboardInterrupt
            raise ValueError(complaint)


def progress_of(on_the_way: MoveSoliton.Feedback) -> str:
    """Where the wall is, and what runs in phonons where rates tell that."""
    said = f'rotor {on_the_way.rotor:5.1f}  {on_the_way.speed:+6.2f} rotors/s'
    phonons = on_the_way.phonon_energy
    return f'{said}  {phonons:.1e} J in phonons' if math.isfinite(phonons) else said


def main() -> None:
    """Carry the soliton where the command line says."""
    options = parse_own_arguments(_parser())
    stopping = stop_on_signals()
    try:
        with exit_on_failure('move_soliton'):
            initialise()
            result = MoveClient(stopping).move(options.rotor, options.speed)
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(INTERRUPTED)
    sys.exit(result.outcome != MoveSoliton.Result.REACHED)


def _parser() -> PlainParser:
    parser = PlainParser(
        prog='move_soliton', description=__doc__, epilog=f'In the picture of the chain {LEGEND}.'
    )
    parser.add_argument('rotor', type=number(_ROTOR), help=f'{_ROTOR.description} [{_ROTOR.unit}]')
    parser.add_argument(
        '--speed',
        type=number(_SPEED),
        default=0.0,
        help=f'{_SPEED.description}, 0 to leave it to the steering [{_SPEED.unit}] (%(default)g)',
    )
    return parser
