# SPDX-License-Identifier: Apache-2.0
"""Every chunk has messages and a message index, which some rosbag2 readers require."""

from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import ChunkIndex
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.storages.mcap_recovery import RecoveredMcap
from soliton_linkage_nodes.bags.storages.mcap_writer import McapWriter
from soliton_linkage_nodes.bags.storages.storage import Message
from soliton_linkage_nodes.bags.stored_topic import StoredTopic, type_definition

RECORDINGS = sorted(Path(__file__).resolve().parents[4].glob('bags/*/*.mcap'))


def topic(number: int) -> StoredTopic:
    definition, digest = type_definition('std_msgs/msg/Float64')
    told = ('std_msgs/msg/Float64', definition, 'ros2msg', digest, '')
    return StoredTopic(number, f'/n{number}', *told)


@pytest.fixture
def writer(tmp_path):
    """A writer of a topic that is already in the file."""
    made = McapWriter(tmp_path / 'x.mcap')
    made.add_topic(topic(1))
    made.flush()
    return made


def message(number: int) -> bytes:
    return serialize_message(Float64(data=float(number)))


def chunks_of(path: Path) -> list[ChunkIndex]:
    with path.open('rb') as file:
        summary = SeekingReader(file, validate_crcs=True).get_summary()
    assert summary is not None
    return summary.chunk_indexes


def in_file_order(path: Path) -> list[tuple[str, int]]:
    with path.open('rb') as file:
        read = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time) for _, channel, message in read]


@pytest.mark.parametrize('codec', ['', 'zstd'])
def test_every_chunk_has_messages_however_long_topics_are_silent(tmp_path, codec):
    path = tmp_path / 'x.mcap'
    writer = McapWriter(path, codec, definitions_interval=0.0)
    for number in (1, 2):
        writer.add_topic(topic(number))
        writer.flush()
    for stamp in (10, 20, 30):
        writer.flush()
        writer.write(2, stamp, message(stamp))
        writer.flush()
    writer.add_topic(topic(3))
    writer.flush()
    writer.write(3, 40, message(40))
    writer.close('')
    chunks = chunks_of(path)
    spans = [(each.message_start_time, each.message_end_time) for each in chunks]
    assert spans == [(10, 10), (20, 20), (30, 30), (40, 40)]
    assert all(each.message_index_length and each.message_index_offsets for each in chunks)
    assert in_file_order(path) == [('/n2', 10), ('/n2', 20), ('/n2', 30), ('/n3', 40)]


def test_every_chunk_of_the_recordings_of_the_suite_has_messages():
    for path in RECORDINGS:
        assert all(each.message_index_length for each in chunks_of(path))


def test_without_any_message_there_is_no_chunk(tmp_path):
    path = tmp_path / 'x.mcap'
    writer = McapWriter(path)
    writer.add_topic(topic(1))
    writer.close('')
    assert chunks_of(path) == []
    assert in_file_order(path) == []


def test_topics_that_were_silent_till_a_kill_are_known(writer, tmp_path):
    path = tmp_path / 'x.mcap'
    size = path.stat().st_size
    writer.flush()
    assert path.stat().st_size == size
    rescued = RecoveredMcap(path)
    assert rescued.topics == {1: topic(1)}
    writer.write(1, 10, message(10))
    writer.flush()
    assert list(RecoveredMcap(path).messages()) == [(topic(1), Message(1, 0, 10, 10, message(10)))]
    writer.abandon()


def test_a_chunk_defines_its_messages_without_the_head_of_the_file(writer, tmp_path):
    path = tmp_path / 'x.mcap'
    begin = path.stat().st_size
    writer.write(1, 10, message(10))
    writer.flush()
    writer.abandon()
    whole = path.read_bytes()
    path.write_bytes(bytes(begin) + whole[begin:])
    assert list(RecoveredMcap(path).messages()) == [(topic(1), Message(1, 0, 10, 10, message(10)))]
