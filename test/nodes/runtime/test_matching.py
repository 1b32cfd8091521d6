# SPDX-License-Identifier: Apache-2.0
"""Waiting for a subscriber ends when one is there, when it is told to, or in time."""

from __future__ import annotations

import threading

from graphs import Graph

from soliton_linkage_nodes.runtime import interfaces
from soliton_linkage_nodes.runtime.matching import wait_for_subscriber

TOPIC = interfaces.NUDGE
FOR_EVER = 1e6


def test_it_ends_once_there_is_a_subscriber(graph: Graph) -> None:
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    graph.hear(TOPIC)
    assert wait_for_subscriber(publisher, FOR_EVER)


def test_it_ends_in_time_where_there_is_none(graph: Graph) -> None:
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    assert not wait_for_subscriber(publisher, 0.0)


def test_it_ends_when_it_is_told_to_stop(graph: Graph) -> None:
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    stopping = threading.Event()
    stopping.set()
    assert not wait_for_subscriber(publisher, FOR_EVER, stopping)


def test_it_waits_for_as_many_as_asked_for(graph: Graph) -> None:
    publisher = graph.user.create_publisher(TOPIC.type, TOPIC.name, TOPIC.qos)
    graph.hear(TOPIC)
    assert wait_for_subscriber(publisher, FOR_EVER)
    assert not wait_for_subscriber(publisher, 0.0, fewest=2)
    graph.hear(TOPIC)
    assert wait_for_subscriber(publisher, FOR_EVER, fewest=2)
