# SPDX-License-Identifier: Apache-2.0
"""The programs `recover_bag` and `check_bag`, run as processes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from programs import Program
from recordings import run_of, write_bag

from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.messages.conversions import NamedChain


def test_a_whole_bag_is_reported_as_whole(
    start: Callable[..., Program], named: NamedChain, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 50))
    program = start('check_bag', str(bag))
    assert program.wait() == 0
    said = program.said
    assert said[0] == f'{bag}: mcap, run_0_0.mcap'
    assert said[1] == '52 messages in 0.050 s'
    assert '  /joint_states  sensor_msgs/msg/JointState  50' in said
    assert 'lost when recorded: unknown' in said
    assert said[-1] == 'complete'


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_cut_bag_is_recovered_beside_it(
    start: Callable[..., Program], named: NamedChain, tmp_path: Path, storage: str
) -> None:
    bag = write_bag(tmp_path / 'run', run_of(named, 500), storage)
    (data,) = (path for path in bag.iterdir() if path.suffix != '.yaml')
    data.write_bytes(data.read_bytes()[:100_000])
    checked = start('check_bag', str(bag))
    assert checked.wait() == 1
    assert checked.said[-1].startswith(f'damaged; recover_bag {bag} writes')
    program = start('recover_bag', str(bag))
    assert program.wait() == 0
    with open_bag(tmp_path / 'run_0_recovered_0') as reader:
        count = reader.message_count
        assert 'damage' in reader.storage.metadata.custom
    assert 100 < count < 500
    assert program.said[-1].startswith(f'recovered {count} messages')
    lost = re.search(r', (\d+) lost into', program.said[-1])
    again = start('check_bag', str(tmp_path / 'run_0_recovered_0'))
    assert again.wait() == 1
    assert again.said[-1] == 'complete'
    told = f'lost by damage before recovery: {lost[1] if lost else "an unknown number"} ('
    assert again.said[-2].startswith(told)
    assert again.said[-2].endswith('; when recorded: unknown')


@pytest.mark.parametrize('program', ['recover_bag', 'check_bag'])
def test_a_path_without_a_bag_is_reported_in_one_line(
    start: Callable[..., Program], tmp_path: Path, program: str
) -> None:
    started = start(program, str(tmp_path / 'nowhere'))
    assert started.wait() == 1
    (line,) = started.said
    assert line == (
        f"{program}: bag '{tmp_path}/nowhere' does not exist; give the path of a bag directory"
    )
