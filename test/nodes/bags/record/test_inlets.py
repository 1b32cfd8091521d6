# SPDX-License-Identifier: Apache-2.0
"""Topics are found by name and pattern; every publisher is received."""

import signal

import pytest
from geometry_msgs.msg import PoseStamped
from programs import Program
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message
from recordings import messages_of
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import Image
from std_msgs.msg import Float64

from soliton_linkage_msgs.msg import Delivery
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.runtime import interfaces


def test_topics_are_found_by_name_and_pattern_with_the_type_of_the_graph(graph, tmp_path):
    given = {
        'output': str(tmp_path / 'run'),
        'topics': ['nudge', '/camera/image'],
        'regex': '^/arm/',
        'exclude_regex': 'raw$',
    }
    recorder = graph.start(BagRecorder, given)
    reports = []

    def waits_for_picture():
        reports.append(graph.next_report('bag_recorder'))
        return reports[-1].message == 'recording, waiting for /camera/image'

    graph.until(waits_for_picture, 'the report')
    assert reports[-1].level == reports[-1].WARN
    publishers = {}
    for name, kind in {
        '/camera/image': Image,
        '/arm/pose': PoseStamped,
        '/arm/raw': Float64,
        '/leg/pose': PoseStamped,
    }.items():
        publishers[name] = graph.user.create_publisher(kind, name, 10)
    chosen = [publishers['/camera/image'], publishers['/arm/pose']]
    graph.until(lambda: all(p.get_subscription_count() for p in chosen), 'the recorder')
    image, pose = Image(height=2, data=b'ab'), PoseStamped()
    pose.pose.position.x = 3.0
    publishers['/camera/image'].publish(image)
    publishers['/arm/pose'].publish(pose)
    graph.until(lambda: recorder.messages == 2, 'both messages')
    graph.stop(recorder)
    with AnyReader([tmp_path / 'run_0']) as reader:
        types = {c.topic: c.msgtype for c in reader.connections}
        held = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
    assert types == {
        '/nudge': 'std_msgs/msg/Float64',
        '/camera/image': 'sensor_msgs/msg/Image',
        '/arm/pose': 'geometry_msgs/msg/PoseStamped',
    }
    assert bytes(held['/camera/image'].data) == b'ab'
    assert held['/arm/pose'].pose.position.x == 3.0


def test_a_pattern_adds_to_the_suite(graph, tmp_path):
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'regex': '^/arm/'})
    publisher = graph.user.create_publisher(Float64, '/arm/force', 10)
    graph.until(publisher.get_subscription_count, 'the recorder')
    graph.stop(recorder)
    suite = {f'/{topic.name.lstrip("/")}' for topic in interfaces.SUITE_TOPICS}
    assert messages_of(tmp_path / 'run_0').keys() == {*suite, '/arm/force'}


def test_a_pattern_that_is_none_is_named(graph, tmp_path):
    said = r"parameter regex of bag_recorder = '\(' is not a regular expression: "
    with pytest.raises(ValueError, match=said):
        graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'regex': '('})
    assert list(tmp_path.iterdir()) == []


def test_the_last_latched_message_before_the_recording_and_all_later_ones_are_kept(
    graph, tmp_path
):
    publisher = interfaces.DELIVERY.publisher(graph.user)
    for count in range(5):
        publisher.publish(Delivery(impulses=count))
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    graph.until(lambda: recorder.messages, 'the last of them')
    for count in range(5, 500):
        publisher.publish(Delivery(impulses=count))
    graph.until(lambda: recorder.messages >= 496, 'those since')
    graph.stop(recorder)
    said = messages_of(tmp_path / 'run_0')['/delivery']
    assert [deserialize_message(each, Delivery).impulses for each in said] == list(range(4, 500))


def test_a_recorder_that_stood_still_has_every_delivery_of_that_time(graph, tmp_path):
    publisher = interfaces.DELIVERY.publisher(graph.user)
    arguments = ['--ros-args', '-p', f'output:={tmp_path / "run"}']
    recorder = Program('bag_recorder', arguments, graph.domain, tmp_path / 'log')
    try:
        graph.until(publisher.get_subscription_count, 'the recorder')
        recorder.process.send_signal(signal.SIGSTOP)
        torques = [0.0] * 1000
        for count in range(500):
            publisher.publish(Delivery(impulses=count, impulse_of_torques=torques))
        recorder.process.send_signal(signal.SIGCONT)
        assert publisher.wait_for_all_acked(Duration(seconds=240))
    finally:
        recorder.stop()
    said = messages_of(tmp_path / 'run_0')['/delivery']
    assert [deserialize_message(each, Delivery).impulses for each in said] == list(range(500))
