# SPDX-License-Identifier: Apache-2.0
"""What a long day of the suite leaves behind: lines of JSON that are there as soon as they happen.

Every entry has its `time` [s] since the day began, over all its parts where it was gone on with,
its `kind` and what belongs to that.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

Entry = dict[str, Any]


class Ledger:
    """The entries of a day, in a file that outlives who writes it."""

    def __init__(self, path: Path) -> None:
        """Go on with what a file holds; a line that was cut by a kill is left out."""
        self.entries: list[Entry] = []
        if path.exists():
            for line in path.read_text(encoding='utf-8').splitlines():
                try:
                    self.entries.append(json.loads(line))
                except json.JSONDecodeError:
                    continue
        self._file = path.open('a', encoding='utf-8')
        self._file.write('\n' * bool(self.entries))
        self._begun = time.time() - (self.entries[-1]['time'] if self.entries else 0.0)

    @property
    def now(self) -> float:
        """Time since the day began [s]."""
        return time.time() - self._begun

    def since(self, stamp: int) -> float:
        """A stamp [ns] as time of this day [s]."""
        return stamp * 1e-9 - self._begun

    def note(self, kind: str, **what: Any) -> Entry:
        """Add an entry of this moment."""
        entry = {'time': round(self.now, 3), 'kind': kind, **what}
        self.entries.append(entry)
        self._file.write(json.dumps(entry) + '\n')
        self._file.flush()
        return entry

    def of(self, kind: str) -> list[Entry]:
        """All entries of a kind."""
        return [entry for entry in self.entries if entry['kind'] == kind]
