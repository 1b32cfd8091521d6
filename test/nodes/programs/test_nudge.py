# SPDX-License-Identifier: Apache-2.0
"""The command nudge delivers one nudge, or says why not."""

from __future__ import annotations

import signal
from collections.abc import Callable

import pytest
from graphs import Graph
from programs import Program

from soliton_linkage_nodes.runtime import interfaces


def test_it_publishes_one_nudge_and_ends(graph: Graph, start: Callable[..., Program]) -> None:
    heard = graph.hear(interfaces.NUDGE)
    program = start('nudge', '-2.5')
    graph.until(lambda: program.process.poll() is not None, 'the end of nudge')
    assert program.process.returncode == 0
    graph.until(lambda: heard, 'a nudge')
    assert [message.data for message in heard] == [-2.5]
    assert program.said == []


def test_it_says_that_nobody_listens(start: Callable[..., Program]) -> None:
    program = start('nudge', '10', '--timeout', '0.5')
    assert program.wait() == 1
    assert program.said == [
        'nudge: /nudge has 0 of 1 subscribers after 0.5 s; start edge_actuator first'
    ]


def test_it_says_that_a_speed_must_be_a_number(start: Callable[..., Program]) -> None:
    program = start('nudge', 'hard')
    assert program.wait() == 2
    assert program.said[-1] == "nudge: error: argument speed: invalid float value: 'hard'"


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_stops_waiting_on_a_signal(
    graph: Graph, start: Callable[..., Program], number: signal.Signals
) -> None:
    program = start('nudge', '10')
    graph.until(lambda: 'nudge' in graph.user.get_node_names(), 'the node nudge')
    assert program.stop(number) == 130
    assert program.said == []
