# SPDX-License-Identifier: Apache-2.0
"""Keys that control the player."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable

_POLL_INTERVAL = 0.1
"""The thread waits at most this long for a key before it checks whether it was stopped [s]."""
_MOST_READ = 64
"""Most bytes that one read of the terminal returns [B]. A user types fewer in a poll interval."""
SPACE = ' '
UP, DOWN, RIGHT = '\x1b[A', '\x1b[B', '\x1b[C'
_KEY = re.compile(r'\x1b\[.?|.', re.DOTALL)


class Keyboard:
    """Thread that calls `press` with each key pressed in the terminal, if there is a terminal."""

    def __init__(self, press: Callable[[str], object]) -> None:
        self._press = press
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        if not (sys.stdin and sys.stdin.isatty()):
            return
        self._terminal = sys.stdin.fileno()
        # A background process must not change the terminal settings. Otherwise the system would
        # stop this process.
        if os.tcgetpgrp(self._terminal) != os.getpgrp():
            return
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        self._thread = threading.Thread(target=self._run, name='keyboard', daemon=True)
        self._thread.start()

    @property
    def taken(self) -> bool:
        """Whether the thread was started and reads keys."""
        return self._thread is not None

    def close(self) -> None:
        """Stop the thread and restore the settings of the terminal."""
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
            for key in _KEY.findall(pressed):
                self._press(key)
