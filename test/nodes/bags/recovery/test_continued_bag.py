# SPDX-License-Identifier: Apache-2.0
"""A restarted recorder continues the bag of a killed recorder."""

import json
from pathlib import Path

from rclpy.serialization import serialize_message
from recordings import START, Entry, messages_of, run_of, write_bag
from rosbags.rosbag2 import Reader
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.reading import type_name
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter, UnfinishedBag
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.bags.recovery import check_bag, take_over, unfinished_bag
from soliton_linkage_nodes.runtime import interfaces

LATER = 10**9


def record(name: Path, entries: list[Entry], begun: UnfinishedBag | None = None) -> BagWriter:
    """Write a bag as far as the system has it, and leave it as a kill would."""
    writer = BagWriter(name, flush_interval=0.0, begun=begun)
    for topic, stamp, message in entries:
        stored = writer.add_topic(f'/{topic.name}', type_name(topic.type), topic.qos)
        writer.write(stored, stamp, serialize_message(message))
    writer.flush()
    return writer


def test_a_bag_that_was_cut_short_twice_is_one_whole_bag(named, tmp_path):
    name = tmp_path / 'run'
    first, *others = [
        [(topic, stamp + part * LATER, message) for topic, stamp, message in run_of(named, 20)]
        for part in range(3)
    ]
    writers = [record(name, first)]
    for part in others:
        unfinished = unfinished_bag(name)
        assert unfinished == tmp_path / 'run_0'
        writers.append(record(name, part, take_over(unfinished)))
    writers[-1].close()
    assert unfinished_bag(name) is None
    assert {path.name for path in tmp_path.iterdir()} == {'run_0'}
    assert len(messages_of(tmp_path / 'run_0')['/joint_states']) == 60
    report = check_bag(tmp_path / 'run_0')
    assert report.damage == []
    assert report.messages == writers[-1].messages == 66
    with Reader(tmp_path / 'run_0') as reader:
        gaps = json.loads(reader.storage.metadata.custom['gaps'])
    assert [begin for begin, _ in gaps] == [START + 20 * 10**6, START + LATER + 20 * 10**6]
    assert all(begin < end for begin, end in gaps)


def test_a_finished_bag_is_left_alone(named, tmp_path):
    record(tmp_path / 'run', run_of(named, 2)).close()
    assert unfinished_bag(tmp_path / 'run') is None
    assert unfinished_bag(tmp_path / 'other') is None


def test_a_bag_of_another_storage_or_without_content_is_not_continued(named, tmp_path):
    write_bag(tmp_path / 'run', run_of(named, 2), 'sqlite3')
    assert take_over(tmp_path / 'run_0') is None
    (tmp_path / 'empty').mkdir()
    assert take_over(tmp_path / 'empty') is None


def test_a_recorder_appends_where_it_is_asked_to(graph, named, tmp_path):
    record(tmp_path / 'run', run_of(named, 20))
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'append': True})
    assert recorder.messages == 22
    nudge = graph.speak(interfaces.NUDGE)
    nudge.publish(Float64(data=7.0))
    graph.until(lambda: recorder.messages > 22, 'the nudge')
    graph.stop(recorder)
    assert len(messages_of(tmp_path / 'run_0')['/nudge']) == 2
    assert check_bag(tmp_path / 'run_0').damage == []
