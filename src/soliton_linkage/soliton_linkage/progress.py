# SPDX-License-Identifier: Apache-2.0
"""A line in the terminal that shows how far something has come."""

from __future__ import annotations

import os
import sys
import time

_WIDTH = 30
"""Of the bar [characters]."""
_NARROWEST = 10
"""Bar where a line is short [characters]: a tenth can still be told."""
_TERMINAL_INTERVAL = 0.1
"""Least time from line to line where the line is rewritten [s]: it does not flicker."""
_LOG_INTERVAL = 2.0
"""Least time from line to line where each stays [s]."""
_USUAL_WIDTH = 80
"""Of what is no terminal, or one that does not tell [characters]."""


def line_width() -> int:
    """Characters that fit on a line of stderr."""
    try:
        columns = os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        columns = 0
    # One is left to the cursor; some terminals tell none.
    return columns - 1 if columns > 1 else _USUAL_WIDTH


class ProgressLine:
    """Rewrites one line of a terminal in place; where there is none, writes a line at times."""

    def __init__(self, title: str, total: float) -> None:
        """Prepare to show how much of a total is done."""
        self.total = total
        self._title = title
        self._live = sys.stderr.isatty()
        self._interval = _TERMINAL_INTERVAL if self._live else _LOG_INTERVAL
        self._shown_at = time.monotonic() - self._interval

    @property
    def due(self) -> bool:
        """Whether the last time was not just now."""
        return time.monotonic() - self._shown_at >= self._interval

    def show(self, done: float, remark: str = '') -> None:
        """Show how much is done, if that is due; on a short line the remark has precedence.

        There is no bar without a total.
        """
        if not self.total:
            self.show_text(f'{self._title}: {remark}' if remark else self._title)
            return
        share = min(max(done / self.total, 0.0), 1.0)
        said = f'] {share:4.0%} {remark}'
        title, width = f'{self._title} [', _WIDTH
        if self._live:
            room = max(line_width() - len(said), 0)
            width = min(max(room - len(title), _NARROWEST), _WIDTH)
            title = title[max(len(title) + width - room, 0) :]
        filled = round(share * width)
        self.show_text(f'{title}{"#" * filled}{"." * (width - filled)}{said}')

    def show_text(self, text: str) -> None:
        """Show a text in place of a bar, as much as fits on the line, if that is due."""
        if self.due:
            self._shown_at = time.monotonic()
            self._write(text[: line_width()] if self._live else text)

    def note(self, text: str) -> None:
        """Write a line that stays, above what is shown."""
        self._write(f'{text}\n' if self._live else text)

    def end(self, remark: str) -> None:
        """Replace the line by a last one."""
        self._write(remark)
        if self._live:
            sys.stderr.write('\n')

    def clear(self) -> None:
        """Take the line away from a terminal."""
        if self._live:
            self._write('')

    def _write(self, text: str) -> None:
        sys.stderr.write(f'\r\x1b[K{text}' if self._live else f'{text}\n')
        sys.stderr.flush()
