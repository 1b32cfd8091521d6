# SPDX-License-Identifier: Apache-2.0
"""All is connected when those who publish are heard and nobody has come for a while."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from graphs import Graph
from recordings import messages_of
from std_msgs.msg import Float64

from soliton_linkage_nodes.bags.record import taking_thread
from soliton_linkage_nodes.bags.record.taking_thread import Connecting
from soliton_linkage_nodes.bags.recorder import BagRecorder
from soliton_linkage_nodes.bags.rescue import recover_bag
from soliton_linkage_nodes.messages.conversions import NamedChain, chain_to_msg
from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.stamps import time_to_msg


def done_at(looks: list[tuple[float, int, int]], monkeypatch: pytest.MonkeyPatch) -> Any:
    """When it is done, and what is missing, if it sees publishers and heard ones at times [s]."""
    clock = SimpleNamespace(monotonic=lambda: 0.0)
    monkeypatch.setattr(taking_thread, 'time', clock)
    watch = Connecting()
    for step in range(200):
        now = 0.1 * step
        clock.monotonic = lambda now=now: now
        _, publishers, connected = [look for look in looks if look[0] <= now][-1]
        inlet: Any = SimpleNamespace(
            source=SimpleNamespace(name='/nudge'), publishers=publishers, connected=connected
        )
        if watch.done([inlet]):
            return pytest.approx(now, abs=0.15), watch.missing
    return None


@pytest.mark.parametrize(
    ('looks', 'done', 'missing'),
    [
        ([(0.0, 0, 0)], 3.2, []),
        ([(0.0, 0, 0), (0.3, 1, 1)], 3.2, []),
        ([(0.0, 0, 0), (2.9, 1, 1)], 3.9, []),
        ([(0.0, 0, 0), (0.3, 1, 0), (6.0, 1, 1)], 7.0, []),
        ([(0.0, 1, 1), (1.0, 2, 1)], 10.0, ['/nudge']),
    ],
)
def test_it_is_done_when_nobody_has_come_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
    looks: list[tuple[float, int, int]],
    done: float,
    missing: list[str],
) -> None:
    assert done_at(looks, monkeypatch) == (done, missing)


def test_what_was_latched_is_kept_and_the_next_nudge_heard_once_it_says_that_it_records(
    graph: Graph,
    named: NamedChain,
    tmp_path: Path,
    said: Callable[[], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(taking_thread, '_ALL_ANNOUNCED', 0.5)
    monkeypatch.setattr(taking_thread, '_QUIET', 0.3)
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


def test_a_publisher_of_another_type_is_not_waited_for(
    graph: Graph,
    tmp_path: Path,
    said: Callable[[], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(taking_thread, '_ALL_ANNOUNCED', 0.5)
    monkeypatch.setattr(taking_thread, '_QUIET', 0.3)
    other = Graph(graph.domain)
    other.user.create_publisher(interfaces.CHAIN.type, 'nudge', 10)
    graph.start(BagRecorder, {'output': str(tmp_path / 'run'), 'topics': ['nudge']})
    graph.until(lambda: f'recording to {tmp_path}/run_0\n' in said(), 'its word')
    other.close()
