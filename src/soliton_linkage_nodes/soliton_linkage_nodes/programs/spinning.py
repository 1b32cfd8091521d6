# SPDX-License-Identifier: Apache-2.0
"""Waiting for what a program's node hears."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.executors import Executor

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
