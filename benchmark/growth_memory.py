# SPDX-License-Identifier: Apache-2.0
"""Peak resident memory of processes of the suite."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import rclpy
from processes import node_command, running
from wall_bag import write_wall_bag

from soliton_linkage_nodes.runtime import interfaces

FRAMES = 20
SPEED = 0.1
LONGEST_WAIT = 120.0
POLL = 0.01
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
    topic = interfaces.JOINT_STATES
    subscription = node.create_subscription(
        topic.type, topic.name, lambda _: None, topic.qos, raw=True
    )
    handle, taken = subscription.handle, 0
    settings = {
        'chain.number_of_rotors': rotors,
        'initial_state': 'soliton',
        'initial_position': rotors / 2,
        'initial_velocity': SPEED,
    }
    with running(node_command('simulator', settings)) as simulator:
        deadline = time.monotonic() + LONGEST_WAIT
        with handle:
            while taken < FRAMES:
                taken += handle.take_message(topic.type, True) is not None
                if time.monotonic() > deadline or simulator.poll() is not None:
                    raise TimeoutError(f'{taken} frames after {LONGEST_WAIT:g} s')
                time.sleep(POLL)
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
