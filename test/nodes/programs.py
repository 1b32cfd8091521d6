# SPDX-License-Identifier: Apache-2.0
"""The suite's programs as processes."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_prefix

LONGEST_WAIT = 240.0
PACKAGE = 'soliton_linkage_nodes'

_SIGNALLED = """
import os, runpy, sys

moment, number, *sys.argv = sys.argv[1:]
place, _, function = moment.rpartition(':')

def send(frame, event, argument):
    code = frame.f_code
    if code.co_name == function and code.co_filename.endswith(place):
        sys.settrace(None)
        os.kill(os.getpid(), int(number))

sys.settrace(send)
runpy.run_path(sys.argv[0], run_name='__main__')
"""


def signalled(moment: str, number: signal.Signals) -> list[str]:
    """Return a command that runs a program and sends it a signal when a function is called.

    The moment is the end of a file's name and, after a colon, the function's name, which is
    `<module>` where a module begins to be imported.
    """
    return [sys.executable, '-c', _SIGNALLED, moment, str(int(number))]


def until(condition: Callable[[], Any], what: str, found: Callable[[], Any] | None = None) -> Any:
    """Wait until a condition is true and return its value; on timeout, fail with what is found."""
    deadline = time.monotonic() + LONGEST_WAIT
    while not (value := condition()):
        if time.monotonic() > deadline:
            instead = '' if found is None else f' and found {found()}'
            pytest.fail(f'waited {LONGEST_WAIT:g} s for {what}{instead}')
        time.sleep(0.01)
    return value


class Program:
    """A program of the suite as a process, with its output so far."""

    def __init__(
        self, name: str, arguments: list[str], domain: int, log: Path, command: Sequence[str] = ()
    ) -> None:
        self._log = log
        executable = Path(get_package_prefix(PACKAGE), 'lib', PACKAGE, name)
        with log.open('wb') as stream:
            self.process = subprocess.Popen(
                [*command, str(executable), *arguments],
                cwd=log.parent,
                env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
            )

    @property
    def said(self) -> list[str]:
        """Its lines of output."""
        return self._log.read_text(encoding='utf-8').splitlines()

    def wait(self) -> int:
        """Return its exit code once it has ended by itself."""
        return self.process.wait(LONGEST_WAIT)

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """Return the exit code with which it ends after a signal."""
        self.process.send_signal(number)
        return self.process.wait(LONGEST_WAIT)
