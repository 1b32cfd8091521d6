# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders in any sound layout are read, checked and recovered whole."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import pytest
import yaml
from mcap.writer import Writer
from std_msgs.msg import String

from soliton_linkage_nodes.bags.player import BagPlayer
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag
from soliton_linkage_nodes.runtime.interfaces import Topic, reliable_qos

DATA = b'\x00\x01\x00\x00\x02\x00\x00\x00a\x00'
Held = list[tuple[str, int]]


def write_sqlite(path: Path, messages: Held, logged: int = 0) -> None:
    """A file of rosbag2; the last `logged` messages are in the write-ahead log beside it."""
    numbers = {name: number for number, name in enumerate(dict(messages), 1)}
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute('PRAGMA journal_mode = WAL')
        database.execute(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
            'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)'
        )
        database.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
            'timestamp INTEGER NOT NULL, data BLOB NOT NULL)'
        )
        for name, number in numbers.items():
            row = (number, name, 'std_msgs/msg/String', 'cdr', '')
            database.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?)', row)
        for position, (name, stamp) in enumerate(messages):
            if position == len(messages) - logged:
                database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
            row = (numbers[name], stamp, DATA)
            database.execute('INSERT INTO messages VALUES (NULL, ?, ?, ?)', row)
        kept = {each: each.read_bytes() for each in path.parent.glob(f'{path.name}*')}
    if logged:
        # Closing the database empties the log; a killed recorder leaves both files.
        for each, content in kept.items():
            if not each.name.endswith('-shm'):
                each.write_bytes(content)


def write_mcap(path: Path, messages: Held) -> None:
    with path.open('wb') as file:
        writer = Writer(file, chunk_size=100)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channels = {name: writer.register_channel(name, 'cdr', schema) for name, _ in messages}
        for name, stamp in messages:
            writer.add_message(channels[name], stamp, DATA, stamp)
        writer.finish()


def write_bag(
    folder: Path,
    splits: Sequence[Held],
    suffix: str = '.mcap',
    first: int = 0,
    deleted: int = 0,
    storage: str | None = None,
) -> Path:
    """A bag whose splits are numbered from `first` on; it counts `deleted` messages more."""
    folder.mkdir()
    files = []
    for number, messages in enumerate(splits, first):
        path = folder / f'{folder.name}_{number}{suffix}'
        (write_mcap if suffix == '.mcap' else write_sqlite)(path, messages)
        files.append({'path': path.name, 'message_count': len(messages)})
    count = sum(map(len, splits)) + deleted
    information = {
        'version': 9,
        'storage_identifier': {'.mcap': 'mcap', '.db3': 'sqlite3'}[suffix],
        'duration': {'nanoseconds': 1},
        'starting_time': {'nanoseconds_since_epoch': 1},
        'message_count': count,
        'topics_with_message_count': [],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [each['path'] for each in files],
        'files': files,
    }
    if storage is not None:
        information['storage_identifier'] = storage
    text = yaml.safe_dump({'rosbag2_bagfile_information': information})
    (folder / 'metadata.yaml').write_text(text)
    return folder


def held(path: Path) -> Held:
    with open_bag(path) as reader:
        found = [(each.name, stamp) for each, stamp, _ in reader.messages(reader.topics)]
        assert reader.message_count == len(found)
    return found


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_splits_that_overlap_in_time_are_merged(tmp_path, suffix):
    splits = [[('/a', 10), ('/b', 30)], [('/b', 50), ('/a', 60)], [('/a', 20), ('/a', 40)]]
    bag = write_bag(tmp_path / 'run', splits, suffix)
    expected = sorted((each for split in splits for each in split), key=lambda each: each[1])
    assert held(bag) == expected
    _, new = recover_bag(bag, tmp_path / 'new')
    assert held(new) == expected


def test_deleted_splits_of_a_circular_recording_are_no_damage(tmp_path):
    splits: list[Held] = [[('/a', 30)], [('/a', 40), ('/a', 50)]]
    report = check_bag(write_bag(tmp_path / 'run', splits, first=7, deleted=4))
    assert (report.damage, report.messages, report.lost) == ([], 3, 0)
    assert report.notes == ['older splits with 4 messages were deleted when recording']
    report = check_bag(write_bag(tmp_path / 'begun', splits, deleted=4))
    assert report.damage == ['metadata.yaml lists 4 more messages than the files']


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_an_empty_storage_name_follows_from_the_suffix(tmp_path, suffix):
    bag = write_bag(tmp_path / 'run', [[('/a', 10)]], suffix, storage='')
    assert held(bag) == [('/a', 10)]
    assert check_bag(bag).damage == []


def test_a_topic_may_have_any_name(tmp_path):
    for number, name in enumerate(['chatter', '~/x', 'a name', '//x', '']):
        for suffix in ('.mcap', '.db3'):
            bag = write_bag(tmp_path / f'run_{number}{suffix}', [[(name, 10), ('/b', 20)]], suffix)
            assert held(bag) == [(name, 10), ('/b', 20)]
            assert (check_bag(bag).damage, check_bag(bag).messages) == ([], 2)
            _, new = recover_bag(bag, tmp_path / 'new')
            assert held(new) == [(name, 10), ('/b', 20)]


def test_messages_in_a_write_ahead_log_are_read_and_the_bag_is_unchanged(graph, tmp_path):
    messages = [('/a', stamp) for stamp in range(101)]
    bag = write_bag(tmp_path / 'run', [messages], '.db3')
    (bag / 'run_0.db3').unlink()
    write_sqlite(bag / 'run_0.db3', messages, 51)
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
    bag = write_bag(tmp_path / 'run', [messages], '.db3')
    assert held(bag) == messages
    report, new = recover_bag(bag, tmp_path / 'new')
    assert (report.messages, report.lost) == (41, 60)
    assert held(new) == messages[60:]
    bag = write_bag(tmp_path / 'old', [messages[:60]], '.db3')
    with pytest.raises(ValueError, match=r'nothing can be recovered .* 60 messages'):
        recover_bag(bag, tmp_path / 'none')
    assert not (tmp_path / 'none_0').exists()
