# SPDX-License-Identifier: Apache-2.0
"""A recording holds every message as it came, says what was lost, and is finished properly."""

from __future__ import annotations

import json
import re
import resource
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from graphs import Graph, values
from programs import Program
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from recordings import frame_message
from std_msgs.msg import Float64

from soliton_linkage_nodes import interfaces
from soliton_linkage_nodes.bag_recorder import BagRecorder
from soliton_linkage_nodes.bags import open_bag, read_messages, read_topic
from soliton_linkage_nodes.conversions import NamedChain, chain_to_msg, time_to_msg
from soliton_linkage_nodes.inlets import Inlet

STORAGES = ('mcap', 'sqlite3')


def messages_of(bag: Path) -> dict[str, list[bytes]]:
    """Return the serialized messages of each topic of a bag."""
    with open_bag(bag) as reader:
        held: dict[str, list[bytes]] = {connection.topic: [] for connection in reader.connections}
        for connection, _, serialized in read_messages(reader, reader.connections):
            held[connection.topic].append(serialized)
    return held


def lost_in(bag: Path) -> dict[str, int]:
    with open_bag(bag) as reader:
        return json.loads(reader.storage.metadata.custom['lost_messages'])


def publish_frames(publisher: Publisher, named: NamedChain, frames: int) -> list[bytes]:
    """Publish frames and return them as they were sent."""
    sent = [serialize_message(frame_message(named, number)) for number in range(frames)]
    for message in sent:
        publisher.publish(message)
    return sent


@pytest.mark.parametrize('storage', STORAGES)
def test_every_message_of_every_topic_is_recorded_as_it_came(
    graph: Graph, named: NamedChain, tmp_path: Path, storage: str
) -> None:
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'storage': storage})
    sent = {}
    for topic in interfaces.SUITE:
        publisher = graph.speak(topic)
        if topic is interfaces.JOINT_STATES:
            sent[topic.name] = publish_frames(publisher, named, 300)
        elif topic is not interfaces.DIAGNOSTICS:
            sent[topic.name] = [serialize_message(topic.type())]
            publisher.publish(sent[topic.name][0])
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held.keys() == {f'/{topic.name.lstrip("/")}' for topic in interfaces.SUITE}
    for topic, messages in sent.items():
        assert held[f'/{topic}'] == messages
    assert lost_in(tmp_path / 'run_0') == dict.fromkeys(held, 0)


