# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders in any sound layout are read, checked and recovered whole."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import pytest
from recordings import change_metadata, contents
from rosbag2_bags import Layout, write_files
from std_msgs.msg import String

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag
from soliton_linkage_nodes.runtime.interfaces import Topic, reliable_qos

DATA = b'\x00\x01\x00\x00\x02\x00\x00\x00a\x00'
Held = list[tuple[str, int]]


def write_bag(folder: Path, splits: Sequence[Held], storage: str = 'mcap', first: int = 0) -> Path:
    """A bag whose splits are numbered from `first` on."""
    layout = Layout(storage, chunk_size=100, first=first)
    parts = [[(name, stamp, DATA) for name, stamp in split] for split in splits]
    return write_files(folder, layout, parts, 'std_msgs/msg/String')


def log_ahead(data: Path, first: int) -> None:
    """Move messages from a time on to the write-ahead log, as a killed recorder leaves them."""
    with closing(sqlite3.connect(data, isolation_level=None)) as database:
        database.execute('PRAGMA journal_mode = WAL')
        database.execute(
            'CREATE TEMP TABLE late AS SELECT * FROM messages WHERE timestamp >= ?', (first,)
        )
        database.execute('DELETE FROM messages WHERE timestamp >= ?', (first,))
        database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        database.execute('INSERT INTO messages SELECT * FROM late')
        # Closing the database empties the log.
        kept = {path: path.read_bytes() for path in (data, data.with_name(f'{data.name}-wal'))}
    for path, content in kept.items():
        path.write_bytes(content)


def held(path: Path) -> Held:
    return [(name, stamp) for name, stamp, _ in contents(path)]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_splits_that_overlap_in_time_are_merged(tmp_path, storage):
    splits = [[('/a', 10), ('/b', 30)], [('/b', 50), ('/a', 60)], [('/a', 20), ('/a', 40)]]
    bag = write_bag(tmp_path / 'run', splits, storage)
    expected = sorted((each for split in splits for each in split), key=lambda each: each[1])
    assert held(bag) == expected
    _, new = recover_bag(bag, tmp_path / 'new')
    assert held(new) == expected


def test_deleted_splits_of_a_circular_recording_are_no_damage(tmp_path):
    splits: list[Held] = [[('/a', 30)], [('/a', 40), ('/a', 50)]]
    bags = [write_bag(tmp_path / f'run_{first}', splits, first=first) for first in (7, 0)]
    for bag in bags:
        change_metadata(bag, message_count=7)
    report = check_bag(bags[0])
    assert (report.damage, report.messages, report.lost) == ([], 3, 0)
    assert report.notes == ['older splits with 4 messages were deleted when recording']
    assert check_bag(bags[1]).damage == ['metadata.yaml lists 4 more messages than the files']


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_an_empty_storage_name_follows_from_the_suffix(tmp_path, storage):
    bag = write_bag(tmp_path / 'run', [[('/a', 10)]], storage)
    change_metadata(bag, storage_identifier='')
    assert held(bag) == [('/a', 10)]
    assert check_bag(bag).damage == []


def test_a_topic_may_have_any_name(tmp_path):
    for number, name in enumerate(['chatter', '~/x', 'a name', '//x', '']):
        for storage in ('mcap', 'sqlite3'):
            folder = tmp_path / f'{storage}_{number}'
            bag = write_bag(folder, [[(name, 10), ('/b', 20)]], storage)
            assert held(bag) == [(name, 10), ('/b', 20)]
            assert (check_bag(bag).damage, check_bag(bag).messages) == ([], 2)
            _, new = recover_bag(bag, tmp_path / 'new')
            assert held(new) == [(name, 10), ('/b', 20)]


def test_messages_in_a_write_ahead_log_are_read_and_the_bag_is_unchanged(graph, tmp_path):
    messages = [('/a', stamp) for stamp in range(101)]
    bag = write_bag(tmp_path / 'run', [messages], 'sqlite3')
    log_ahead(bag / 'run_0.db3', 50)
    before = {path: path.read_bytes() for path in bag.iterdir()}
    assert bag / 'run_0.db3-wal' in before
    assert held(bag) == messages
    assert (check_bag(bag).damage, check_bag(bag).messages) == ([], 101)
    _, new = recover_bag(bag, tmp_path / 'new')
    assert held(new) == messages
    heard = graph.hear(Topic('a', String, reliable_qos(200)))
    player = graph.start(BagPlayer, {'bag': str(bag), 'wait_for': ['a']})
    graph.until(lambda: player.finished and len(heard) == 101, 'the end', lambda: len(heard))
    assert {path: path.read_bytes() for path in bag.iterdir()} == before


def test_stamps_before_1970_are_read_and_counted_once_as_lost_when_recovered(tmp_path):
    messages = [('/a', stamp) for stamp in range(-60, 41)]
    bag = write_bag(tmp_path / 'run', [messages], 'sqlite3')
    assert held(bag) == messages
    report, new = recover_bag(bag, tmp_path / 'new')
    assert (report.messages, report.lost) == (41, 60)
    assert held(new) == messages[60:]
    bag = write_bag(tmp_path / 'old', [messages[:60]], 'sqlite3')
    with pytest.raises(ValueError, match=r'nothing can be recovered .* 60 messages'):
        recover_bag(bag, tmp_path / 'none')
    assert not (tmp_path / 'none_0').exists()
