# SPDX-License-Identifier: Apache-2.0
"""A serial port without a wire: whoever opens its path is heard and spoken to at this end."""

from __future__ import annotations

import contextlib
import os
import pty
import tty
from pathlib import Path

_MOST_BYTES = 2**16
"""Read at once [1]: what the system keeps of a terminal is less."""


class PseudoTerminal:
    """Both ends of a terminal that passes bytes on as they are."""

    def __init__(self, link: Path | None = None) -> None:
        """Open it; a link to it has a name that stays from one to the next."""
        self._here, self._there = pty.openpty()
        tty.setraw(self._there)
        os.set_blocking(self._here, False)
        self._link = link
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(os.ttyname(self._there))

    @property
    def path(self) -> str:
        """To be opened as a serial port."""
        return str(self._link or os.ttyname(self._there))

    def read(self) -> bytes:
        """What has come from there."""
        try:
            return os.read(self._here, _MOST_BYTES)
        except BlockingIOError:
            return b''

    def write(self, data: bytes) -> bool:
        """Send bytes there; False where nobody takes them and some are lost."""
        try:
            return os.write(self._here, data) == len(data)
        except BlockingIOError:
            return False

    def close(self) -> None:
        """Pull the plug."""
        if self._link is not None:
            with contextlib.suppress(FileNotFoundError):
                self._link.unlink()
        os.close(self._here)
        os.close(self._there)
