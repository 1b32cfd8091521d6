# SPDX-License-Identifier: Apache-2.0
"""Independent readers read every written message."""

import os
import random
from pathlib import Path

import pytest
import yaml
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.qos import HistoryPolicy, QoSProfile
from rclpy.serialization import serialize_message
from recordings import START, run_of
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64

from soliton_linkage_msgs.msg import Soliton, SolitonState
from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.recovery import check_bag
from soliton_linkage_nodes.messages.conversions import NamedChain
from soliton_linkage_nodes.runtime import interfaces

Sent = list[tuple[str, int, bytes]]


def write(name: Path, named: NamedChain, compression: str = 'none') -> Sent:
    """Write a bag of many chunks and return its messages."""
    writer = BagWriter(name, compression)
    topics = {}
    sent = []
    for number, (topic, stamp, message) in enumerate(run_of(named, 300)):
        full_name = f'/{topic.name}'
        if full_name not in topics:
            topics[full_name] = writer.add_topic(full_name, type_name(topic.type), topic.qos)
        sent.append((full_name, stamp, serialize_message(message)))
        writer.write(topics[full_name], stamp, sent[-1][2])
        if number % 20 == 0:
            writer.flush()
    writer.close({'key': 'value'})
    return sent


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_the_mcap_package_agrees(named, tmp_path, compression):
    sent = write(tmp_path / 'run', named, compression)
    with (tmp_path / 'run_0/run_0_0.mcap').open('rb') as file:
        reader = SeekingReader(file, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        read = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in reader.iter_messages()
        ]
        summary = reader.get_summary()
        file.seek(0)
        in_file_order = [m.data for _, _, m in NonSeekingReader(file).iter_messages()]
    assert read == sent
    assert in_file_order == [data for _, _, data in sent]
    assert summary.statistics.message_count == len(sent)
    assert summary.statistics.message_start_time == START
    assert summary.statistics.message_end_time == sent[-1][1]
    assert {c.topic for c in summary.channels.values()} == {topic for topic, _, _ in sent}
    if compression == 'zstd':
        assert {index.compression for index in summary.chunk_indexes} == {'zstd'}


