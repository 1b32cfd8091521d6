# SPDX-License-Identifier: Apache-2.0
"""The identified chain is a valid parameter file; an unusable bag is reported."""

import sys
from pathlib import Path

import numpy as np
import pytest
from joint_frames import frame_of
from recordings import START, write_bag

from soliton_linkage.linkage.chain import Array
from soliton_linkage_nodes.bags.guards import DEFAULT_LIMITS
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.messages.chain_source import chain_of_file
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.programs.identify_chain import main, read_joints
from soliton_linkage_nodes.runtime import interfaces

sys.path.append(str(Path(__file__).parents[2] / 'physics'))

from passages import SPINNER, passage, read, unequal

MADE = unequal(SPINNER, 4)
JOINTS = tuple(f'arm_{n}' for n in range(10))
PERIOD = 4 * 10**6


def bag_of(folder: Path, angles: Array) -> Path:
    named = NamedChain(MADE, JOINTS)
    entries = []
    for number, frame in enumerate(angles):
        stamp = START + number * PERIOD
        entries.append((interfaces.JOINT_STATES, stamp, frame_of(named, frame, stamp)))
    return write_bag(folder / 'run', entries)


def test_a_bag_becomes_a_file_that_nodes_take(tmp_path, capsys):
    readings, offsets = read(passage(MADE), 1)
    bag = bag_of(tmp_path, readings)
    folder = tmp_path / 'found'
    main([str(bag), '--output', str(folder), '--spacing', '0.1'])
    named = chain_of_file(folder / 'chain.yaml')
    assert named.joint_names == JOINTS
    assert named.chain.spacings.mean() == pytest.approx(0.1)
    scale = MADE.spacings.mean() / 0.1
    np.testing.assert_allclose(
        scale * named.chain.rotor_lengths[1:-1], MADE.rotor_lengths[1:-1], rtol=0.06
    )
    np.testing.assert_allclose(named.encoder_offsets, offsets, atol=0.03)
    for name in ('lengths.csv', 'identification.png', 'identification.pdf', 'identification.txt'):
        assert (folder / name).stat().st_size > 100, name
    said = capsys.readouterr()
    assert 'noisiest bonds' in said.out


def test_all_frames_of_the_selected_time_of_a_long_bag_are_kept(tmp_path):
    with open_bag(bag_of(tmp_path, passage(MADE, 200)), DEFAULT_LIMITS) as reader:
        readings = read_joints(reader, None, (0.1, 0.35), 80).readings()
    np.testing.assert_allclose(readings.times, 0.004 * np.arange(len(readings.times)), atol=1e-9)
    assert readings.times[-1] == pytest.approx(0.248)


def test_a_recording_without_a_chain_is_reported_in_one_line(tmp_path, capsys):
    bag = bag_of(tmp_path, np.tile(passage(MADE, 2)[:1], (50, 1)))
    with pytest.raises(SystemExit) as end:
        main([str(bag), '--output', str(tmp_path / 'found')])
    assert str(end.value).startswith('identify_chain: no soliton passes in this recording')
    assert not (tmp_path / 'found').exists()
    with pytest.raises(SystemExit, match='0 of 50 frames lie between --begin 1 s and --end inf s'):
        main([str(bag), '--output', str(tmp_path / 'found'), '--begin', '1'])
