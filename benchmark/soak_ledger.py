# SPDX-License-Identifier: Apache-2.0
"""Ledger of the soak test: JSON lines that are written immediately.

Every entry has a `time` [s] since the start of the test, in which interruptions do not count. It
also has a `kind`, and values that depend on the kind.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

Entry = dict[str, Any]


class Ledger:
    """Entries of a soak test, in a file that survives a kill of this process."""

    def __init__(self, path: Path) -> None:
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
        """Time since the start of the test [s]."""
        return time.time() - self._begun

    def since(self, stamp: int) -> float:
        """Convert a stamp [ns] to the time since the start of the test [s]."""
        return stamp * 1e-9 - self._begun

    def note(self, kind: str, **what: Any) -> Entry:
        """Add an entry with the current time."""
        entry = {'time': round(self.now, 3), 'kind': kind, **what}
        self.entries.append(entry)
        self._file.write(json.dumps(entry) + '\n')
        self._file.flush()
        return entry

    def of(self, kind: str) -> list[Entry]:
        """Return all entries of a kind."""
        return [entry for entry in self.entries if entry['kind'] == kind]
