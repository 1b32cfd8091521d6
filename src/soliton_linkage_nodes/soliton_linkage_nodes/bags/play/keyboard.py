# SPDX-License-Identifier: Apache-2.0
"""Keys of the terminal, taken as they are pressed."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Mapping

_POLL_INTERVAL = 0.1
"""How soon it stops when it is told to [s]."""
_MOST_READ = 64
"""Bytes that are read at one go, many more than a person types in that time."""
SPACE = ' '
UP, DOWN, RIGHT = '\x1b[A', '\x1b[B', '\x1b[C'


class Keyboard:
    """Calls what belongs to a key in a thread of its own; does nothing without a terminal."""

    def __init__(self, actions: Mapping[str, Callable[[], object]]) -> None:
        """Begin to take keys, if there are any to be taken."""
        self._actions = actions
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        if not (sys.stdin and sys.stdin.isatty()):
            return
        self._terminal = sys.stdin.fileno()
        # A process in the background would be stopped if it touched the terminal.
        if os.tcgetpgrp(self._terminal) != os.getpgrp():
            return
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        self._thread = threading.Thread(target=self._run, name='keyboard', daemon=True)
        self._thread.start()

    @property
    def taken(self) -> bool:
        """Whether keys are taken."""
        return self._thread is not None

    def close(self) -> None:
        """Give the terminal back as it was."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._before)
            self._thread = None

    def _run(self) -> None:
        while not self._stopping.is_set():
            ready, _, _ = select.select([self._terminal], [], [], _POLL_INTERVAL)
            pressed = os.read(self._terminal, _MOST_READ).decode(errors='replace') if ready else ''
            if ready and not pressed:
                return
            for key in _keys(pressed):
                self._actions.get(key, lambda: None)()


def _keys(pressed: str) -> list[str]:
    """Split what was read into keys, of which arrows are three characters each."""
    keys = []
    while pressed:
        size = 3 if pressed.startswith('\x1b[') else 1
        keys.append(pressed[:size])
        pressed = pressed[size:]
    return keys
