# SPDX-License-Identifier: Apache-2.0
"""A node as a process: it starts, or says in one line why not, and stops on a signal."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

_LONGEST_WAIT = 0.1


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set.

    rclpy's own handlers shut the context down at once, and what is still queued is lost.
    """
    stopping = threading.Event()

    def stop(_number: int, _frame: Any) -> None:
        stopping.set()

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    return stopping


def run(create_node: Callable[[], Node], finished: Callable[[Any], bool] | None = None) -> None:
    """Spin a node until SIGINT or SIGTERM, or until it has finished, and end the process.

    The exit code is 0, or 1 after one line where the node could not start or go on.
    """
    stopping = stop_on_signals()
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        sys.exit(f'the ROS arguments are wrong: {str(error).splitlines()[0]}')
    node = None
    code = 0
    try:
        node = create_node()
        # In Jazzy its spin() hangs; spin_once() does not, at half the cost of other executors.
        executor = EventsExecutor()
        executor.add_node(node)
        while not (stopping.is_set() or (finished and finished(node))):
            executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except (ValueError, OSError) as error:
        get_logger(node.get_name() if node else 'soliton_linkage').fatal(str(error))
        code = 1
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    sys.exit(code)
