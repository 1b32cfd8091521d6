# SPDX-License-Identifier: Apache-2.0
"""Read a bag into NumPy arrays, and print a pandas summary if pandas is installed.

Usage: bag_to_pandas.py [BAG]
"""

import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import soliton_linkage as sl
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.programs.bag_analysis import read_recording


def read(bag: Path) -> tuple[sl.Chain, sl.Recording, dict[str, np.ndarray]]:
    """Return the chain and motion of a bag, and the analyser output, one column per quantity."""
    with open_bag(bag) as reader:
        named, recording = read_recording(reader)
        states = [message for _, message in read_topic(reader, 'soliton_state')]
    seen = [state for state in states if state.solitons]
    stamps = [state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec for state in seen]
    columns = {
        'time [s]': np.array(stamps),
        'position [rotor spacings]': np.array([state.solitons[0].rotor for state in seen]),
        'velocity [m/s]': np.array([state.solitons[0].velocity for state in seen]),
        'kinetic energy [J]': np.array([state.energies.kinetic for state in seen]),
        'phase [rad]': np.array([state.cycle.phase for state in seen]),
    }
    return named.chain, recording, columns


def main(bag: Path) -> dict[str, np.ndarray]:
    """Print a summary of a bag and return the columns of its soliton states."""
    chain, recording, columns = read(bag)
    frames, rotors = recording.angles.shape
    print(f'{frames} frames of {rotors} rotors, a {chain.motion.value}')
    crossings = sl.find_crossings(chain, sl.follow(chain, recording))
    print('crossings [rotors/s]:', *(f'{crossing.site_rate:.2f}' for crossing in crossings))
    if find_spec('pandas'):
        import pandas

        print(pandas.DataFrame(columns).describe())
    return columns


if __name__ == '__main__':
    main(Path(sys.argv[1] if len(sys.argv) > 1 else 'bags/flipper_0'))
