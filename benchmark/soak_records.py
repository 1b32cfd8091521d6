# SPDX-License-Identifier: Apache-2.0
"""Records of the soak test: check of the recorded files, and the ledger.

Every entry of the ledger has a `time` [s] since the start of the test, in which interruptions do
not count. It also has a `kind`, and values that depend on the kind.
"""

from __future__ import annotations

import json
import struct
import time
from collections import Counter
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS
from soliton_linkage_nodes.bags.storages.mcap_recovery import RecoveredMcap

STAMP = struct.Struct('<4xiI')
FRAMES = '/joint_states'


class BagAudit:
    """Counter of recorded messages; it removes each file after reading.

    A frame is missing if two stamps differ by more than a period. Times are times of receipt,
    because the stamps of a simulator that is slower than real time fall behind the clock.
    """

    def __init__(self, folder: Path, rate: float) -> None:
        self.folder = folder
        self.messages: Counter[str] = Counter()
        self.gaps: list[tuple[int, int]] = []
        """Times of receipt of the frames before and after each gap [ns]."""
        self.damage: list[str] = []
        self.lost = 0
        """Number of lost messages that the recorder reported."""
        self.last = 0
        """Time of receipt of the last frame [ns]."""
        self._stamp = 0
        self._period = round(1e9 / rate)

    def read(self, ended: bool) -> None:
        """Read the finished files, or all files of a recorder that has ended."""
        files = sorted(self.folder.glob('*.mcap'), key=lambda path: int(path.stem.split('_')[-1]))
        for path in files if ended else files[:-1]:
            self._read_file(path)
            path.unlink()

    def entry(self) -> dict[str, Any]:
        """Return the result for the ledger."""
        return {
            'messages': dict(self.messages),
            'gaps': self.gaps,
            'damage': self.damage,
            'lost': self.lost,
            'last': self.last,
        }

    def _read_file(self, path: Path) -> None:
        file = RecoveredMcap(path, False, DEFAULT_LIMITS)
        for topic, (_, _, received, _, data) in file.messages():
            self.messages[topic.name] += 1
            if topic.name == FRAMES:
                self._take_frame(received, data)
        self.damage += file.damage
        losses = json.loads(file.custom_data.get('lost_messages', '{}'))
        self.lost = max(self.lost, sum(losses.values()))

    def _take_frame(self, received: int, data: bytes) -> None:
        seconds, nanoseconds = STAMP.unpack_from(data)
        stamp = seconds * 10**9 + nanoseconds
        if self._stamp and not 0 < stamp - self._stamp < 1.5 * self._period:
            self.gaps.append((self.last, received))
        self._stamp, self.last = stamp, received


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
