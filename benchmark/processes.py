# SPDX-License-Identifier: Apache-2.0
"""Nodes in processes on a separate domain, their messages, and their processor time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from soliton_linkage_nodes.runtime.child_processes import private_domain
from soliton_linkage_nodes.runtime.interfaces import Topic

Result = TypeVar('Result')

LONGEST_WAIT = 300.0
POLL = 0.002
_LONGEST_STOP = 60.0


@contextmanager
def own_domain() -> Iterator[None]:
    """Use a private domain for this process and its child processes."""
    with private_domain():
        rclpy.init()
        try:
            yield
        finally:
            rclpy.try_shutdown()


@contextmanager
def running(command: Sequence[str | Path]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process until the end of the block."""
    process = subprocess.Popen([str(part) for part in command])
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_LONGEST_STOP)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def node_command(name: str, settings: Mapping[str, Any]) -> list[str | Path]:
    """Return the command that starts a node of the suite with parameters."""
    package = 'soliton_linkage_nodes'
    arguments = [part for pair in settings.items() for part in ('-p', '{}:={}'.format(*pair))]
    return [Path(get_package_prefix(package), 'lib', package, name), '--ros-args', *arguments]


def program_command(program: Path, *arguments: object) -> list[str | Path]:
    """Return the command of another Python program."""
    return [sys.executable, program, *map(str, arguments)]


def until(
    condition: Callable[[], Result], what: str, process: subprocess.Popen[bytes] | None = None
) -> Result:
    """Poll until a condition returns a result, and return the result.

    Raises TimeoutError if the condition returns no result or if the process ends.
    """
    deadline = time.monotonic() + LONGEST_WAIT
    while not (found := condition()):
        if process is not None and process.poll() is not None:
            raise TimeoutError(f'no {what}: process ended with exit code {process.returncode}')
        if time.monotonic() > deadline:
            raise TimeoutError(f'no {what} within {LONGEST_WAIT:g} s')
        time.sleep(POLL)
    return found


def raw_subscription(
    node: Node, topic: Topic, name: str = '', qos: QoSProfile | None = None
) -> Subscription:
    """Subscribe to the undecoded messages of a topic, which `take_all` returns."""
    return node.create_subscription(
        topic.type, name or topic.name, print, qos or topic.qos, raw=True
    )


def take_all(subscription: Subscription) -> list[tuple[bytes, dict[str, int]]]:
    """Return all waiting messages of a raw subscription with their info."""
    handle, taken = subscription.handle, []
    with handle:
        while (message := handle.take_message(subscription.msg_type, True)) is not None:
            taken.append(message)
    return taken


def processor_time(process: int) -> float:
    """Return the processor time of a process so far [s]."""
    fields = Path(f'/proc/{process}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
