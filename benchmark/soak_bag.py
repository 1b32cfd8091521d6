# SPDX-License-Identifier: Apache-2.0
"""Reads the files of a recorder that goes on, one after the other, and what is missing in them."""

from __future__ import annotations

import json
import struct
from collections import Counter
from pathlib import Path
from typing import Any

from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS
from soliton_linkage_nodes.bags.storages.mcap_recovery import RecoveredMcap

STAMP = struct.Struct('<4xiI')
FRAMES = '/joint_states'


class BagAudit:
    """Counts what a recorder has written, and removes each file that it has read.

    Frames are a period apart by their stamps; where they are not, some are missing. Stamps of a
    simulator that cannot keep pace fall behind the clock: what is told are times of receipt.
    """

    def __init__(self, folder: Path, rate: float) -> None:
        self.folder = folder
        self.messages: Counter[str] = Counter()
        self.gaps: list[tuple[int, int]] = []
        """When the frames before and behind each place came where some are missing [ns]."""
        self.damage: list[str] = []
        self.lost = 0
        """Messages that the recorder says that it has lost."""
        self.last = 0
        """When the last frame came [ns]."""
        self._stamp = 0
        self._period = round(1e9 / rate)

    def read(self, ended: bool) -> None:
        """Read the files that are finished, or all of a recorder that has ended."""
        files = sorted(self.folder.glob('*.mcap'), key=lambda path: int(path.stem.split('_')[-1]))
        for path in files if ended else files[:-1]:
            self._read_file(path)
            path.unlink()

    def told(self) -> dict[str, Any]:
        """What was found, for the ledger."""
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
