# SPDX-License-Identifier: Apache-2.0
"""Waiting for what a program's node hears."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from soliton_linkage_nodes.runtime.parameters import refuse_unknown

_SPIN = 0.02
"""How soon a condition is looked at again where nothing is heard [s]."""


def spin_until(
    executor: Executor,
    condition: Callable[[], bool],
    seconds: float,
    give_up: Callable[[], bool] = lambda: False,
) -> bool:
    """Spin until a condition holds; False where it does not in time, or is given up."""
    deadline = time.monotonic() + seconds
    while not condition():
        if give_up() or time.monotonic() > deadline:
            return False
        executor.spin_once(timeout_sec=_SPIN)
    return True


class WaitingNode(Node):
    """The node of a program that spins it while it waits for answers, until it is interrupted."""

    def __init__(self, name: str, stopping: threading.Event, **kwargs: Any) -> None:
        """Take no parameters; `stopping` is set to interrupt what it waits for."""
        super().__init__(name, **kwargs)
        self.stopping = stopping
        refuse_unknown(self)
        self._waiting = EventsExecutor(context=self.context)
        self._waiting.add_node(self)

    def wait(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until a condition holds; False where it is too late or interrupted."""
        return spin_until(self._waiting, condition, seconds, self.stopping.is_set)

    def wait_on(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until a condition holds, also where it was interrupted."""
        return spin_until(self._waiting, condition, seconds)

    def destroy_node(self) -> None:
        """Leave the graph, on which the executor would else keep it."""
        self._waiting.shutdown()
        super().destroy_node()
