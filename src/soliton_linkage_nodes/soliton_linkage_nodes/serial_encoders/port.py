# SPDX-License-Identifier: Apache-2.0
"""Serial port that is read by a thread and reopened after a loss of the connection."""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import select
import termios
import threading
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from soliton_linkage_nodes.runtime.pacing import raise_priority

_READ_TIMEOUT = 0.1
"""Interval at which the thread checks whether it must stop [s]."""
_WRITE_TIMEOUT = 0.05
"""Longest duration of the transmission of a command [s], half of the default of the parameter
`valves.hold`."""
_REOPEN_INTERVAL = 0.2
"""Time between two attempts to reopen a lost port [s]."""
_READ_SIZE = 2**16
"""Largest number of bytes that one call reads [1]. The buffer of the system is smaller."""


def pyserial() -> ModuleType:
    """Return the module `serial` of pyserial. Raises ValueError if it is not installed."""
    try:
        return import_module('serial')
    except ImportError as error:
        raise ValueError(
            f'serial ports need pyserial, which is not installed ({error}); run: '
            'pip install pyserial, or sudo apt install python3-serial'
        ) from error


def describe_ports() -> str:
    """Return a sentence that lists the serial ports of this machine."""
    pyserial()
    found = [
        # For a port without a description, pyserial returns the description n/a.
        each.device if each.description == 'n/a' else f'{each.device} ({each.description})'
        for each in sorted(import_module('serial.tools.list_ports').comports())
    ]
    return f'this machine has {", ".join(found) or "no serial port"}'


class ReopenedPort:
    """Serial port that is read by a thread and reopened after a loss of the connection."""

    def __init__(
        self,
        path: str,
        baud_rate: int,
        take: Callable[[bytes, int], object],
        changed: Callable[[str], object],
        *,
        hang_up: bool = True,
        real_time: bool = False,
    ) -> None:
        """Open the port and start the thread. Raises ValueError if the port cannot be opened.

        The thread calls `take` with the received bytes and their time of arrival on the monotonic
        clock [ns]. If the connection is lost, the thread calls `changed` with the reason. When the
        port is open again, it calls `changed` with ''. If `hang_up` is set, the DTR line is
        released when the port closes.
        """
        self._serial = pyserial()
        self._path, self._baud_rate = path, baud_rate
        self._take, self._changed = take, changed
        self._closing = threading.Event()
        self._hang_up, self._real_time = hang_up, real_time
        try:
            self._port: Any = self._open()
        except (OSError, ValueError) as error:
            raise ValueError(
                f'port {path!r} cannot be opened: {_reason(error)}; '
                f'{_remedy(error, path) or describe_ports()}'
            ) from error
        self._thread = threading.Thread(target=self._run, name='serial port', daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def write(self, data: bytes) -> None:
        """Send bytes if the port is open. Raises OSError if the transmission fails."""
        port = self._port
        if port is None:
            return
        try:
            port.write(data)
        except TypeError as error:
            # pyserial raises TypeError if the thread has closed the port in the meantime.
            raise OSError('the port was closed') from error

    def close(self) -> None:
        """Stop the thread and close the port."""
        self._closing.set()
        self._thread.join()
        self._close_port()

    def _open(self) -> Any:
        port = self._serial.Serial(
            self._path, self._baud_rate, write_timeout=_WRITE_TIMEOUT, exclusive=True
        )
        with contextlib.suppress(AttributeError, NotImplementedError, OSError, ValueError):
            port.set_low_latency_mode(True)
        if not self._hang_up:
            with contextlib.suppress(termios.error):
                attributes = termios.tcgetattr(port.fileno())
                attributes[2] &= ~termios.HUPCL
                termios.tcsetattr(port.fileno(), termios.TCSANOW, attributes)
        return port

    def _run(self) -> None:
        if self._real_time:
            raise_priority(True)
        while not self._closing.is_set():
            try:
                self._read()
            except (OSError, TypeError, ValueError) as error:
                self._close_port()
                self._changed(_reason(error))
                while self._port is None and not self._closing.wait(_REOPEN_INTERVAL):
                    with contextlib.suppress(OSError, ValueError):
                        self._port = self._open()
                        self._changed('')

    def _read(self) -> None:
        # These lines make two system calls per chunk. The method `read` of pyserial makes four.
        file = self._port.fileno()
        ready, _, _ = select.select([file], [], [], _READ_TIMEOUT)
        if ready:
            chunk = os.read(file, _READ_SIZE)
            if not chunk:
                raise OSError('the device was removed')
            self._take(chunk, time.monotonic_ns())

    def _close_port(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):
                port.close()


def _remedy(error: Exception, path: str) -> str:
    errors = [getattr(each, 'errno', None) for each in (error.__context__, error)]
    if errno.EACCES not in errors:
        return ''
    group = 'dialout'
    with contextlib.suppress(OSError, KeyError):
        owner = Path(path).stat().st_gid
        group = grp.getgrgid(owner).gr_name if owner else group
    return f'run: sudo usermod -aG {group} $USER; then log in again'


def _reason(error: Exception) -> str:
    """Return the error text of the operating system or, if it has none, of pyserial."""
    for each in (error.__context__, error):
        if isinstance(each, OSError) and each.strerror:
            return str(each.strerror)
    return ' '.join(str(error).split())
