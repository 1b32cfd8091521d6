# SPDX-License-Identifier: Apache-2.0
"""Messages that a publisher sent before it was matched are counted and stored."""

import json
import sys

import pytest
from graphs import values
from hypothesis import given
from hypothesis import strategies as st
from rclpy.qos import QoSProfile, ReliabilityPolicy
from recordings import messages_of
from sensor_msgs.msg import JointState

from soliton_linkage_nodes.bags.reading import open_bag
from soliton_linkage_nodes.bags.record.bag_writer import BagWriter
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.programs import check_bag
from soliton_linkage_nodes.runtime.sequences import MissedStarts

MILLISECOND = 10**6


def missed(first: int, begin: int, period: int) -> int:
    """Missed messages of a publisher that begins a time [ms] after the subscription."""
    starts = MissedStarts()
    at = begin + (first - 1) * period
    starts.add(first, 7 * MILLISECOND, at * MILLISECOND)
    for number in range(1, 50):
        starts.take(first + number, (7 + number * period) * MILLISECOND)
    return starts.missed


@given(st.integers(1, 1000), st.integers(0, 10_000), st.integers(1, 100))
def test_of_a_later_publisher_all_messages_before_the_first_one_received_are_missed(
    first, begin, period
):
    assert missed(first, begin, period) == first - 1


@given(st.integers(2, 1000), st.integers(1, 100), st.data())
def test_messages_of_an_earlier_publisher_are_not_missed(first, period, data):
    begin = -data.draw(st.integers(1, (first - 1) * period))
    assert missed(first, begin, period) == 0


@pytest.mark.parametrize('name', ['joint_states', 'motor_states'])
def test_a_publisher_that_sends_before_it_is_matched_is_reported(graph, tmp_path, said, name):
    given = {'output': str(tmp_path / 'run'), 'topics': [name]}
    recorder = graph.start(BagRecorder, given)
    reports = graph.reports('bag_recorder')
    graph.until(lambda: len(reports) > 1, 'some time')
    # The recorder subscribes to a new topic, or again to one that is not reliable, and misses the
    # first messages.
    qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = graph.user.create_publisher(JointState, name, qos)
    publisher.publish(JointState())
    # On a busy machine, the recorder rarely subscribes before the first message.
    missing, sent = publisher.get_subscription_count() == 0, 1

    def send() -> bool:
        nonlocal sent
        publisher.publish(JointState())
        sent += 1
        return recorder.messages >= 5

    graph.until(send, 'some messages')
    graph.until(lambda: recorder.messages + recorder.missed == sent, 'the rest')
    assert recorder.missed > 0 or not missing
    if not recorder.missed:
        return
    report = graph.next_report('bag_recorder')
    assert values(report)[f'missed on /{name}'] == str(recorder.missed)
    assert report.level == report.WARN
    counted = recorder.missed
    graph.stop(recorder)
    assert f'{sent - counted} messages, 0 lost, {counted} missed before matching' in said()
    assert len(messages_of(tmp_path / 'run_0')[f'/{name}']) == sent - counted
    with open_bag(tmp_path / 'run_0') as reader:
        stored = reader.custom_data['missed_messages']
    assert json.loads(stored) == {f'/{name}': counted}


def test_check_bag_states_the_missed_messages(monkeypatch, capsys, tmp_path):
    writer = BagWriter(tmp_path / 'run')
    writer.add_topic('/nudge', 'std_msgs/msg/Float64')
    writer.close({'missed_messages': '{"/nudge": 3}'})
    monkeypatch.setattr(sys, 'argv', ['check_bag', str(writer.path)])
    with pytest.raises(SystemExit) as ended:
        check_bag.main()
    assert not ended.value.code
    assert '3 on /nudge, before its publisher was matched' in capsys.readouterr().out
