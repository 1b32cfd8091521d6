# SPDX-License-Identifier: Apache-2.0
"""Peak resident memory of processes of the suite."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import rclpy
from processes import node_command, raw_subscription, running, take_all, until
from wall_bag import write_wall_bag

from soliton_linkage_nodes.runtime import interfaces

FRAMES = 20
SPEED = 0.1
ANALYSE = """
import sys
from pathlib import Path
from soliton_linkage_nodes.programs.analyse_bag import main
main(sys.argv[1:])
print(Path('/proc/self/status').read_text())
"""


def simulator_memory(rotors: int) -> float:
    """Return the peak memory of a simulator with a moving soliton and a subscriber [B]."""
    node = rclpy.create_node('watcher')
    subscription = raw_subscription(node, interfaces.JOINT_STATES)
    taken = 0

    def received() -> bool:
        nonlocal taken
        taken += len(take_all(subscription))
        return taken >= FRAMES

    settings = {
        'chain.number_of_rotors': rotors,
        'initial_state': 'soliton',
        'initial_position': rotors / 2,
        'initial_velocity': SPEED,
    }
    with running(node_command('simulator', settings)) as simulator:
        until(received, f'{FRAMES} frames', simulator)
        status = Path(f'/proc/{simulator.pid}/status').read_text(encoding='ascii')
    node.destroy_node()
    return largest_resident(status)


def analyser_memory(rotors: int, frames: int, folder: Path) -> float:
    """Return the peak memory of `analyse_bag` on a bag with a number of frames [B]."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        bag = write_wall_bag(Path(name, 'wall'), rotors, frames, 'zstd')
        command = [sys.executable, '-c', ANALYSE, str(bag), '--output', name]
        ended = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return largest_resident(ended.stdout)


def largest_resident(status: str) -> float:
    """Return the peak memory in the status text of a process [B]."""
    found = re.search(r'VmHWM:\s+(\d+) kB', status)
    if found is None:
        raise ValueError(f'no VmHWM in {status[:100]!r}')
    return 1024.0 * int(found[1])
