# SPDX-License-Identifier: Apache-2.0
"""Discovery is complete when all publishers match and no new one appears for a while."""

import shutil
from types import SimpleNamespace
from typing import Any

import pytest
from graphs import Graph
from recordings import messages_of
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.record.receiving_thread import DiscoveryWait
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.bags.recovery import recover_bag
from soliton_linkage_nodes.messages.conversions import chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


def done_at(polls: list[tuple[float, int, int]]) -> Any:
    """Return the end time and the missing topics, for publishers and matches at times [s]."""
    now = 0.0
    wait = DiscoveryWait(clock=lambda: now)
    for step in range(200):
        now = 0.1 * step
        _, publishers, connected = [poll for poll in polls if poll[0] <= now][-1]
        subscription: Any = SimpleNamespace(
            source=SimpleNamespace(name='/nudge'), publishers=publishers, connected=connected
        )
        if wait.done([subscription]):
            return pytest.approx(now, abs=0.15), wait.missing
    return None


def test_discovery_ends_when_no_publisher_has_appeared_for_a_while():
    for polls, done, missing in [
        ([(0.0, 0, 0)], 3.2, []),
        ([(0.0, 0, 0), (0.3, 1, 1)], 3.2, []),
        ([(0.0, 0, 0), (2.9, 1, 1)], 3.9, []),
        ([(0.0, 0, 0), (0.3, 1, 0), (6.0, 1, 1)], 7.0, []),
        ([(0.0, 1, 1), (1.0, 2, 1)], 10.0, ['/nudge']),
    ]:
        assert done_at(polls) == (done, missing)


def test_latched_and_later_messages_are_recorded_after_the_log_line(graph, named, tmp_path, said):
    topics = {topic.name: topic for topic in (interfaces.CHAIN, interfaces.NUDGE)}
    publishers = {
        name: graph.user.create_publisher(topic.type, name, topic.qos)
        for name, topic in topics.items()
    }
    publishers['chain'].publish(chain_to_msg(named, time_to_msg(5)))
    given = {'output': str(tmp_path / 'run'), 'topics': list(topics)}
    recorder = graph.start(BagRecorder, given)
    graph.until(lambda: f'recording to {tmp_path}/run_0\n' in said(), 'its word')
    shutil.copytree(tmp_path / 'run_0', tmp_path / 'then_0')
    publishers['nudge'].publish(Float64(data=1.0))
    graph.stop(recorder)
    _, kept = recover_bag(tmp_path / 'then_0', tmp_path / 'kept')
    assert {name: len(held) for name, held in messages_of(kept).items()} == {
        '/chain': 1,
        '/nudge': 0,
    }
    assert len(messages_of(tmp_path / 'run_0')['/nudge']) == 1


def test_a_publisher_of_another_type_is_not_waited_for(graph, tmp_path, said):
    other = Graph(graph.domain)
    other.user.create_publisher(interfaces.CHAIN.type, 'nudge', 10)
    graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'topics': ['nudge']})
    graph.until(lambda: f'recording to {tmp_path}/run_0\n' in said(), 'its word')
    other.close()
