# SPDX-License-Identifier: Apache-2.0
"""Start and end of a process that runs nodes: spinning, signals, and errors in one line."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from soliton_linkage_nodes.runtime.command_line import check_arguments
from soliton_linkage_nodes.runtime.pacing import IdlePriority
from soliton_linkage_nodes.runtime.parameter_files import check_files, notices
from soliton_linkage_nodes.runtime.parameters import reject_unknown

_SPIN = 0.02
"""Longest time between two checks of a condition if no message arrives [s]."""
_SHARE_OF_PERIOD = 0.1
"""Switch interval of the interpreter, divided by the period at which a node publishes frames [1].
The period is 1 / `frame_rate`; nodes without this attribute do not count. A thread that needs the
interpreter can wait for one switch interval, so that a frame can be late by 0.1 periods.
Sensitivity: at 0.5x, waiting threads wake up twice as often; at 2x, a frame can be late by 0.2
periods."""
_SHORTEST_INTERVAL = 1e-4
"""Shortest switch interval of the interpreter [s], well above the few microseconds of a switch."""
_MIXED = 'Sequence should be of same type'
"""Part of rcl's error message for a list that mixes integers and floats, such as [1, 0.5]."""
_LONGEST_WAIT = 0.1
"""Length of a slice of spinning [s], after which the process checks for a signal."""


def spin_until(
    executor: Executor,
    condition: Callable[[], bool],
    seconds: float,
    give_up: Callable[[], bool] = lambda: False,
) -> bool:
    """Spin until `condition()`; return False after `seconds` or when `give_up()` is true."""
    deadline = time.monotonic() + seconds
    while not condition():
        if give_up() or time.monotonic() > deadline:
            return False
        executor.spin_once(timeout_sec=_SPIN)
    return True


