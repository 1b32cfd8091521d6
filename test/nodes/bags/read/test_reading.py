# SPDX-License-Identifier: Apache-2.0
"""A bag returns the written messages; an invalid bag is reported on one line."""

import re
import time
from pathlib import Path

import pytest
import yaml
from recordings import MILLISECOND, START, data_file, run_of, write_bag
from rosbags.rosbag2 import Reader
from std_srvs.srv import Trigger

from soliton_linkage_nodes.bags import reading as bags
from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.stored_topic import profiles_in
from soliton_linkage_nodes.runtime import interfaces


@pytest.fixture(params=['mcap', 'sqlite3'])
def storage(request):
    return str(request.param)


def test_a_bag_has_the_form_of_rosbag2_and_is_named_for_ros2_bag_reindex(named, tmp_path):
    path = write_bag(tmp_path / 'run', run_of(named, 3))
    assert path == tmp_path / 'run_0'
    metadata = yaml.safe_load((path / 'metadata.yaml').read_text())
    information = metadata['rosbag2_bagfile_information']
    assert list(information) == [
        'version',
        'storage_identifier',
        'duration',
        'starting_time',
        'message_count',
        'topics_with_message_count',
        'compression_format',
        'compression_mode',
        'relative_file_paths',
        'files',
        'custom_data',
        'ros_distro',
    ]
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['run_0_0.mcap']
    assert information['message_count'] == 5
    assert information['duration']['nanoseconds'] == 3 * MILLISECOND
    assert information['starting_time']['nanoseconds_since_epoch'] == START
    with Reader(path) as reader:
        assert reader.message_count == 5


def test_nothing_is_overwritten(named, tmp_path):
    first = write_bag(tmp_path / 'run', run_of(named, 3))
    before = {path: path.read_bytes() for path in first.iterdir()}
    second = write_bag(tmp_path / 'run', run_of(named, 5))
    assert (first.name, second.name) == ('run_0', 'run_1')
    names = {path.name for path in second.iterdir()}
    assert names == {'metadata.yaml', 'run_1_0.mcap'}
    assert {path: path.read_bytes() for path in first.iterdir()} == before


def test_the_quality_of_service_is_kept(named, storage, tmp_path):
    path = write_bag(tmp_path / 'run', run_of(named, 3), storage)
    with open_bag(path) as reader:
        for topic in (interfaces.CHAIN, interfaces.JOINT_STATES, interfaces.NUDGE):
            stored = bags.find_topic(reader, topic.name)
            (profile,) = profiles_in(stored.profiles)
            assert profile['reliability'] in ('reliable', 1)
            latched = profile['durability'] in ('transient_local', 1)
            assert latched == topic.latched == bool(stored.latched_depth)
            assert profile['depth'] == topic.qos.depth


def test_type_hashes_are_those_of_ros(graph, tmp_path):
    writer = BagWriter(tmp_path / 'run')
    for topic in interfaces.SUITE_TOPICS:
        connection = writer.add_topic(topic.name, bags.type_name(topic.type), topic.qos)
        graph.user.create_publisher(topic.type, topic.name, topic.qos)
        graph.until(
            lambda t=topic: graph.user.get_publishers_info_by_topic(t.name),
            f'a publisher of {topic.name}',
        )
        (publisher,) = graph.user.get_publishers_info_by_topic(topic.name)
        assert connection.digest == str(publisher.topic_type_hash)
    writer.close({})


def test_an_empty_bag_can_be_read_and_begins_when_it_was_made(tmp_path):
    before = time.time_ns()
    path = write_bag(tmp_path / 'run', [])
    metadata = yaml.safe_load((path / 'metadata.yaml').read_text())
    begin = metadata['rosbag2_bagfile_information']['starting_time']['nanoseconds_since_epoch']
    assert before <= begin <= time.time_ns()
    with open_bag(path) as reader:
        assert reader.message_count == 0


