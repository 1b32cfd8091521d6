# SPDX-License-Identifier: Apache-2.0
"""A serial port that is read in a thread, and opened again when it comes back."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

from soliton_linkage_nodes.runtime.scheduling import go_first

_LONGEST_SILENCE = 0.1
"""Of the port before the thread looks whether it is to end [s]."""
_LONGEST_WRITE = 0.05
"""After which a command is given up [s]: half of what the controller holds one for."""
_OPENED_AGAIN = 0.2
"""Between two tries to open a port that is gone [s]."""
_MOST_BYTES = 2**16
"""Read at once [1]: what the system keeps of a port is less."""
_NOT_KNOWN = 'n/a'
"""What pyserial says of a port that says nothing of itself."""


def pyserial() -> ModuleType:
    """Return pyserial; raises ValueError that says how to install it."""
    try:
        return import_module('serial')
    except ImportError as error:
        raise ValueError(
            f'serial ports need pyserial, which is not installed ({error}); run: '
            'pip install pyserial, or sudo apt install python3-serial'
        ) from error


def ports_in_words() -> str:
    """Which serial ports this machine has."""
    pyserial()
    found = import_module('serial.tools.list_ports').comports()
    if not found:
        return 'this machine has no serial port'
    told = [
        each.device if each.description == _NOT_KNOWN else f'{each.device} ({each.description})'
        for each in sorted(found)
    ]
    return f'this machine has {", ".join(told)}'


class ReopenedPort:
    """Hands over what comes until it is closed, and says when the port goes and comes back."""

    def __init__(
        self,
        path: str,
        baud_rate: int,
        take: Callable[[bytes, int], object],
        changed: Callable[[str], object],
        real_time: bool = False,
    ) -> None:
        """Open it and take from it in a thread each chunk with when it came (monotonic, [ns]).

        `changed` is told why the port is gone, and nothing when it is back, in the thread. Raises
        ValueError where the port cannot be opened.
        """
        self._serial = pyserial()
        self._path, self._baud_rate = path, baud_rate
        self._take, self._changed = take, changed
        self._closing = threading.Event()
        self._real_time = real_time
        try:
            self._port: Any = self._opened()
        except (OSError, ValueError) as error:
            raise ValueError(
                f'port {path!r} cannot be opened: {_reason(error)}; {ports_in_words()}'
            ) from error
        self._thread = threading.Thread(target=self._run, name='serial port', daemon=True)
        self._thread.start()

    @property
    def open(self) -> bool:
        """Whether the port is there."""
        return self._port is not None

    def write(self, data: bytes) -> None:
        """Send bytes, unless the port is gone; raises OSError where they do not get away."""
        port = self._port
        if port is None:
            return
        try:
            port.write(data)
        except TypeError as error:
            # The thread has closed it meanwhile, and pyserial writes to a file that is None.
            raise OSError('the port is gone') from error

    def close(self) -> None:
        """Take no more, and let go of the port."""
        self._closing.set()
        self._thread.join()
        self._drop()

    def _opened(self) -> Any:
        port = self._serial.Serial(
            self._path,
            self._baud_rate,
            write_timeout=_LONGEST_WRITE,
            exclusive=True,
        )
        with contextlib.suppress(AttributeError, NotImplementedError, OSError, ValueError):
            port.set_low_latency_mode(True)
        return port

    def _run(self) -> None:
        go_first(True, real_time=self._real_time)
        while not self._closing.is_set():
            try:
                self._read()
            except (OSError, TypeError, ValueError) as error:
                self._drop()
                self._changed(_reason(error))
                self._wait()

    def _read(self) -> None:
        # In place of pyserial's read, which looks four times at the system for what comes at once.
        file = self._port.fileno()
        ready, _, _ = select.select([file], [], [], _LONGEST_SILENCE)
        if not ready:
            return
        chunk = os.read(file, _MOST_BYTES)
        if not chunk:
            raise OSError('the device is no more there')
        self._take(chunk, time.monotonic_ns())

    def _wait(self) -> None:
        """Open the port again, as soon as it is there."""
        while not self._closing.wait(_OPENED_AGAIN):
            with contextlib.suppress(OSError, ValueError):
                self._port = self._opened()
                self._changed('')
                return

    def _drop(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(OSError):
                port.close()


def _reason(error: Exception) -> str:
    """What an error of a port says, in one line: pyserial wraps that of the system in its own."""
    for each in (error.__context__, error):
        if isinstance(each, OSError) and each.strerror:
            return str(each.strerror)
    return ' '.join(str(error).split())
