# SPDX-License-Identifier: Apache-2.0
"""A long run is judged by its records: kills explain their own losses, and no others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from soak_page import slope, verdicts, write_page
from soak_records import BagAudit, Ledger

from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.runtime import interfaces

MILLISECOND = 10**6


def frame(stamp: int) -> bytes:
    """A message that begins as joint states of a stamp [ns] do."""
    seconds, nanoseconds = divmod(stamp, 10**9)
    return bytes(4) + seconds.to_bytes(4, 'little') + nanoseconds.to_bytes(4, 'little') + bytes(8)


def test_a_slope_is_that_of_all_lives_within_its_error():
    chance = np.random.default_rng(1)
    times = np.arange(0.0, 600.0, 5.0)
    lives = [
        (times + 700 * life, 100 * life + times / 360 + chance.normal(0, 0.3, len(times)))
        for life in range(4)
    ]
    grown = slope(lives)
    assert abs(grown.value - 10) < 3 * grown.error < 3
    assert not grown.is_flat
    still = slope([(t, v - t / 360) for t, v in lives])
    assert still.is_flat
    assert np.isnan(slope([]).value)


@pytest.mark.parametrize('missing', [[], [40, 41, 42]])
def test_frames_that_are_missing_in_files_are_found(tmp_path, missing):
    writer = BagWriter(tmp_path / 'life')
    topic = writer.add_topic('/joint_states', 'sensor_msgs/msg/JointState', interfaces.CHAIN.qos)
    for number in range(100):
        if number == 50:
            writer.split()
        if number not in missing:
            writer.write(topic, number, frame(5 * MILLISECOND + number * MILLISECOND))
    audit = BagAudit(writer.path, 1000.0)
    audit.read(ended=False)
    assert audit.messages['/joint_states'] == 50 - len(missing)
    writer.close({'lost_messages': '{"/joint_states": 3}'})
    audit.read(ended=True)
    assert audit.messages['/joint_states'] == 100 - len(missing)
    assert audit.gaps == ([(39, 43)] if missing else [])
    assert audit.last == 99
    assert (audit.lost, audit.damage) == (3, [])
    assert not list(writer.path.glob('*.mcap'))


def noted(folder: Path, **changes: Any) -> Ledger:
    """A day of two minutes in which the simulator and the recorder were killed."""
    ledger = Ledger(folder / 'ledger.jsonl')
    bag = {'messages': {'/joint_states': 1000}, 'gaps': [], 'damage': [], 'lost': 0}
    for number, node in enumerate(('simulator', 'bag_recorder')):
        ledger.note('start', node=node, life=number)
    entries: list[dict[str, Any]] = [
        {'kind': 'kill', 'node': 'simulator', 'life': 0, 'time': 60.0},
        {'kind': 'kill', 'node': 'bag_recorder', 'life': 1, 'time': 100.0},
        {**bag, 'kind': 'bag', 'life': 1, 'killed': True, 'last': 99.9, 'time': 101.0, **changes},
        {'kind': 'report', 'node': 'simulator', 'energy drift': 1e-9, 'time': 110.0},
    ]
    ledger.entries += entries
    return ledger


def test_losses_without_a_kill_are_reported(tmp_path):
    for changes, complaints in [
        ({}, 0),
        ({'gaps': [[59.9, 63.0]]}, 0),
        ({'gaps': [[80.0, 80.1]]}, 1),
        ({'last': 98.0}, 1),
        ({'lost': 3}, 1),
        ({'damage': ['it was not finished: there is no index']}, 0),
        ({'damage': ['bytes 10 to 20 are damaged']}, 1),
    ]:
        judged = verdicts(noted(tmp_path, **changes))
        assert sum(not good for _, good in judged) == complaints


def test_a_run_continues_after_a_truncated_line(tmp_path):
    ledger = Ledger(tmp_path / 'ledger.jsonl')
    ledger.note('nudge')
    with (tmp_path / 'ledger.jsonl').open('a', encoding='utf-8') as file:
        file.write('{"time": 3.5, "kin')
    again = Ledger(tmp_path / 'ledger.jsonl')
    again.note('nudge')
    assert len(Ledger(tmp_path / 'ledger.jsonl').of('nudge')) == 2
    assert again.now >= ledger.entries[0]['time']


def test_the_page_is_one_file(tmp_path):
    text = write_page(tmp_path, noted(tmp_path)).read_text(encoding='utf-8')
    assert 'data:image/png;base64,' in text
    assert '1000 frames recorded, 0 gaps' in text
