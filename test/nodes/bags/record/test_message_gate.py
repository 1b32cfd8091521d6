# SPDX-License-Identifier: Apache-2.0
"""A gate passes all, none, or the last seconds; latched messages are never lost."""

from hypothesis import given
from hypothesis import strategies as st

from soliton_linkage_nodes.bags.record.subscriptions import RecordingBuffer
from soliton_linkage_nodes.bags.record.writing_thread import ReceivedMessage, RecordedTopic

SECOND = 10**9
STREAM = RecordedTopic('/joint_states', 'sensor_msgs/msg/JointState', ())
LATCHED = RecordedTopic('/chain', 'soliton_linkage_msgs/msg/Chain', (), latched=True)


def message(source: RecordedTopic, stamp: int, size: int = 1) -> ReceivedMessage:
    return ReceivedMessage(source, stamp, bytes(size))


def test_an_open_gate_passes_everything():
    messages = [message(STREAM, 1), message(LATCHED, 2)]
    assert RecordingBuffer().take(messages) == messages


def test_after_a_pause_the_last_latched_message_of_each_topic_passes():
    gate = RecordingBuffer(paused=True)
    other = RecordedTopic('/map', 'x/msg/Y', (), latched=True)
    messages = [message(LATCHED, 1), message(other, 2), message(STREAM, 3), message(LATCHED, 4)]
    assert gate.take(messages) == []
    assert gate.held == 2
    assert gate.resume() == [messages[1], messages[3]]
    assert gate.take([messages[2]]) == [messages[2]]
    gate.paused = True
    assert gate.resume() == []


@given(st.lists(st.tuples(st.booleans(), st.integers(0, SECOND)), max_size=60))
def test_a_snapshot_is_the_last_seconds_after_the_last_latched_message_before(gaps):
    messages, stamp = [], 0
    for is_latched, gap in gaps:
        stamp += gap
        messages.append(message(LATCHED if is_latched else STREAM, stamp))
    gate = RecordingBuffer(snapshot=2.0)
    for one in messages:
        assert gate.take([one]) == []
    recent = [m for m in messages if stamp - m.stamp <= 2 * SECOND]
    before = [m for m in messages if m.source is LATCHED and m not in recent][-1:]
    assert gate.snapshot() == before + recent
    assert gate.snapshot() == []


def test_a_topic_that_is_taken_late_lengthens_no_snapshot():
    gate = RecordingBuffer(snapshot=2.0)
    newest, late = message(STREAM, 4 * SECOND), message(STREAM, 3 * SECOND)
    for one in (message(STREAM, SECOND), newest, late, message(STREAM, SECOND)):
        gate.take([one])
    assert gate.snapshot() == [newest, late]


def test_the_memory_of_a_snapshot_is_limited():
    gate = RecordingBuffer(snapshot=3600.0, most_kept=1000)
    messages = [message(STREAM, stamp, 100) for stamp in range(50)]
    gate.take(messages)
    assert gate.snapshot() == messages[-10:]
