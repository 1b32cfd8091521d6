# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes of their own, none of which outlives the one that started them."""

from __future__ import annotations

import ctypes
import os
import random
import re
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import domain_coordinator
from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)

_PACKAGE = 'soliton_linkage_nodes'
START_LIMIT = 60.0
"""How long nodes may take until they hear each other, on a busy machine [s]."""
_PARENT_DEATH_SIGNAL = 1
"""PR_SET_PDEATHSIG of prctl(2)."""
_LONGEST_END = 10.0
"""Time for a node to end, before it is killed [s]: a recorder may have to wait for its disk."""
_LOG_TAIL = 5
"""Lines of a log that are told when a node has ended."""
_DOMAINS = 100
"""Numbers of the domains that the coordinator gives away, from 1 on."""
_C_LIBRARY = ctypes.CDLL(None)


class ChildProcesses:
    """Processes of the suite's nodes, each with a log file of what it says."""

    def __init__(self, log_folder: Path) -> None:
        self._log_folder = log_folder
        self._log_folder.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(
        self,
        node: str,
        arguments: list[str],
        environment: dict[str, str],
        own: Sequence[str] = (),
    ) -> None:
        """Start a node with its ROS arguments, and its own before them."""
        executable = Path(get_package_prefix(_PACKAGE), 'lib', _PACKAGE, node)
        with self._log(node).open('wb') as log:
            self._running[node] = subprocess.Popen(
                [str(executable), *own, '--ros-args', *arguments],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def check(self) -> None:
        """Raise RuntimeError, with what it said last, where a process has ended."""
        for node, process in self._running.items():
            if process.poll() is not None:
                raise RuntimeError(self._obituary(node, process.returncode))

    def wait(self, node: str, seconds: float) -> bool:
        """Wait for a process to end; False where it has not, RuntimeError where it failed."""
        try:
            code = self._running[node].wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        del self._running[node]
        if code:
            raise RuntimeError(self._obituary(node, code))
        return True

    def stop(self, nodes: Sequence[str] | None = None) -> dict[str, int]:
        """Terminate some processes, or all, and return their exit codes; kill them after 10 s."""
        chosen = {node: self._running.pop(node) for node in nodes or tuple(self._running)}
        for process in chosen.values():
            process.terminate()
        deadline = time.monotonic() + _LONGEST_END
        return {node: _end(process, deadline) for node, process in chosen.items()}

    def output(self, node: str) -> str:
        """What a process has said so far."""
        return self._log(node).read_text(encoding='utf-8', errors='replace')

    def _log(self, node: str) -> Path:
        return self._log_folder / f'{node}.log'

    def _obituary(self, node: str, code: int) -> str:
        tail = '\n  '.join(self.output(node).splitlines()[-_LOG_TAIL:])
        return f'{node} ended with exit code {code}; it said, in {self._log(node)}:\n  {tail}'


def page_address(said: str) -> str | None:
    """Address of the page in what live_view said, None before it serves one."""
    found = re.search(r'open (http://\S+)', said)
    return found[1] if found else None


def has_display() -> bool:
    """Whether a browser that is opened here would be seen."""
    return bool(os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY'))


@contextmanager
def private_domain() -> Iterator[None]:
    """Keep this process and its children to a domain of their own on this machine.

    It is any of those that are free, not the first: that one may have been left just now, and
    what ran on it may still be ending. The block must let no OSError pass, which the coordinator
    would take for a domain that is in use.
    """
    with domain_coordinator.domain_id(lambda: random.randint(1, _DOMAINS)) as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        restrict_to_loopback()
        for name in ('ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY'):
            os.environ.pop(name, None)
        yield


def restrict_to_loopback() -> None:
    """Let no other machine reach this process and its children.

    LOCALHOST alone leaves sockets of Fast DDS open to all, and has it use shared memory: what a
    process leaves there half made, that was killed at its start, all others then wait for.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    profile = _share() / 'config' / 'loopback.xml'
    middleware = os.environ.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'
    if middleware.startswith('rmw_fastrtps') and profile.is_file():
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'


def _share() -> Path:
    try:
        return Path(get_package_share_directory('soliton_linkage_nodes'))
    except PackageNotFoundError:
        return Path()


def _end(process: subprocess.Popen[bytes], deadline: float) -> int:
    try:
        return process.wait(max(deadline - time.monotonic(), 0.0))
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _die_with_parent() -> None:
    _C_LIBRARY.prctl(_PARENT_DEATH_SIGNAL, signal.SIGTERM)
