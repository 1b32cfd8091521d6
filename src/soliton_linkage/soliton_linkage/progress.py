# SPDX-License-Identifier: Apache-2.0
"""Display of the progress of a long computation, as one line on stderr.

tqdm is not used, because it writes carriage returns into log files and cannot shorten the title.
"""

from __future__ import annotations

import os
import sys
import time

_BAR_WIDTH = 30
"""Largest width of the progress bar [characters]."""
_MINIMUM_BAR_WIDTH = 10
"""Smallest width of the progress bar [characters]. A title that leaves less space for the bar is
shortened."""
_TERMINAL_INTERVAL = 0.1
"""Shortest time between two updates in a terminal [s]; more frequent updates flicker."""
_LOG_INTERVAL = 2.0
"""Shortest time between two lines in a log file [s]."""
_DEFAULT_COLUMNS = 80
"""Assumed line width [characters] if stderr is not a terminal or does not report a width."""


def line_width() -> int:
    """Return the number of characters that fit on a line of stderr."""
    try:
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    # One column is left for the cursor. Some terminals report a width of 0.
    return columns - 1 if columns > 1 else _DEFAULT_COLUMNS


class ProgressLine:
    """Progress display: one line that is updated in a terminal, separate lines in a log file."""

    def __init__(self, title: str, total: float) -> None:
        """Prepare to show the progress from 0 to `total`; if `total` is 0, no bar is shown."""
        self.total = total
        self._title = title
        self._terminal = sys.stderr.isatty()
        self._interval = _TERMINAL_INTERVAL if self._terminal else _LOG_INTERVAL
        self._shown_at = time.monotonic() - self._interval

    @property
    def due(self) -> bool:
        """Whether enough time has passed since the last update to show the next one."""
        return time.monotonic() - self._shown_at >= self._interval

    def show(self, done: float, remark: str = '') -> None:
        """Show the progress and a remark if an update is due; shorten a title that is too long."""
        if not self.total:
            self.show_text(f'{self._title}: {remark}' if remark else self._title)
            return
        fraction = min(max(done / self.total, 0.0), 1.0)
        tail = f'] {fraction:4.0%} {remark}'
        title, width = f'{self._title} [', _BAR_WIDTH
        if self._terminal:
            room = max(line_width() - len(tail), 0)
            width = min(max(room - len(title), _MINIMUM_BAR_WIDTH), _BAR_WIDTH)
            title = title[max(len(title) + width - room, 0) :]
        filled = round(fraction * width)
        self.show_text(f'{title}{"#" * filled}{"." * (width - filled)}{tail}')

    def show_text(self, text: str) -> None:
        """Show a text instead of a bar if an update is due."""
        if self.due:
            self._shown_at = time.monotonic()
            self._write(text[: line_width()] if self._terminal else text)

    def note(self, text: str) -> None:
        """Write a permanent line above the progress line."""
        self._write(f'{text}\n' if self._terminal else text)

    def end(self, remark: str) -> None:
        """Replace the progress line by a final remark, which remains."""
        self._write(remark)
        if self._terminal:
            sys.stderr.write('\n')

    def clear(self) -> None:
        """Remove the progress line from a terminal."""
        if self._terminal:
            self._write('')

    def _write(self, text: str) -> None:
        sys.stderr.write(f'\r\x1b[K{text}' if self._terminal else f'{text}\n')
        sys.stderr.flush()