def test_the_mcap_ros2_support_package_decodes_our_messages(tmp_path):
    writer = BagWriter(tmp_path / 'run')
    topic = interfaces.SOLITON_STATE
    stored = writer.add_topic('/soliton_state', type_name(topic.type), topic.qos)
    state = SolitonState(motion_name='spinner', solitons=[Soliton(rotor=7.25, velocity=-0.5)])
    writer.write(stored, START, serialize_message(state))
    writer.close()
    with (tmp_path / 'run_0/run_0_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        ((_, _, _, message),) = reader.iter_decoded_messages()
    assert message.motion_name == 'spinner'
    assert (message.solitons[0].rotor, message.solitons[0].velocity) == (7.25, -0.5)


def test_a_bag_of_several_files_lists_the_content_of_each(named, tmp_path):
    writer = BagWriter(tmp_path / 'run')
    topic = interfaces.NUDGE
    stored = writer.add_topic('/nudge', type_name(topic.type), topic.qos)
    serialized = serialize_message(topic.type(data=1.0))
    for number in range(10):
        if number in (2, 6):
            writer.split()
        writer.write(stored, START + number, serialized)
    assert (writer.files, writer.messages) == (3, 10)
    writer.close()
    told = yaml.safe_load((writer.path / 'metadata.yaml').read_text())
    information = told['rosbag2_bagfile_information']
    assert [file['message_count'] for file in information['files']] == [2, 4, 4]
    assert [f['starting_time']['nanoseconds_since_epoch'] for f in information['files']] == [
        START,
        START + 2,
        START + 6,
    ]
    assert information['duration'] == {'nanoseconds': 9}
    for path, count in zip(information['relative_file_paths'], (2, 4, 4), strict=True):
        with Reader(writer.path / path) as reader:
            assert reader.message_count == count


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_messages_of_any_size_are_written(tmp_path, compression):
    sizes = [10, 3 * 2**20, 7, 700_000, 700_000, 0, 2**20, 5]
    chance = random.Random(1)
    sent = [(START + n, chance.randbytes(size)) for n, size in enumerate(sizes)]
    writer = BagWriter(tmp_path / 'run', compression)
    stored = writer.add_topic('/x', 'std_msgs/msg/String', interfaces.NUDGE.qos)
    for message in sent:
        writer.write(stored, *message)
    assert writer.messages == len(sent)
    writer.close()
    with Reader(writer.path) as reader:
        assert [(stamp, bytes(data)) for _, stamp, data in reader.messages()] == sent


def test_a_bag_continues_in_a_new_file_at_the_largest_size(tmp_path):
    largest, size = 100_000, 500
    writer = BagWriter(tmp_path / 'run', largest_file=largest)
    topic = writer.add_topic('/nudge', 'std_msgs/msg/Float64', interfaces.NUDGE.qos)
    sent = [(START + number, number.to_bytes(size, 'big')) for number in range(1000)]
    for message in sent:
        writer.write(topic, *message)
    writer.close({})
    told = yaml.safe_load((writer.path / 'metadata.yaml').read_text())
    counts = [file['message_count'] for file in told['rosbag2_bagfile_information']['files']]
    *full, last = counts
    assert sum(full) + last == 1000
    assert len(full) >= 5
    assert all(0.9 * largest < count * size <= largest for count in full)
    with Reader(writer.path) as reader:
        assert [(stamp, bytes(data)) for _, stamp, data in reader.messages()] == sent


def test_a_bag_continues_in_a_new_file_at_the_longest_duration(tmp_path):
    writer = BagWriter(tmp_path / 'run', longest_file=1.0)
    stored = writer.add_topic('/x', 'std_msgs/msg/String', interfaces.NUDGE.qos)
    for n in range(35):
        writer.write(stored, START + n * 10**8, b'')
    writer.close()
    told = yaml.safe_load((writer.path / 'metadata.yaml').read_text())
    files = told['rosbag2_bagfile_information']['files']
    assert [file['message_count'] for file in files] == [10, 10, 10, 5]


def test_a_file_that_is_never_written_to_is_whole(tmp_path):
    writer = BagWriter(tmp_path / 'run')
    writer.split()
    writer.close()
    with Reader(writer.path) as reader:
        assert list(reader.messages()) == []


def test_topics_may_be_added_while_it_is_written(tmp_path):
    writer = BagWriter(tmp_path / 'run', largest_file=2000)
    for number in range(12):
        stored = writer.add_topic(f'/n{number}', 'std_msgs/msg/Float64', interfaces.NUDGE.qos)
        writer.write(stored, START + number, serialize_message(interfaces.NUDGE.type(data=1.0)))
        writer.flush()
    writer.close()
    with Reader(writer.path) as reader:
        assert [c.topic for c, _, _ in reader.messages()] == [f'/n{n}' for n in range(12)]


def test_the_history_of_a_publisher_may_be_unknown(tmp_path):
    writer = BagWriter(tmp_path / 'run')
    qos = QoSProfile(depth=0, history=HistoryPolicy.UNKNOWN)
    writer.add_topic('/x', 'std_msgs/msg/Float64', qos, interfaces.NUDGE.qos)
    writer.close()
    told = yaml.safe_load((writer.path / 'metadata.yaml').read_text())
    (topic,) = told['rosbag2_bagfile_information']['topics_with_message_count']
    profiles = topic['topic_metadata']['offered_qos_profiles']
    assert [profile['history'] for profile in profiles] == ['unknown', 'keep_last']


def test_a_type_of_which_nothing_is_known_is_named(tmp_path):
    writer = BagWriter(tmp_path / 'run')
    said = "message type 'nothing_msgs/msg/Nothing' has no definition on this machine"
    with pytest.raises(ValueError, match=said):
        writer.add_topic('/x', 'nothing_msgs/msg/Nothing', interfaces.NUDGE.qos)
    writer.close()


def test_an_unknown_compression_is_rejected(tmp_path):
    with pytest.raises(ValueError, match="compression 'lz4' is unknown; use none or zstd"):
        BagWriter(tmp_path / 'run', 'lz4')
    assert not list(tmp_path.iterdir())


def test_a_file_is_not_synchronised_if_that_is_disabled(tmp_path, monkeypatch):
    def refuse(descriptor: int) -> None:
        assert not Path(f'/proc/self/fd/{descriptor}').resolve().is_file()

    monkeypatch.setattr(os, 'fdatasync', refuse)
    writer = BagWriter(tmp_path / 'run', flush_interval=0.0, sync_interval=0.0)
    topic = writer.add_topic('/nudge', 'std_msgs/msg/Float64', interfaces.NUDGE.qos)
    for number in range(200):
        writer.write(topic, number, serialize_message(Float64(data=1.0)))


def test_a_topic_is_in_the_file_as_soon_as_it_is_added(tmp_path):
    writer = BagWriter(tmp_path / 'run', flush_interval=1e9)
    writer.add_topic('/nudge', 'std_msgs/msg/Float64', interfaces.NUDGE.qos)
    assert [topic.name for topic in check_bag(writer.path).counts] == ['/nudge']
    writer.close()


def test_a_bag_that_cannot_be_begun_leaves_nothing(tmp_path, monkeypatch):
    def refuse(path: Path, _codec: str) -> None:
        path.write_bytes(b'begun')
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('soliton_linkage_nodes.bags.record.bag_writer.McapWriter', refuse)
    with pytest.raises(OSError, match='No space left'):
        BagWriter(tmp_path / 'run')
    assert list(tmp_path.iterdir()) == []
