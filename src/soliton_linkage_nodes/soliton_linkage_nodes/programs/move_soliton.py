# SPDX-License-Identifier: Apache-2.0
"""One move of the soliton from the command line, for machines without `ros2 action`."""

from __future__ import annotations

import argparse
import math
import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from soliton_linkage.progress import ProgressLine
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_msgs.msg import Chain
from soliton_linkage_nodes.programs.spinning import spin_until
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.process import initialise, stop_on_signals
from soliton_linkage_nodes.start import INTERRUPTED

_LONGEST_WAIT = 5.0
"""For a steering that runs to be found, with room for a busy machine [s]."""


class Mover(Node):
    """Sends one goal, shows the way, and cancels it when it is interrupted."""

    def __init__(self, stopping: threading.Event, **kwargs: Any) -> None:
        """Connect to the action; `stopping` is set to interrupt."""
        super().__init__('move_soliton', **kwargs)
        self._stopping = stopping
        self._client = ActionClient(self, MoveSoliton, interfaces.MOVE_SOLITON)
        self._line = ProgressLine('rotor', 0, bar_of_place=True)
        topic = interfaces.CHAIN
        self.create_subscription(topic.type, topic.name, self._on_chain, topic.qos)
        self._spinning = EventsExecutor(context=self.context)
        self._spinning.add_node(self)

    def move(self, rotor: float, speed: float) -> MoveSoliton.Result | None:
        """Return how it ended, None where it was interrupted before it began.

        Raises ValueError where nobody serves the action.
        """
        if not self._wait(self._client.server_is_ready, _LONGEST_WAIT):
            if self._stopping.is_set():
                return None
            raise ValueError(
                f'nothing serves {interfaces.MOVE_SOLITON} after {_LONGEST_WAIT:g} s; '
                'start soliton_steering first'
            )
        goal = MoveSoliton.Goal(rotor=rotor, speed=speed)
        sent = self._client.send_goal_async(goal, feedback_callback=self._on_feedback)
        self._finish(sent.done)
        handle = sent.result()
        ended = handle.get_result_async()
        if not self._wait(ended.done):
            handle.cancel_goal_async()
            self._finish(ended.done)
        result: MoveSoliton.Result = ended.result().result
        self._line.end(result.message)
        return result

    def _on_chain(self, message: Chain) -> None:
        self._line.total = len(message.joint_names) - 1

    def _on_feedback(self, message: Any) -> None:
        on_the_way: MoveSoliton.Feedback = message.feedback
        self._line.show(
            on_the_way.rotor,
            f'{on_the_way.rotor:5.1f}  {on_the_way.speed:+6.2f} rotors/s  '
            f'{on_the_way.phonon_energy:.1e} J in phonons',
        )

    def _wait(self, condition: Callable[[], bool], seconds: float = math.inf) -> bool:
        """Spin until a condition holds; False where it is too late or interrupted."""
        return spin_until(self._spinning, condition, seconds, self._stopping.is_set)

    def _finish(self, condition: Callable[[], bool]) -> None:
        """Spin until a condition holds, which it does soon even where interrupted."""
        if not spin_until(self._spinning, condition, 2 * _LONGEST_WAIT):
            raise ValueError(f'{interfaces.MOVE_SOLITON} does not respond')


def main() -> None:
    """Carry the soliton where the command line says."""
    parser = argparse.ArgumentParser(prog='move_soliton', description=__doc__)
    parser.add_argument('rotor', type=float, help='where to [rotor spacings from rotor 0]')
    parser.add_argument(
        '--speed', type=float, default=0.0, help='largest on the way [rotor spacings/s]'
    )
    arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
    stopping = stop_on_signals()
    try:
        initialise()
        result = Mover(stopping).move(arguments.rotor, arguments.speed)
    except ValueError as error:
        sys.exit(f'move_soliton: {error}')
    finally:
        rclpy.try_shutdown()
    if stopping.is_set():
        sys.exit(INTERRUPTED)
    sys.exit(result is None or result.outcome != MoveSoliton.Result.REACHED)
