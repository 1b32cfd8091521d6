# SPDX-License-Identifier: Apache-2.0
"""A node as a process: it starts, or says in one line why not, and stops on a signal."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from soliton_linkage_nodes.runtime.command_line import check_arguments
from soliton_linkage_nodes.runtime.pacing import FirstAsLongAsIdle
from soliton_linkage_nodes.runtime.parameter_files import notices
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


_SHARE_OF_PERIOD = 0.1
"""Of the time between frames, after which a thread gives the interpreter up to who paces them [1]:
after the usual 5 ms a frame of 1000 Hz is five periods late. Half of it: who waits for the
interpreter wakes twice as often; twice: frames are later by a tenth of a period."""
_SHORTEST_TURN = 1e-4
"""Of a thread with the interpreter [s], which it takes some microseconds to change."""
_MIXED = 'Sequence should be of same type'
"""What rcl says of a list such as [1, 0.5]."""
_LONGEST_WAIT = 0.1
"""Of the executor, before the process looks whether a signal has come [s]."""


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


def interrupt_on_signals() -> None:
    """Have SIGINT and SIGTERM raise KeyboardInterrupt, in a program that computes."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextmanager
def interruptible(stopping: threading.Event) -> Iterator[None]:
    """Have SIGINT and SIGTERM raise KeyboardInterrupt in what computes, for the time of that.

    It is raised at once where one has come before, which has set `stopping`.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    interrupt_on_signals()
    try:
        if stopping.is_set():
            raise KeyboardInterrupt
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def initialise(arguments: list[str] | None = None) -> None:
    """Initialise ROS from the command line, or from arguments; ValueError where they are wrong."""
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        reason = str(error).splitlines()[0]
        hint = '; write all numbers of a list with a point, or none' if _MIXED in reason else ''
        raise ValueError(f'wrong ROS arguments: {reason}{hint}') from error


def run(create_node: Callable[[], Node], finished: Callable[[Any], bool] | None = None) -> None:
    """Spin a node until SIGINT or SIGTERM, or until it has finished, and end the process.

    What creates the node is its class. It does not where the command line asks for help or is
    wrong.

    `finished` may raise what the node has failed of: executors print the trace of what callbacks
    raise.

    The exit code is 0, 1 after one line where the node could not start or go on, or 2 after one
    line where the program was given arguments that it does not know.
    """
    check_arguments(create_node, sys.argv[1:])
    run_together([Component(create_node, finished)], sys.argv)


class Component(NamedTuple):
    """What creates a node, and what says whether it has finished or raises its failure."""

    create: Callable[[], Node]
    finished: Callable[[Any], bool] | None = None


def run_together(components: Sequence[Component], arguments: list[str]) -> None:
    """Spin several nodes in one process, as `run` does with one; they are destroyed together."""
    stopping = stop_on_signals()
    code = 0
    try:
        initialise(arguments)
        warnings.showwarning = _log_warning
        gc.collect()
        # In Jazzy its spin() hangs; turns of it do not, at half the cost of others.
        executor = EventsExecutor()
        with ExitStack() as stack:
            nodes = []
            for component in components:
                nodes.append(component.create())
                stack.callback(nodes[-1].destroy_node)
            for node in nodes:
                for notice in notices(node, arguments, nodes):
                    log = node.get_logger()
                    (log.warning if notice.warning else log.info)(notice.text)
            rates = [node.rate_of_frames for node in nodes if hasattr(node, 'rate_of_frames')]
            if rates:
                turn = max(_SHARE_OF_PERIOD / max(rates), _SHORTEST_TURN)
                sys.setswitchinterval(min(turn, sys.getswitchinterval()))
            # What stays for good is not to be searched for garbage, in 40 ms, while messages wait.
            gc.freeze()
            _spin(executor, list(zip(components, nodes, strict=True)), stopping)
    except (ValueError, OSError) as error:
        get_logger('soliton_linkage').fatal(str(error))
        code = 1
    except MemoryError as error:
        get_logger('soliton_linkage').fatal(f'memory is used up ({error}); see ulimit -a')
        code = 1
    finally:
        rclpy.try_shutdown()
    sys.exit(code)


def _log_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Log a warning of a library in one line."""
    text = ' '.join(str(message).split())
    get_logger('soliton_linkage').warning(
        f'{category.__name__}: {text} ({Path(filename).name}:{lineno})'
    )


def _spin(
    executor: Any,
    nodes: Sequence[tuple[Component, Node]],
    stopping: threading.Event,
) -> None:
    for _, node in nodes:
        executor.add_node(node)
    place = FirstAsLongAsIdle(any(getattr(node, 'real_time', False) for _, node in nodes))
    with Turns() as turns:
        while not stopping.is_set():
            if any(
                component.finished is not None and component.finished(node)
                for component, node in nodes
            ):
                break
            executor.spin_until_future_complete(turns.begin(), _LONGEST_WAIT)
            place.look()


class Turns:
    """Ends turns of an executor, in which it calls back for all that comes, after their time.

    To begin one for each callback takes as long as ten lines of Python. The executor looks at its
    own limit of time only where nothing waits for it.
    """

    def __init__(self) -> None:
        self._turn = Future()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._end_each, daemon=True)

    def __enter__(self) -> Turns:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def begin(self) -> Future:
        """Return what is done when the turn is over."""
        self._turn = Future()
        return self._turn

    def _end_each(self) -> None:
        while not self._over.wait(_LONGEST_WAIT):
            self._turn.set_result(None)
