# SPDX-License-Identifier: Apache-2.0
"""Child processes that run nodes and end with the parent process, and private ROS domains."""

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
from ament_index_python import packages

_PACKAGE = 'soliton_linkage_nodes'
START_LIMIT = 180.0
"""Time limit for nodes to start and to discover each other [s], sufficient on a busy machine."""
_PARENT_DEATH_SIGNAL = 1
"""Option PR_SET_PDEATHSIG of prctl(2), with which the kernel sends a signal to a node when its
parent process ends."""
_STOP_LIMIT = 10.0
"""Time from SIGTERM to SIGKILL [s]. It is long because a recorder may write to a slow disk."""
_LOG_TAIL = 5
"""Number of log lines that the error message about an ended node quotes [1]."""
_DOMAINS = 100
"""Largest identifier of a private ROS domain [1]."""
_C_LIBRARY = ctypes.CDLL(None)


class ChildProcesses:
    """Processes that run nodes of the suite, each with a log file."""

    def __init__(self, log_folder: Path) -> None:
        self._log_folder = log_folder
        self._log_folder.mkdir(parents=True, exist_ok=True)
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starts: dict[str, tuple[float, list[str], dict[str, str]]] = {}

    def start(
        self, node: str, arguments: list[str], environment: dict[str, str], own: Sequence[str] = ()
    ) -> None:
        """Start a node. `arguments` are its ROS arguments, and `own` its other arguments."""
        executable = Path(packages.get_package_prefix(_PACKAGE), 'lib', _PACKAGE, node)
        command = [str(executable), *own, '--ros-args', *arguments]
        self._starts[node] = 0.0, command, environment
        self.restart(node)

    def restart(self, node: str) -> None:
        """Start an ended process again with the same arguments and environment."""
        _, command, environment = self._starts[node]
        self._starts[node] = time.monotonic(), command, environment
        with self._log(node).open('wb') as log:
            self._running[node] = subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    def ended(self) -> dict[str, str]:
        """Return a sentence about each process that has ended.

        Raises RuntimeError if a process has failed within 180 s after its start.
        """
        found = {}
        for node, process in self._running.items():
            if process.poll() is None:
                continue
            early = time.monotonic() < self._starts[node][0] + START_LIMIT
            if process.returncode > 0 and early:
                raise RuntimeError(self._ended(node, process.returncode))
            found[node] = f'{node} ended with exit code {process.returncode}'
        return found

    def check(self) -> None:
        """If a process has ended, raise RuntimeError with the last lines of its log."""
        for node, process in self._running.items():
            if process.poll() is not None:
                raise RuntimeError(self._ended(node, process.returncode))

    def wait(self, node: str, seconds: float) -> bool:
        """Return whether a process ends within `seconds`; RuntimeError if the process fails."""
        try:
            code = self._running[node].wait(seconds)
        except subprocess.TimeoutExpired:
            return False
        del self._running[node]
        if code:
            raise RuntimeError(self._ended(node, code))
        return True

    def stop(self, nodes: Sequence[str] | None = None) -> dict[str, int]:
        """Terminate or kill the named processes, by default all, and return their exit codes."""
        named = nodes or tuple(self._running)
        chosen = {node: self._running.pop(node) for node in named if node in self._running}
        for process in chosen.values():
            process.terminate()
        deadline = time.monotonic() + _STOP_LIMIT
        return {node: _end(process, deadline) for node, process in chosen.items()}

    def output(self, node: str) -> str:
        """Return all lines that a process has written to its log file since its last start."""
        return self._log(node).read_text(encoding='utf-8', errors='replace')

    def _log(self, node: str) -> Path:
        return self._log_folder / f'{node}.log'

    def _ended(self, node: str, code: int) -> str:
        tail = '\n  '.join(self.output(node).splitlines()[-_LOG_TAIL:])
        return f'{node} ended with exit code {code}; last lines of {self._log(node)}:\n  {tail}'


def page_address(output: str) -> str | None:
    """Return the address of the web page that live_view has printed in its `output`, or None."""
    found = re.search(r'open (http://\S+)', output)
    return found[1] if found else None


def has_display() -> bool:
    """Return whether this process can open a window."""
    return bool(os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY'))


@contextmanager
def private_domain() -> Iterator[None]:
    """Run a block in a random ROS domain that no other `private_domain` on this machine uses.

    The domain also applies to child processes of the block. The block must not raise OSError,
    because domain_coordinator would take the error for an occupied domain and try another one.
    """
    with domain_coordinator.domain_id(lambda: random.randint(1, _DOMAINS)) as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        restrict_to_loopback()
        for name in ('ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY'):
            os.environ.pop(name, None)
        yield


def restrict_to_loopback() -> None:
    """Make this process and its children unreachable from other machines.

    Fast DDS gets a profile, with which it uses only UDP on 127.0.0.1. With the discovery range
    LOCALHOST instead, Fast DDS would open sockets on all interfaces. It would also use shared
    memory, and the shared memory of a killed node could block all other nodes. Other middleware
    gets the discovery range LOCALHOST.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    try:
        profile = Path(packages.get_package_share_directory(_PACKAGE), 'config', 'loopback.xml')
    except packages.PackageNotFoundError:
        return
    middleware = os.environ.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'
    if middleware.startswith('rmw_fastrtps') and profile.is_file():
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'


def _end(process: subprocess.Popen[bytes], deadline: float) -> int:
    try:
        return process.wait(max(deadline - time.monotonic(), 0.0))
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def _die_with_parent() -> None:
    _C_LIBRARY.prctl(_PARENT_DEATH_SIGNAL, signal.SIGTERM)
