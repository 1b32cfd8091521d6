# SPDX-License-Identifier: Apache-2.0
"""Stubs of the bag analysis: fast, or killing their process."""

import csv
import os
import signal
from pathlib import Path

from soliton_linkage_nodes.messages.conversions import NamedChain

STATE = {
    'stamp [ns]': '5',
    'motion_name': 'flipper',
    'status': '2',
    'solitons': '1',
    'soliton_velocity [m/s]': '-0.5',
    'noise [rad]': '0.001',
}


def pretend(bag: Path, folder: Path, _given: NamedChain | None, _noise: float | None) -> int:
    """Write what an analysis would; the first time at some bags the worker is killed."""
    folder.mkdir(parents=True, exist_ok=True)
    deadly = bag.parent / f'{bag.name}.deadly'
    if deadly.exists():
        deadly.unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    if bag.name == 'bag_7':
        raise ValueError('bag_7 has no frame')
    with (folder / 'soliton_state.csv').open('w', newline='') as file:
        table = csv.DictWriter(file, STATE)
        table.writeheader()
        table.writerow(STATE)
    return 1