def halve(data: Path) -> None:
    data.write_bytes(data.read_bytes()[: data.stat().st_size // 2])


@pytest.mark.parametrize(
    'spoil',
    [
        lambda bag: [part.unlink() for part in bag.iterdir()],
        lambda bag: data_file(bag).unlink(),
        lambda bag: data_file(bag).write_bytes(b''),
        lambda bag: halve(data_file(bag)),
        lambda bag: (bag / 'metadata.yaml').write_bytes(b'\xff\xfe: ['),
        lambda bag: (bag / 'metadata.yaml').write_text(''),
        lambda bag: (bag / 'metadata.yaml').write_text(
            'rosbag2_bagfile_information: {version: 99}'
        ),
    ],
    ids=['all', 'no data', 'empty data', 'half', 'garbled', 'empty metadata', 'version'],
)
def test_unreadable_files_are_named_in_one_line(named, storage, tmp_path, spoil):
    path = write_bag(tmp_path / 'run', run_of(named, 200), storage)
    spoil(path)
    bag = re.escape(f'bag {str(path)!r} ')
    said = rf'^{bag}(cannot be read: \S|has no ).*[Gg]ive a .*directory'
    with pytest.raises(ValueError, match=said) as refusal, open_bag(path):
        pass
    assert '\n' not in str(refusal.value)


def test_a_bag_that_was_not_finished_is_named_with_the_remedy(named, storage, tmp_path):
    path = write_bag(tmp_path / 'run', run_of(named, 20), storage)
    (path / 'metadata.yaml').unlink()
    said = rf"^bag '{path}' cannot be read: it has no metadata.yaml. .* recover_bag {path}$"
    with pytest.raises(ValueError, match=said), open_bag(path):
        pass


def test_a_damaged_file_is_closed(named, tmp_path):
    bag = write_bag(tmp_path / 'run', run_of(named, 5), 'sqlite3')
    data = data_file(bag)
    data.write_bytes(b'no table' * 1000)
    with pytest.raises(ValueError, match='not a database'), open_bag(bag):
        pass
    held = [file.readlink() for file in Path('/proc/self/fd').iterdir() if file.is_symlink()]
    assert data not in held


def test_a_bag_that_cannot_be_made_is_named_with_the_remedy(tmp_path):
    for name in ['file/bag', 'file/deep/bag', 'x' * 300]:
        (tmp_path / 'file').write_text('not a directory')
        said = r"^bag '.*(bag_0|xxx)' cannot be written: .*; choose another output$"
        with pytest.raises(OSError, match=said):
            BagWriter(tmp_path / name)


def test_topics_are_found_in_any_namespace(named, tmp_path):
    for asked in ['joint_states', '/joint_states', '/lab/joint_states']:
        path = write_bag(tmp_path / 'run', run_of(named, 2), namespace='/lab')
        with open_bag(path) as reader:
            assert bags.find_topic(reader, asked).name == '/lab/joint_states'


def test_the_full_name_distinguishes_topics_of_one_name(named, tmp_path):
    writer = BagWriter(tmp_path / 'run')
    for name in ('/a/joint_states', '/b/joint_states'):
        writer.add_topic(name, 'sensor_msgs/msg/JointState', interfaces.JOINT_STATES.qos)
    writer.close({})
    with open_bag(writer.path) as reader:
        assert bags.find_topic(reader, '/b/joint_states').name == '/b/joint_states'
        said = r"has 2 topics 'joint_states': /a/joint_states, /b/joint_states; give the full name"
        with pytest.raises(ValueError, match=said):
            bags.find_topic(reader, 'joint_states')


def test_a_topic_that_is_not_there_is_named_with_those_that_are(named, tmp_path):
    path = write_bag(tmp_path / 'run', run_of(named, 2)[:1])
    with open_bag(path) as reader:
        said = r"has no topic 'joint_states', it contains /nudge; record it with bag_recorder"
        with pytest.raises(ValueError, match=said):
            bags.find_topic(reader, 'joint_states')


def test_types_are_found_by_their_name():
    for topic in interfaces.SUITE_TOPICS:
        assert bags.message_class(bags.type_name(topic.type)) is topic.type


def test_a_type_that_is_not_installed_is_named_with_the_right_remedy():
    for name, reason in [
        ('nothing_msgs/msg/Nothing', "is not installed; install its package 'nothing_msgs'"),
        ('std_msgs/msg/Nothing', "is not in the installed package 'std_msgs'; install"),
        ('std_msgs/String', 'is not PACKAGE/KIND/TYPE as in ROS 2'),
        ('', 'is not PACKAGE/KIND/TYPE as in ROS 2'),
    ]:
        with pytest.raises(ValueError, match=f"message type '{name}' {reason}"):
            bags.message_class(name)


def test_the_events_of_a_service_have_a_class():
    assert bags.message_class('std_srvs/srv/Trigger_Event') is Trigger.Event


@pytest.mark.parametrize('name', ['none', 'notes.txt'])
def test_a_path_without_a_bag_is_named(tmp_path, name):
    (tmp_path / 'notes.txt').write_text('no bag')
    said = (
        re.escape(f'bag {str(tmp_path / name)!r} ') + '(does not exist|has no .mcap or .db3 file)'
    )
    with pytest.raises(ValueError, match=said), open_bag(tmp_path / name):
        pass
