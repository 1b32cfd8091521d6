# SPDX-License-Identifier: Apache-2.0
"""A recording has every received message, counts losses, and is finished properly."""

import json
import re
import shlex
import shutil
import signal
import sys
import threading
import time
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import Graph, values
from rclpy.serialization import serialize_message
from recordings import lost_in, messages_of, publish_frames
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from soliton_linkage_nodes.bags import recorder
from soliton_linkage_nodes.bags.metadata import gaps_in
from soliton_linkage_nodes.bags.reading import open_bag, read_topic
from soliton_linkage_nodes.bags.record.receiving_thread import ReceivingThread
from soliton_linkage_nodes.bags.record.subscriptions import RecordedSubscription
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.bags.recovery import check_bag, recover_bag
from soliton_linkage_nodes.messages.conversions import chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


def test_every_message_of_every_topic_is_recorded_unchanged(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    sent = {}
    for topic in interfaces.SUITE_TOPICS:
        publisher = graph.speak(topic)
        if topic is interfaces.JOINT_STATES:
            sent[topic.name] = publish_frames(publisher, named, 300)
        elif topic is not interfaces.DIAGNOSTICS:
            sent[topic.name] = [serialize_message(topic.type())]
            publisher.publish(sent[topic.name][0])
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held.keys() == {f'/{topic.name.lstrip("/")}' for topic in interfaces.SUITE_TOPICS}
    for topic, messages in sent.items():
        assert held[f'/{topic}'] == messages
    assert lost_in(tmp_path / 'run_0') == dict.fromkeys(held, 0)


def test_only_topics_of_its_namespace_are_recorded_and_reported(graph, tmp_path):
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')}, namespace='/lab')
    topic = interfaces.NUDGE
    graph.user.create_publisher(topic.type, 'nudge', topic.qos).publish(Float64(data=1.0))
    ours = graph.user.create_publisher(topic.type, '/lab/nudge', topic.qos)
    graph.until(lambda: ours.get_subscription_count() == 1, 'the recorder')
    ours.publish(Float64(data=2.0))
    reports = graph.reports('bag_recorder')
    graph.until(
        lambda: reports and '/lab/nudge' in values(reports[-1])['topics received'].split(),
        'a report of the topic',
    )
    assert values(reports[-1])['bag'] == str(tmp_path / 'run_0')
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held['/lab/nudge'] == [serialize_message(Float64(data=2.0))]
    assert '/nudge' not in held
    assert '/diagnostics' in held


def test_without_an_output_the_bag_is_named_by_date_and_time(graph, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    graph.stop(graph.start(BagRecorder))
    (bag,) = tmp_path.iterdir()
    assert re.fullmatch(r'recording_\d{4}(_\d\d){2}-\d\d(_\d\d){2}_0', bag.name)
    assert messages_of(bag).keys() >= {'/joint_states'}


def test_losses_are_counted_reported_and_stored_in_the_bag(graph, named, tmp_path, monkeypatch):
    drain = RecordedSubscription.drain
    entered, gate = threading.Event(), threading.Event()
    gate.set()

    def gated(subscription: RecordedSubscription) -> Any:
        if not gate.is_set():
            entered.set()
            gate.wait()
        return drain(subscription)

    monkeypatch.setattr(RecordedSubscription, 'drain', gated)
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    publisher = graph.speak(interfaces.JOINT_STATES)
    publish_frames(publisher, named, 1)
    graph.until(lambda: recorder.messages, 'the first frame')
    reports = graph.reports('bag_recorder')
    graph.until(lambda: reports and reports[-1].message == 'recording', 'a report')
    gate.clear()
    assert entered.wait(120)
    publish_frames(publisher, named, 6000)
    gate.set()
    graph.until(lambda: reports[-1].level == reports[-1].WARN, 'a warning')
    lost = int(values(reports[-1])['lost messages'])
    assert reports[-1].message == f'recording, {lost} messages lost'
    graph.stop(recorder)
    recorded = len(messages_of(tmp_path / 'run_0')['/joint_states'])
    assert lost == 6001 - recorded > 0
    assert lost_in(tmp_path / 'run_0')['/joint_states'] == lost


def test_a_signal_finishes_the_bag_with_all_that_was_sent(graph, start, named, tmp_path):
    bag = tmp_path / 'run'
    given = ['-p', f'output:={bag}']
    given += ['-p', 'topics:=[joint_states, chain]']
    program = start('bag_recorder', '--ros-args', *given)
    publisher = graph.speak(interfaces.JOINT_STATES)
    chain = graph.speak(interfaces.CHAIN)
    graph.next_report('bag_recorder')
    chain.publish(chain_to_msg(named, time_to_msg(0)))
    sent = publish_frames(publisher, named, 700)
    reports = graph.reports('bag_recorder')
    graph.until(lambda: reports and values(reports[-1])['messages'] == '701', 'the frames')
    assert program.stop(signal.SIGTERM) == 0
    assert messages_of(tmp_path / 'run_0')['/joint_states'] == sent
    assert lost_in(tmp_path / 'run_0')['/joint_states'] == 0
    assert re.search(rf'closed {bag}_0: 701 messages, 0 lost$', program.said[-1])


def test_messages_in_the_file_are_recovered_without_an_end_of_the_recorder(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    publisher = graph.speak(interfaces.JOINT_STATES)
    sent = publish_frames(publisher, named, 200)
    file = tmp_path / 'run_0/run_0_0.mcap'
    graph.until(lambda: sent[-1] in file.read_bytes(), 'the flush of the file')
    shutil.copytree(tmp_path / 'run_0', tmp_path / 'then_0')
    graph.stop(recorder)
    report, new = recover_bag(tmp_path / 'then_0', tmp_path / 'new')
    assert messages_of(new)['/joint_states'] == sent
    assert report.lost == 0


def test_an_account_of_the_recording_is_kept_in_the_bag(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(5)))
    graph.until(lambda: recorder.messages, 'the chain')
    graph.stop(recorder)
    with open_bag(tmp_path / 'run_0') as reader:
        custom = reader.custom_data
    told = json.loads(custom['chain'])['/chain']
    assert told['number_of_rotors'] == 8
    assert told['spacing'] == named.chain.spacing
    assert custom['suite_version'] == version('soliton_linkage_nodes')
    assert shlex.split(custom['command_line'])[1:] == sys.argv[1:]
    assert '/' not in shlex.split(custom['command_line'])[0]


@pytest.mark.parametrize('limit', [{'max_bag_size': 100_000}, {'max_bag_duration': 0.3}])
def test_a_bag_is_split_by_size_and_by_time(graph, named, tmp_path, limit):
    given = {'output': str(tmp_path / 'run'), **limit}
    recorder = graph.start(BagRecorder, given)
    publisher = graph.speak(interfaces.JOINT_STATES)
    sent = []
    for _ in range(10):
        sent += publish_frames(publisher, named, 100)
        time.sleep(0.1)
    graph.stop(recorder)
    files = sorted(path.name for path in (tmp_path / 'run_0').iterdir())
    assert files == ['metadata.yaml', *(f'run_0_{n}.mcap' for n in range(len(files) - 1))]
    assert len(files) - 1 >= 3
    assert messages_of(tmp_path / 'run_0')['/joint_states'] == sent
    assert check_bag(tmp_path / 'run_0').damage == []


def few(folder: Path) -> dict[str, Any]:
    """Parameters to record what the test alone sends."""
    return {'output': str(folder / 'run'), 'topics': ['chain', 'joint_states']}


def held_back(graph: Graph) -> str:
    """Return the number of buffered messages in the diagnostics."""
    return values(graph.next_report('bag_recorder'))['messages held back']


def call(graph: Graph, name: str) -> Any:
    return graph.call(Trigger, f'bag_recorder/{name}')


def test_a_bag_is_split_on_request(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, few(tmp_path))
    publisher = graph.speak(interfaces.JOINT_STATES)
    publish_frames(publisher, named, 10)
    graph.until(lambda: recorder.messages == 10, 'ten frames')
    assert call(graph, 'split_bagfile').success
    graph.until(lambda: values(graph.next_report('bag_recorder'))['files'] == '2', 'a file')
    publish_frames(publisher, named, 20)
    graph.stop(recorder)
    told = yaml.safe_load((tmp_path / 'run_0/metadata.yaml').read_text())
    files = told['rosbag2_bagfile_information']['files']
    assert [(file['path'], file['message_count']) for file in files] == [
        ('run_0_0.mcap', 10),
        ('run_0_1.mcap', 20),
    ]


def test_messages_during_a_pause_are_omitted_except_latched_ones(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, few(tmp_path))
    publisher = graph.speak(interfaces.JOINT_STATES)
    chain = graph.speak(interfaces.CHAIN)
    before = publish_frames(publisher, named, 10)
    graph.until(lambda: recorder.messages == 10, 'ten frames')
    assert not call(graph, 'is_paused').success
    assert call(graph, 'pause').success
    assert call(graph, 'is_paused').success
    publish_frames(publisher, named, 20)
    chain.publish(chain_to_msg(named, time_to_msg(5)))
    graph.until(lambda: held_back(graph) == '1', 'the chain')
    assert call(graph, 'resume').success
    graph.until(lambda: recorder.messages == 11, 'the chain')
    after = publish_frames(publisher, named, 30)
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held['/joint_states'] == before + after
    assert len(held['/chain']) == 1
    assert lost_in(tmp_path / 'run_0')['/joint_states'] == 0
    with open_bag(tmp_path / 'run_0') as reader:
        ((start, end),) = gaps_in(reader.custom_data)
        received = [stamp for stamp, _ in read_topic(reader, 'joint_states')]
    assert received[9] < start < end < received[10]


def test_each_service_logs_its_result_or_the_reason_of_a_rejection(graph, tmp_path, capfd):
    graph.start(BagRecorder, few(tmp_path))
    for name in ('pause', 'resume', 'split_bagfile', 'snapshot'):
        call(graph, name)
    said = re.findall(r'(?:rejected )?~/.*', capfd.readouterr().err)
    assert said == [
        '~/pause: paused until ~/resume',
        '~/resume: recording again, with 0 latched messages of the pause',
        '~/split_bagfile: the bag continues in a new file',
        'rejected ~/snapshot: parameter snapshot_duration of bag_recorder = 0 keeps no messages; '
        'set it above 0',
    ]


def test_a_snapshot_holds_buffered_and_latched_messages(graph, named, tmp_path):
    recorder = graph.start(BagRecorder, {**few(tmp_path), 'snapshot_duration': 3600.0})
    publisher = graph.speak(interfaces.JOINT_STATES)
    graph.speak(interfaces.CHAIN).publish(chain_to_msg(named, time_to_msg(5)))
    sent = publish_frames(publisher, named, 20)
    graph.until(lambda: held_back(graph) == '21', 'the frames')
    assert recorder.messages == 0
    assert call(graph, 'snapshot').success
    graph.until(lambda: recorder.messages == 21, 'the snapshot')
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held['/joint_states'] == sent
    assert len(held['/chain']) == 1


def test_a_recorder_that_cannot_start_leaves_nothing(graph, tmp_path, monkeypatch):
    def refuse(*_arguments: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(recorder, 'ReceivingThread', refuse)
    with pytest.raises(RuntimeError, match='new thread'):
        graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    assert list(tmp_path.iterdir()) == []


def test_the_report_is_recording_only_after_the_discovery_of_publishers(graph, tmp_path, said):
    reports = graph.reports('bag_recorder')
    graph.start(BagRecorder, few(tmp_path))
    states = {False: set(), True: set()}

    def has_recorded():
        announced = f'recording to {tmp_path}/run_0\n' in said()
        states[announced] |= {report.message for report in reports}
        reports.clear()
        return 'recording' in states[True]

    graph.until(has_recorded, 'the end of the discovery', lambda: states)
    assert states[False] == {'discovering publishers'}


def test_messages_in_transport_at_the_end_are_recorded(graph, tmp_path, monkeypatch):
    drain, settle = RecordedSubscription.drain, ReceivingThread.settle
    numbers, held_rounds, held = count(), iter(range(4)), threading.Event()

    def publish(messages):
        for _ in range(messages):
            publisher.publish(Float64(data=float(next(numbers))))

    def late(subscription):
        if not held.is_set():
            return drain(subscription)
        publish(1)
        return drain(subscription) if next(held_rounds, None) is None else []

    def stop(thread):
        graph.until(lambda: publish(1) or recorder.messages >= 5, 'a stream')
        held.set()
        publish(5)
        sent.extend(serialize_message(Float64(data=float(n))) for n in range(next(numbers)))
        settle(thread)

    sent = []
    monkeypatch.setattr(RecordedSubscription, 'drain', late)
    monkeypatch.setattr(ReceivingThread, 'settle', stop)
    recorder = graph.start(BagRecorder, {**few(tmp_path), 'topics': ['nudge']})
    publisher = graph.speak(interfaces.NUDGE)
    graph.stop(recorder)
    recorded = messages_of(tmp_path / 'run_0')['/nudge']
    assert set(sent) <= set(recorded)
