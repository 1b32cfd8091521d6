# SPDX-License-Identifier: Apache-2.0
"""Analyse a bag of two gigabytes, and tell how long it took and how much memory it needed."""

from __future__ import annotations

import argparse
import resource
import shutil
import time
from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from soliton_linkage.chain import Chain
from soliton_linkage.cycle import Cycle
from soliton_linkage.progress import ProgressLine
from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.analyse_bag import analyse
from soliton_linkage_nodes.bag_writer import BagWriter
from soliton_linkage_nodes.bags import type_name
from soliton_linkage_nodes.conversions import (
    NamedChain,
    chain_to_msg,
    default_joint_names,
    time_to_msg,
)
from soliton_linkage_nodes.joint_state_buffer import JointStateBuffer

_ROTORS = 1000
_PERIOD = 4 * 10**6
_START = 10**18
_NOISE = 0.01
_ARC_PER_FRAME = 0.04


def write_bag(name: Path, size: float) -> tuple[Path, int]:
    """Write noisy frames of a wall on its way, until they are of a size; also how many."""
    chain = Chain(number_of_rotors=_ROTORS)
    named = NamedChain(chain, default_joint_names(_ROTORS))
    cycle, buffer, still = Cycle(chain), JointStateBuffer(named), np.zeros(_ROTORS)
    generator = np.random.default_rng(1)
    writer = BagWriter(name, 'mcap')
    told, joints = (
        writer.add_topic(f'/{topic.name}', type_name(topic.type), topic.qos)
        for topic in (interfaces.CHAIN, interfaces.JOINT_STATES)
    )
    writer.write(told, _START, serialize_message(chain_to_msg(named, time_to_msg(_START))))
    progress, frames = ProgressLine('writing', size), 0
    while frames * len(buffer) < size:
        stamp = _START + frames * _PERIOD
        angles = cycle.configuration(_ARC_PER_FRAME * frames)
        angles += _NOISE * generator.standard_normal(_ROTORS)
        writer.write(joints, stamp, buffer.write(stamp, angles, still, still))
        writer.tick()
        frames += 1
        progress.show(frames * len(buffer))
    writer.close()
    progress.end(f'{frames} frames of {_ROTORS} rotors, {frames * len(buffer) / 1e9:.2f} GB')
    return writer.path, frames


def main() -> None:
    """Write, analyse and report; the bag is removed in the end."""
    parser = argparse.ArgumentParser(prog='large_bag', description=__doc__)
    parser.add_argument('--size', type=float, default=2.0, help='of the bag [GB]')
    parser.add_argument('--output', type=Path, default=Path('out/large_bag'), help='folder')
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    bag, frames = write_bag(options.output / 'large', 1e9 * options.size)
    begin = time.monotonic()
    analyse(bag, options.output, None, None)
    seconds = time.monotonic() - begin
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f'{1e3 * seconds / frames:.2f} ms a frame, {seconds:.0f} s; {resident:.2f} GB resident')
    shutil.rmtree(bag)


if __name__ == '__main__':
    main()