def test_the_chain_is_recorded_though_it_was_published_before(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
    topic = interfaces.CHAIN
    publisher = graph.user.create_publisher(topic.type, topic.name, topic.qos)
    publisher.publish(chain_to_msg(named, time_to_msg(5)))
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    graph.until(lambda: recorder.messages, 'the chain')
    graph.stop(recorder)
    with open_bag(tmp_path / 'run_0') as reader:
        ((_, message),) = read_topic(reader, 'chain')
    assert message == chain_to_msg(named, time_to_msg(5))


def test_topics_of_another_namespace_are_not_recorded(graph: Graph, tmp_path: Path) -> None:
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')}, namespace='/lab')
    topic = interfaces.NUDGE
    graph.user.create_publisher(topic.type, 'nudge', topic.qos).publish(Float64(data=1.0))
    ours = graph.user.create_publisher(topic.type, '/lab/nudge', topic.qos)
    graph.until(lambda: ours.get_subscription_count() == 1, 'the recorder')
    ours.publish(Float64(data=2.0))
    graph.stop(recorder)
    held = messages_of(tmp_path / 'run_0')
    assert held['/lab/nudge'] == [serialize_message(Float64(data=2.0))]
    assert '/nudge' not in held
    assert '/diagnostics' in held


def test_only_the_topics_that_are_asked_for_are_recorded(graph: Graph, tmp_path: Path) -> None:
    given = {'output': str(tmp_path / 'run'), 'topics': ['chain', '/nudge']}
    graph.stop(graph.start(BagRecorder, given))
    assert messages_of(tmp_path / 'run_0').keys() == {'/chain', '/nudge'}


def test_without_an_output_the_bag_is_named_by_date_and_time(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    graph.stop(graph.start(BagRecorder))
    (bag,) = tmp_path.iterdir()
    assert re.fullmatch(r'recording_\d{4}(_\d\d){2}-\d\d(_\d\d){2}_0', bag.name)
    assert messages_of(bag).keys() >= {'/joint_states'}


def test_a_second_recording_leaves_the_first_as_it_is(graph: Graph, tmp_path: Path) -> None:
    for _ in range(2):
        graph.stop(graph.start(BagRecorder, {'output': str(tmp_path / 'run')}))
    assert {path.name for path in tmp_path.iterdir()} == {'run_0', 'run_1'}


def test_what_is_lost_is_counted_reported_and_kept_in_the_bag(
    graph: Graph, named: NamedChain, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drain = Inlet.drain
    entered, gate = threading.Event(), threading.Event()
    gate.set()

    def gated(inlet: Inlet) -> Any:
        if not gate.is_set():
            entered.set()
            gate.wait()
        return drain(inlet)

    monkeypatch.setattr(Inlet, 'drain', gated)
    recorder = graph.start(BagRecorder, {'output': str(tmp_path / 'run')})
    publisher = graph.speak(interfaces.JOINT_STATES)
    publish_frames(publisher, named, 1)
    graph.until(lambda: recorder.messages, 'the first frame')
    reports = graph.reports('bag_recorder')
    graph.until(lambda: reports, 'a report')
    assert reports[-1].message == 'recording'
    gate.clear()
    assert entered.wait(10)
    publish_frames(publisher, named, 1500)
    gate.set()
    graph.until(lambda: reports[-1].level == reports[-1].WARN, 'a warning')
    lost = int(values(reports[-1])['lost messages'])
    assert reports[-1].message == f'recording, {lost} messages lost'
    graph.stop(recorder)
    recorded = len(messages_of(tmp_path / 'run_0')['/joint_states'])
    assert lost == 1501 - recorded > 0
    assert lost_in(tmp_path / 'run_0')['/joint_states'] == lost


def test_a_report_names_the_bag_and_the_topics_that_are_heard(
    graph: Graph, named: NamedChain, tmp_path: Path
) -> None:
    given = {'output': str(tmp_path / 'run'), 'topics': ['chain', 'joint_states', 'nudge']}
    recorder = graph.start(BagRecorder, given, namespace='/lab')
    topic = interfaces.JOINT_STATES
    publisher = graph.user.create_publisher(topic.type, '/lab/joint_states', topic.qos)
    graph.until(publisher.get_subscription_count, 'the recorder')
    publish_frames(publisher, named, 10)
    graph.until(lambda: recorder.messages == 10, 'the frames')
    figures = values(graph.next_report('bag_recorder'))
    assert figures['bag'] == str(tmp_path / 'run_0')
    assert figures['messages'] == '10'
    assert figures['topics heard'] == '/lab/joint_states'


@pytest.mark.parametrize('parameter', ['outptu', 'topic'])
def test_an_unknown_parameter_begins_no_bag(
    graph: Graph, tmp_path: Path, parameter: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=f"parameter '{parameter}' of bag_recorder is unknown"):
        graph.start(BagRecorder, {parameter: 'run'})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('storage', 'number'), [('mcap', signal.SIGINT), ('sqlite3', signal.SIGTERM)]
)
def test_a_signal_finishes_the_bag_with_all_that_was_sent(
    graph: Graph,
    start: Callable[..., Program],
    named: NamedChain,
    tmp_path: Path,
    storage: str,
    number: signal.Signals,
) -> None:
    bag = tmp_path / 'run'
    program = start(
        'bag_recorder', '--ros-args', '-p', f'output:={bag}', '-p', f'storage:={storage}'
    )
    publisher = graph.speak(interfaces.JOINT_STATES)
    chain = graph.speak(interfaces.CHAIN)
    graph.next_report('bag_recorder')
    chain.publish(chain_to_msg(named, time_to_msg(0)))
    sent = publish_frames(publisher, named, 700)
    reports = graph.reports('bag_recorder')
    graph.until(lambda: reports and int(values(reports[-1])['messages']) > 700, 'the frames')
    assert program.stop(number) == 0
    assert messages_of(tmp_path / 'run_0')['/joint_states'] == sent
    assert lost_in(tmp_path / 'run_0')['/joint_states'] == 0
    assert re.search(rf'closed {bag}_0: \d+ messages, 0 lost$', program.said[-1])


@pytest.mark.parametrize('storage', STORAGES)
def test_a_full_disk_ends_it_with_one_line(
    graph: Graph,
    start: Callable[..., Program],
    named: NamedChain,
    tmp_path: Path,
    storage: str,
) -> None:
    bag = tmp_path / 'run'
    program = start(
        'bag_recorder', '--ros-args', '-p', f'output:={bag}', '-p', f'storage:={storage}'
    )
    publisher = graph.speak(interfaces.JOINT_STATES)
    graph.next_report('bag_recorder')
    limits = (200_000, 200_000)
    resource.prlimit(program.process.pid, resource.RLIMIT_FSIZE, limits)

    def ended() -> bool:
        publish_frames(publisher, named, 200)
        return program.process.poll() is not None

    graph.until(ended, 'the end of the recorder')
    assert program.process.returncode == 1
    begun, failed = program.said
    assert begun.endswith(f'recording to {bag}_0')
    assert f"bag '{bag}_0' cannot be written: " in failed
    assert 'choose another output; ' in failed
