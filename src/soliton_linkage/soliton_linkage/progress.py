# SPDX-License-Identifier: Apache-2.0
"""A line in the terminal that shows how far something has come."""

from __future__ import annotations

import sys
import time

_WIDTH = 30
"""Of the bar [characters]."""
_TERMINAL_INTERVAL = 0.1
"""Least time from line to line where the line is rewritten [s]: it does not flicker."""
_LOG_INTERVAL = 2.0
"""Least time from line to line where each stays [s]."""


class ProgressLine:
    """Rewrites one line of a terminal in place; where there is none, writes a line at times."""

    def __init__(self, title: str, total: float, bar_of_place: bool = False) -> None:
        """Prepare to show how much of a total is done, or where on the way something is."""
        self.total = total
        self._title = title
        self._bar_of_place = bar_of_place
        self._live = sys.stderr.isatty()
        self._interval = _TERMINAL_INTERVAL if self._live else _LOG_INTERVAL
        self._shown_at = time.monotonic() - self._interval

    def show(self, done: float, remark: str = '') -> None:
        """Show how much is done, if the last time was not just now."""
        now = time.monotonic()
        if now - self._shown_at < self._interval:
            return
        self._shown_at = now
        share = min(max(done / self.total, 0.0), 1.0) if self.total else 0.0
        if self._bar_of_place:
            place = round(share * (_WIDTH - 1))
            self._write(f'{self._title} [{">" * place}O{"<" * (_WIDTH - 1 - place)}] {remark}')
        else:
            filled = round(share * _WIDTH)
            bar = '#' * filled + '.' * (_WIDTH - filled)
            self._write(f'{self._title} [{bar}] {share:4.0%} {remark}')

    def end(self, remark: str) -> None:
        """Replace the line by a last one."""
        self._write(remark)
        if self._live:
            sys.stderr.write('\n')

    def _write(self, text: str) -> None:
        sys.stderr.write(f'\r\x1b[K{text}' if self._live else f'{text}\n')
        sys.stderr.flush()
