# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes, on a domain of their own, and the processor time that they take."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python.packages import get_package_prefix

from soliton_linkage_nodes.runtime.child_processes import private_domain

_LONGEST_STOP = 60.0


@contextmanager
def own_domain() -> Iterator[None]:
    """A domain that nobody else is on, for this process and those that it starts."""
    with private_domain():
        rclpy.init()
        try:
            yield
        finally:
            rclpy.try_shutdown()


@contextmanager
def running(command: Sequence[str | Path]) -> Iterator[subprocess.Popen[bytes]]:
    """A process until the end of the block."""
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
    """Of a node of the suite with parameters."""
    package = 'soliton_linkage_nodes'
    arguments = [part for pair in settings.items() for part in ('-p', '{}:={}'.format(*pair))]
    return [Path(get_package_prefix(package), 'lib', package, name), '--ros-args', *arguments]


def program_command(program: Path, *arguments: object) -> list[str | Path]:
    """Of another program in Python."""
    return [sys.executable, program, *map(str, arguments)]


def processor_time(process: int) -> float:
    """That a process has taken so far [s]."""
    fields = Path(f'/proc/{process}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