class WaitingNode(Node):
    """Node that receives messages only during `wait`."""

    def __init__(self, name: str, stopping: threading.Event, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.stopping = stopping
        self.declare_own()
        reject_unknown(self)
        self._waiting = EventsExecutor(context=self.context)
        self._waiting.add_node(self)

    def declare_own(self) -> None:
        """Declare the parameters of the node; by default, there are none."""

    def wait(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until `condition()`; return False after `seconds` or when `stopping` is set."""
        return spin_until(self._waiting, condition, seconds, self.stopping.is_set)

    def wait_uninterrupted(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Spin until `condition()`, even if `stopping` is set; return False after `seconds`."""
        return spin_until(self._waiting, condition, seconds)

    def destroy_node(self) -> None:
        """Destroy the node and its executor, which would keep the node in the graph."""
        self._waiting.shutdown()
        super().destroy_node()


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set, so that the process ends without data loss."""
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: stopping.set())
    return stopping


def interrupt_on_signals() -> None:
    """Make SIGINT and SIGTERM raise KeyboardInterrupt, so that they end a long computation."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextmanager
def interruptible(stopping: threading.Event) -> Iterator[None]:
    """Run a block in which SIGINT and SIGTERM set `stopping` and raise KeyboardInterrupt.

    If `stopping` is already set, KeyboardInterrupt is raised at the start of the block. If a
    library suppresses the exception, or it is raised in a callback whose errors Python only
    prints, it is raised again at the end of the block.
    """
    show = sys.unraisablehook
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def check() -> None:
        if stopping.is_set():
            raise KeyboardInterrupt

    def interrupt(_number: int, _frame: object) -> None:
        stopping.set()
        check()

    for number in handlers:
        signal.signal(number, interrupt)
    sys.unraisablehook = lambda lost: lost.exc_type is KeyboardInterrupt or show(lost)
    try:
        check()
        yield
        check()
    finally:
        sys.unraisablehook = show
        for number, handler in handlers.items():
            signal.signal(number, handler)


def initialise(arguments: list[str] | None = None) -> None:
    """Initialise ROS from arguments, by default the command line; ValueError if one is wrong."""
    check_files(sys.argv if arguments is None else arguments)
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        hint = '; write all numbers of a list with a point, or none' if _MIXED in reason else ''
        raise ValueError(f'wrong ROS arguments: {reason}{hint}') from error


def run(create_node: Callable[[], Node]) -> None:
    """Create a node, spin it until it finishes or SIGINT or SIGTERM arrives, and end the process.

    The spinning ends when the attribute `finished` of a node is true or its attribute `failure` is
    an error; both attributes are optional. A callback must store an error in `failure` instead of
    raising it, because executors print a traceback of a raised error. The exit code is 0, 1 after
    a failure, or 2 if an argument is unknown.
    """
    check_arguments(create_node, sys.argv[1:])
    run_together([create_node], sys.argv)


def run_together(constructors: Sequence[Callable[[], Node]], arguments: list[str]) -> None:
    """Create nodes, spin all of them in this process, and end the process as `run` does."""
    stopping = stop_on_signals()
    code = 0
    try:
        initialise(arguments)
        warnings.showwarning = _log_warning
        gc.collect()
        # EventsExecutor is twice as fast as the other executors. In Jazzy its spin() can hang, but
        # spinning in slices of 0.1 s does not.
        executor = EventsExecutor()
        with ExitStack() as stack:
            nodes = []
            for create_node in constructors:
                nodes.append(create_node())
                stack.callback(nodes[-1].destroy_node)
            for node in nodes:
                for text, warning in notices(node, arguments, nodes):
                    log = node.get_logger()
                    (log.warning if warning else log.info)(text)
            rates = [node.frame_rate for node in nodes if hasattr(node, 'frame_rate')]
            if rates:
                interval = max(_SHARE_OF_PERIOD / max(rates), _SHORTEST_INTERVAL)
                sys.setswitchinterval(min(interval, sys.getswitchinterval()))
            # Exclude all objects that exist now from garbage collection. Otherwise, a collection
            # would take 40 ms.
            gc.freeze()
            # At the end, the executor shuts down before the nodes are destroyed, because threads
            # of the middleware call it when a message arrives.
            stack.callback(executor.shutdown)
            _spin(executor, nodes, stopping)
    except (ValueError, OSError, MemoryError) as error:
        out = isinstance(error, MemoryError)
        text = f'out of memory ({error}); see ulimit -a' if out else str(error)
        get_logger('soliton_linkage').fatal(text)
        code = 1
    finally:
        if code:
            gc.collect()  # a node whose constructor has failed is part of reference cycles
        rclpy.try_shutdown()
    end_process(code)


def end_process(code: int) -> None:
    """End the process with an exit code, without waiting for daemon threads that still compute."""
    if any(thread.daemon for thread in threading.enumerate() if thread.is_alive()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _log_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any, **__: Any
) -> None:
    text = ' '.join(str(message).split())
    get_logger('soliton_linkage').warning(
        f'{category.__name__}: {text} ({Path(filename).name}:{lineno})'
    )


def _spin(executor: Any, nodes: Sequence[Node], stopping: threading.Event) -> None:
    for node in nodes:
        executor.add_node(node)
    priority = IdlePriority(any(getattr(node, 'real_time', False) for node in nodes))
    with SpinSlices() as slices:
        while not (stopping.is_set() or any(map(_has_finished, nodes))):
            executor.spin_until_future_complete(slices.begin(), _LONGEST_WAIT)
            priority.update()


def _has_finished(node: Node) -> bool:
    failure = getattr(node, 'failure', None)
    if failure is not None:
        raise failure
    return bool(getattr(node, 'finished', False))


class SpinSlices:
    """Thread that ends each slice of spinning after 0.1 s, so that signals are noticed in time.

    It is needed because the executor checks its own time limit only while no message is waiting.
    """

    def __init__(self) -> None:
        self._slice = Future()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._end_each, daemon=True)

    def __enter__(self) -> SpinSlices:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def begin(self) -> Future:
        """Begin a slice and return a future that is done when the slice ends."""
        self._slice = Future()
        return self._slice

    def _end_each(self) -> None:
        while not self._over.wait(_LONGEST_WAIT):
            self._slice.set_result(None)
