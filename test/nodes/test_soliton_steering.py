# SPDX-License-Identifier: Apache-2.0
"""The soliton goes where it is sent, and each thing that can go wrong has its own answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from graphs import Graph, values
from rclpy.action import ActionClient
from std_srvs.srv import SetBool, Trigger

from soliton_linkage.chain import Chain
from soliton_linkage.cycle import Cycle
from soliton_linkage.cycle_fit import fit_anywhere
from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.simulator import Simulator
from soliton_linkage_nodes.soliton_steering import SolitonSteering

pytestmark = pytest.mark.usefixtures('often')

ROTORS = 8
CHAIN = Chain(number_of_rotors=ROTORS)
CYCLE = Cycle(CHAIN)
Result = MoveSoliton.Result


class Bench:
    """A simulated chain with a steering, and a user who sends goals."""

    def __init__(self, graph: Graph, parameters: dict[str, Any] | None = None) -> None:
        self.graph = graph
        self.reports = graph.reports('soliton_steering')
        self.frames = graph.hear(interfaces.JOINT_STATES)
        self.torques = graph.hear(interfaces.ROTOR_TORQUES)
        self.feedback: list[MoveSoliton.Feedback] = []
        self.simulator = graph.start(
            Simulator,
            {'chain.number_of_rotors': ROTORS, 'publish_rate': 250.0, 'tolerance': 1e-8},
        )
        self.node = graph.start(SolitonSteering, parameters)
        self._client = ActionClient(graph.user, MoveSoliton, interfaces.MOVE_SOLITON)
        graph.until(self._client.server_is_ready, 'the action server')
        graph.until(lambda: self.message == 'ready', 'a steering that sees the wall')

    @property
    def message(self) -> str:
        return str(self.reports[-1].message) if self.reports else ''

    @property
    def place(self) -> float:
        """Where the wall is by the last frame [rotor spacings]."""
        return CYCLE.place(fit_anywhere(CYCLE, np.array(self.frames[-1].position)).arc)

    def send(self, rotor: float, speed: float = 0.0) -> Any:
        """Return the handle of a goal that was accepted."""
        goal = MoveSoliton.Goal(rotor=rotor, speed=speed)
        sent = self._client.send_goal_async(
            goal, feedback_callback=lambda message: self.feedback.append(message.feedback)
        )
        self.graph.until(sent.done, 'an answer to the goal')
        assert sent.result().accepted
        return sent.result()

    def result(self, handle: Any) -> Any:
        """Return how a goal ended."""
        future = handle.get_result_async()
        self.graph.until(future.done, 'the result')
        return future.result()

    def move(self, rotor: float, speed: float = 0.0) -> Any:
        return self.result(self.send(rotor, speed))

    def after(self, frames: int) -> None:
        """Wait for more frames."""
        target = len(self.frames) + frames
        self.graph.until(lambda: len(self.frames) >= target, f'{frames} frames')


def test_the_wall_is_drawn_out_of_its_edge_to_a_place_and_held_there(graph: Graph) -> None:
    bench = Bench(graph)
    ended = bench.move(4.3)
    assert (ended.status, ended.result.outcome) == (GoalStatus.STATUS_SUCCEEDED, Result.REACHED)
    assert ended.result.rotor == pytest.approx(4.3, abs=0.05)
    for _ in range(5):
        bench.after(20)
        assert bench.place == pytest.approx(4.3, abs=0.1)
    rotors = [each.rotor for each in bench.feedback]
    assert len(rotors) > 5
    assert max(rotors) < 4.4
    assert max(each.speed for each in bench.feedback) > 1
    assert all(each.phonon_energy >= 0 for each in bench.feedback)
    assert bench.feedback[-1].phonon_energy < 1e-7
